//! Variants that other packages compute under the names of our metrics. These variants help to
//! identify a published number; they are never shown as columns of a table.
//!
//! Each variant is the default of a public package. The code is simple rather than fast, because only `metrics --find`
//! uses it.

use image::{Rgb, Rgb32FImage};
use sharp_metrics::{
    Family, LpipsNet, Mask, MetricKey, Picture, ResizeKernel, Scorer, SsimVariant, resize, ssim,
    ssim_contrast,
};

/// A variant of a metric as other packages compute it, and its value.
#[derive(Debug, Clone, PartialEq)]
pub struct OtherForm {
    /// Name, such as `piq.DISTS`.
    pub name: &'static str,
    pub family: Family,
    /// How the variant differs from our metric, and which public code computes it.
    pub convention: &'static str,
    pub value: f64,
}

/// Computes the variants that have a value for two pictures of the same size. `mask` marks the pixels that count.
/// Networks are taken from `scorer`; variants whose network `scorer` has not loaded are skipped.
pub fn other_forms(
    scorer: &Scorer,
    prediction: &Picture,
    target: &Picture,
    mask: Option<&Mask>,
) -> Vec<OtherForm> {
    let mut found = Vec::new();
    let mut add = |name, family, value: Option<f64>, convention| {
        let form = value.map(|value| OtherForm {
            name,
            family,
            convention,
            value,
        });
        found.extend(form);
    };
    let both = |change: &dyn Fn(&Picture) -> Picture| [prediction, target].map(change);
    let psnr_of = |[a, b]: &[Picture; 2]| sharp_metrics::psnr(a, b, None).ok();
    let [psnr, of_ssim, lpips, dists] = Family::ALL;

    let luma = both(&|picture| weighted(picture, [0.299, 0.587, 0.114], 0.0));
    add(
        "PSNR of luma",
        psnr,
        psnr_of(&luma),
        "On 0.299 R + 0.587 G + 0.114 B.",
    );
    // MATLAB's rgb2ycbcr: luma in 16..235 of 255.
    let matlab = both(&|picture| {
        weighted(
            picture,
            [65.481 / 255.0, 128.553 / 255.0, 24.966 / 255.0],
            16.0 / 255.0,
        )
    });
    add(
        "PSNR of luma in 16..235",
        psnr,
        psnr_of(&matlab),
        "On the Y of MATLAB's rgb2ycbcr (BT.601, 16..235) against a peak of 255, as in super-resolution.",
    );

    // SSIM whose constants are too large by a factor of 4 equals SSIM of halved values.
    let halved = both(&|picture| mapped(picture, |rgb, _| rgb.map(|v| 0.5 * v)));
    for (key, name) in [
        ("ssim[uniform7,sample]", "SSIM with data_range=2, 7x7 box"),
        ("ssim[gauss11,valid]", "SSIM with data_range=2, Gaussian"),
    ] {
        add(
            name,
            of_ssim,
            score(scorer, key, &halved[0], &halved[1], None),
            "Constants for values in -1..1, applied to pictures in 0..1: scikit-image's default for floats before 0.21.",
        );
    }
    let (width, height) = target.dimensions();
    let factor = ((f64::from(width.min(height)) / 256.0).round_ties_even() as u32).max(1);
    if factor > 1 {
        let small = both(&|picture| pooled(picture, factor));
        add(
            "piq.ssim",
            of_ssim,
            similarity(&small),
            "Both pictures first reduced to means of f x f pixels, f = shorter side / 256 rounded; piq's default.",
        );
        let small = luma.each_ref().map(|picture| pooled(picture, factor));
        add(
            "ssim.m",
            of_ssim,
            similarity(&small),
            "As piq.ssim, on luma: the authors' MATLAB code.",
        );
    }
    let scales = multi_scale([prediction, target]);
    add(
        "MS-SSIM",
        of_ssim,
        scales.map(|[valid, _]| valid),
        "Five scales, windows inside the picture: the paper's, and torchmetrics before 1.4.2.",
    );
    add(
        "MS-SSIM of torchmetrics",
        of_ssim,
        scales.map(|[_, reflected]| reflected),
        "Five scales, the coarsest with reflected borders: torchmetrics since 1.4.2.",
    );

    for (net, name) in [
        (LpipsNet::Alex, "LPIPS v0.0 alex"),
        (LpipsNet::Vgg, "LPIPS v0.0 vgg"),
        (LpipsNet::Squeeze, "LPIPS v0.0 squeeze"),
    ] {
        let value = scorer.lpips_v0(net, prediction, target);
        add(
            name,
            lpips,
            value.and_then(Result::ok),
            "lpips.LPIPS(version='0.0'): other weights, and the network sees -1..1 without its normalisation.",
        );
    }
    let shorter = f64::from(width.min(height));
    if shorter > 256.0 {
        let side = |n: u32| (f64::from(n) * (256.0 / shorter)).floor() as u32;
        let small = [prediction, target]
            .map(|picture| resize(picture, side(width), side(height), ResizeKernel::Bilinear));
        let value = match &small {
            [Ok(prediction), Ok(target)] => score(scorer, "dists", prediction, target, None),
            _ => None,
        };
        add(
            "piq.DISTS",
            dists,
            value,
            "Both pictures first reduced to a shorter side of 256 by bilinear interpolation without antialiasing.",
        );
    }
    if let Some(mask) = mask {
        let black = both(&|picture| {
            mapped(
                picture,
                |rgb, at| if mask.values()[at] { rgb } else { [0.0; 3] },
            )
        });
        for (key, name) in [
            ("psnr", "PSNR of masked pictures"),
            ("ssim[gauss11,valid]", "SSIM of masked pictures"),
            ("lpips[alex,v0.1]", "LPIPS alex of masked pictures"),
            ("lpips[vgg,v0.1]", "LPIPS vgg of masked pictures"),
            ("dists", "DISTS of masked pictures"),
        ] {
            let family = key.parse::<MetricKey>().map_or(psnr, MetricKey::family);
            add(
                name,
                family,
                score(scorer, key, &black[0], &black[1], None),
                "Pixels outside the mask are set to black in both pictures, which are then compared as a whole.",
            );
        }
    }
    found
}

/// Value of one of the scorer's own metrics; `None` if the scorer does not have it.
fn score(
    scorer: &Scorer,
    key: &str,
    prediction: &Picture,
    target: &Picture,
    mask: Option<&Mask>,
) -> Option<f64> {
    let key: MetricKey = key.parse().ok()?;
    let scorer = scorer.restricted(&[key]);
    let scores = scorer.score(prediction, target, mask).ok()?;
    scores.into_iter().next()?.1.ok()
}

/// Applies `change(colour, index)` to every pixel; indices are row-major.
fn mapped(picture: &Picture, change: impl Fn([f64; 3], usize) -> [f64; 3]) -> Picture {
    let (width, height) = picture.dimensions();
    Rgb32FImage::from_fn(width, height, |x, y| {
        let rgb = [0, 1, 2].map(|channel| picture.value(x, y, channel));
        Rgb(change(rgb, (y * width + x) as usize).map(|v| v as f32))
    })
    .into()
}

/// Gray: the weighted sum of the channels plus an offset.
fn weighted(picture: &Picture, [r, g, b]: [f64; 3], offset: f64) -> Picture {
    mapped(picture, |rgb, _| {
        [r * rgb[0] + g * rgb[1] + b * rgb[2] + offset; 3]
    })
}

/// Means over blocks of `by` × `by` pixels; ignores the remainder at the right and the bottom.
fn pooled(picture: &Picture, by: u32) -> Picture {
    let (width, height) = picture.dimensions();
    Rgb32FImage::from_fn(width / by, height / by, |x, y| {
        let inside = (0..by).flat_map(|j| (0..by).map(move |i| (x * by + i, y * by + j)));
        let sum = |channel| -> f64 {
            let values = inside.clone().map(|(x, y)| picture.value(x, y, channel));
            values.sum()
        };
        Rgb([0, 1, 2].map(|channel| (sum(channel) / f64::from(by * by)) as f32))
    })
    .into()
}

/// SSIM over the windows inside the pictures; `None` if no window fits.
fn similarity([a, b]: &[Picture; 2]) -> Option<f64> {
    ssim(SsimVariant::Gauss11Valid, a, b, None).ok()
}

/// Two variants of multi-scale SSIM (Wang et al. 2003): windows inside the coarsest picture, and reflected borders.
fn multi_scale(pictures: [&Picture; 2]) -> Option<[f64; 2]> {
    const WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];
    // Powers of negative values are not real.
    let power = |value: f64, weight: f64| value.max(0.0).powf(weight);
    let mut product = 1.0;
    let [mut a, mut b] = pictures.map(Picture::clone);
    for weight in &WEIGHTS[..4] {
        product *= power(ssim_contrast(&a, &b).ok()?, *weight);
        (a, b) = (pooled(&a, 2), pooled(&b, 2));
    }
    let last = |border| Some(product * power(ssim(border, &a, &b, None).ok()?, WEIGHTS[4]));
    Some([
        last(SsimVariant::Gauss11Valid)?,
        last(SsimVariant::Gauss11Reflect)?,
    ])
}
