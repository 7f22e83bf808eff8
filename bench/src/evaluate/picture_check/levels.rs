//! Detects pictures whose levels were converted wrongly. The conversion leaves traces: a limited range, colours that
//! only an overflow produces, or the levels of a normalised photograph.

use image::imageops::thumbnail;
use image::{Rgb, RgbImage};
use sharp::color::{Quantization, quantize, srgb_from_linear};

/// Ends of the limited range of video, each with the tolerance of its measurement, in levels.
const LIMITED: [(f64, f64); 2] = [(16.0, 2.5), (235.0, 3.0)];
/// Widths, in pixels, to which both pictures are reduced to measure the levels of black and white. At the larger width,
/// blur lowers the contrast more, so two widths tell blur from another range.
const WIDTHS: [u32; 2] = [32, 80];
/// Lowest and highest level of a picture in the limited range, with some tolerance because JPEG overshoots.
const WITHIN: [u8; 2] = [12, 239];
/// Wrapped levels are reported only if at least this share of the pixels has a wrapped channel.
const MIN_WRAPPED: f64 = 5e-4;
/// Wrapped levels are reported only if the median difference of the mid-tones is at most this, in levels.
const MAX_MID_TONE_DIFFERENCE: u8 = 30;
/// Maximum number of pixels compared.
const SAMPLES: u32 = 32_768;
/// Stretching explains a picture's share of levels 0 (or 255) if it exceeds the photograph's share of darkest (or
/// brightest) levels by at most this.
const MAX_SHARE_AT_ENDS: f64 = 2e-4;
/// Minimum factor by which stretching raises a picture's contrast.
const MIN_STRETCH: f64 = 1.04;
/// If the photograph is stretched like the picture, its darkest and brightest level must be at most this far from 0 and
/// 255, in levels.
const MAX_OFF_ENDS: f64 = 30.0;
/// A photograph is coloured if its channels differ by at least this on average, in levels.
const MIN_COLOUR: usize = 8;
/// The correlation of neighbouring pixels is below the first value in noise, and above the second in photographs.
const NOISE: [f64; 2] = [0.1, 0.5];
/// ImageNet's mean and standard deviation of red, green and blue, 0..1.
const IMAGENET: [(f64, f64); 3] = [(0.485, 0.229), (0.456, 0.224), (0.406, 0.225)];
/// CLIP's mean and standard deviation of red, green and blue, 0..1.
const CLIP: [(f64, f64); 3] = [(0.4815, 0.2686), (0.4578, 0.2613), (0.4082, 0.2758)];
/// For each channel, a line maps the photograph's levels to the picture's. Lines are compared at these levels of the
/// photograph.
const COMPARED: [f64; 2] = [60.0, 190.0];
/// A normalisation matches if the channels' lines differ from its own by at most this root mean square, in levels.
const MAX_OFF_LINES: f64 = 3.0;
/// Channels count as treated differently if the root mean square difference of their lines from the common mean is at
/// least this, in levels.
const MIN_OFF_EQUAL_LINES: f64 = 5.0;
/// A line describes a picture's channel only if its correlation with the photograph's channel is at least this.
const MIN_CORRELATION: f64 = 0.8;

/// Whether a photograph's black and white became 16 and 235. At two resolutions, the line that matches mean and
/// standard deviation must map black and white to these levels. The picture's `ends` must lie between them. Other
/// losses of contrast give other levels.
pub(super) fn is_limited(seen: &RgbImage, shown: &RgbImage, ends: [u8; 2]) -> bool {
    let is_near = |width: u32| {
        let [seen, shown] = [seen, shown].map(|p| moments(narrowed(p, width).iter()));
        let gain = shown.1 / seen.1;
        let black = shown.0 - gain * seen.0;
        let found = [black, black + 255.0 * gain];
        found
            .iter()
            .zip(LIMITED)
            .all(|(found, (level, off))| (found - level).abs() <= off)
    };
    ends[0] >= WITHIN[0] && ends[1] <= WITHIN[1] && WIDTHS.into_iter().all(is_near)
}

/// A picture reduced to the given width; narrower pictures keep their width.
fn narrowed(picture: &RgbImage, width: u32) -> RgbImage {
    let (full, height) = picture.dimensions();
    let width = width.min(full);
    thumbnail(picture, width, (height * width / full).max(1))
}

/// Mean and standard deviation of the levels.
fn moments<'a>(levels: impl Iterator<Item = &'a u8> + Clone) -> (f64, f64) {
    let count = levels.clone().count() as f64;
    let sum = |of: &dyn Fn(f64) -> f64| levels.clone().map(|v| of(f64::from(*v))).sum::<f64>();
    let mean = sum(&|v| v) / count;
    (mean, (sum(&|v| (v - mean).powi(2)) / count).sqrt())
}

/// Whether levels beyond 0..255 wrapped around: next to white or black, some channels are at the opposite end. Only
/// colours that hardly occur in the photograph are evidence, and only if the mid-tones are right.
pub(super) fn is_wrapped(photograph: &RgbImage, picture: &RgbImage) -> bool {
    let (width, height) = photograph.dimensions();
    if picture.dimensions() != (width, height) {
        return false;
    }
    let step = (f64::from(width * height) / f64::from(SAMPLES))
        .sqrt()
        .ceil() as usize;
    let (mut all, mut found, mut saturated) = (0.0, 0.0, [0.0; 2]);
    let mut off = [0_usize; 256];
    for y in (0..height).step_by(step.max(1)) {
        for x in (0..width).step_by(step.max(1)) {
            let colours = [photograph, picture].map(|p| p.get_pixel(x, y).0);
            let [seen, shown] = colours.map(|[r, g, b]| [r.min(g).min(b), r.max(g).max(b)]);
            let is_dark = seen[0] >= 200 && shown[1] >= 200 && shown[0] <= 30;
            let is_bright = seen[1] <= 55 && shown[0] <= 55 && shown[1] >= 225;
            all += 1.0;
            found += f64::from(is_dark || is_bright);
            for (count, [low, high]) in saturated.iter_mut().zip([seen, shown]) {
                *count += f64::from(high >= 200 && low <= 55);
            }
            let mid = colours[0].iter().zip(colours[1]);
            mid.filter(|(seen, _)| (60..=190).contains(*seen))
                .for_each(|(seen, shown)| off[usize::from(seen.abs_diff(shown))] += 1);
        }
    }
    let near: usize = off[..=usize::from(MAX_MID_TONE_DIFFERENCE)].iter().sum();
    found >= MIN_WRAPPED * all
        && saturated[1] >= 2.0 * saturated[0] + found / 2.0
        && 2 * near >= off.iter().sum()
}

/// The gain in contrast, in percent, of a picture whose darkest and brightest levels were stretched to 0 and 255.
/// `None` if stretching does not explain the picture's levels 0 and 255, or if the photograph itself has these levels.
pub(super) fn stretching(
    photograph: &RgbImage,
    seen: &RgbImage,
    shown: &RgbImage,
    picture: &RgbImage,
) -> Option<i16> {
    let share = |of: &RgbImage, is: &dyn Fn(u8) -> bool| {
        of.iter().filter(|level| is(**level)).count() as f64 / of.len() as f64
    };
    // Stretching maps the photograph's flat shadows and highlights to 0 and 255.
    let [darkest, brightest] = [photograph.iter().min()?, photograph.iter().max()?];
    let flat = [
        share(photograph, &|v| v - darkest <= 2),
        share(photograph, &|v| brightest - v <= 2),
    ];
    let ends = [share(picture, &|v| v == 0), share(picture, &|v| v == 255)];
    let mut both = ends.into_iter().zip(flat);
    if !both.all(|(end, flat)| end > 0.0 && end <= flat + MAX_SHARE_AT_ENDS) {
        return None;
    }
    let gains = WIDTHS.map(|width| {
        let [seen, shown] = [seen, shown].map(|p| moments(narrowed(p, width).iter()));
        (shown.1 / seen.1, shown.0 - seen.0 * shown.1 / seen.1)
    });
    let lowest = seen.iter().min().map(|v| f64::from(*v))?;
    let highest = seen.iter().max().map(|v| f64::from(*v))?;
    let is_range = |(gain, black): &(f64, f64)| {
        *gain >= MIN_STRETCH
            && (black + gain * lowest).abs() <= MAX_OFF_ENDS
            && (black + gain * highest - 255.0).abs() <= MAX_OFF_ENDS
    };
    gains
        .iter()
        .all(is_range)
        .then(|| (100.0 * gains[0].0).round() as i16)
}

/// Whether a picture has three equal channels and several levels, and the photograph clearly has colours.
pub(super) fn is_grey(seen: &RgbImage, picture: &RgbImage) -> bool {
    let range = |[r, g, b]: [u8; 3]| usize::from(r.max(g).max(b) - r.min(g).min(b));
    let colours: usize = seen.pixels().map(|pixel| range(pixel.0)).sum();
    colours >= MIN_COLOUR * seen.pixels().len()
        && picture.pixels().all(|pixel| range(pixel.0) == 0)
        && !is_uniform(picture)
}

/// Whether two of a picture's channels are equal, and those of the photograph clearly differ.
pub(super) fn has_equal_channels(seen: &RgbImage, picture: &RgbImage) -> bool {
    let is_any = [(0, 1), (1, 2), (0, 2)].into_iter().any(|(a, b)| {
        let off = |pixel: &Rgb<u8>| usize::from(pixel.0[a].abs_diff(pixel.0[b]));
        picture.pixels().all(|pixel| off(pixel) == 0)
            && seen.pixels().map(off).sum::<usize>() >= MIN_COLOUR * seen.pixels().len()
    });
    is_any && !is_uniform(picture)
}

/// Whether a picture has one colour.
pub(super) fn is_uniform(picture: &RgbImage) -> bool {
    picture
        .pixels()
        .all(|pixel| pixel == picture.get_pixel(0, 0))
}

/// Whether the green levels of neighbouring pixels differ as much as those of distant pixels, unlike in the photograph.
pub(super) fn is_noise(photograph: &RgbImage, picture: &RgbImage) -> bool {
    let likeness = |of: &RgbImage| {
        let [mut pairs, mut sum, mut squares, mut products] = [0.0; 4];
        for row in of.rows() {
            let green: Vec<f64> = row.map(|pixel| f64::from(pixel.0[1])).collect();
            for pair in green.chunks_exact(2) {
                pairs += 1.0;
                sum += pair[0] + pair[1];
                squares += pair[0].powi(2) + pair[1].powi(2);
                products += pair[0] * pair[1];
            }
        }
        let mean = sum / (2.0 * pairs);
        let variance = squares / (2.0 * pairs) - mean * mean;
        (variance > 100.0).then(|| (products / pairs - mean * mean) / variance)
    };
    likeness(picture).is_some_and(|own| own < NOISE[0])
        && likeness(photograph).is_some_and(|own| own > NOISE[1])
}

/// Whether a picture has only the levels 0 and 1, unlike the photograph.
pub(super) fn is_unscaled(seen: &RgbImage, picture: &RgbImage) -> bool {
    picture.iter().all(|level| *level <= 1) && picture.contains(&1) && seen.iter().max() > Some(&50)
}

/// A colour minus ImageNet's mean, divided by its standard deviation, as levels.
pub(super) fn normalised(color: [u8; 3]) -> [u8; 3] {
    std::array::from_fn(|c| {
        let (mean, deviation) = IMAGENET[c];
        (255.0 * (f64::from(color[c]) / 255.0 - mean) / deviation).round() as u8
    })
}

/// Whether the channels' means and standard deviations are those of a photograph that was normalised by ImageNet's or
/// CLIP's statistics and then mapped to 0..255 by one line for all channels.
pub(super) fn is_normalised_and_stretched(seen: &RgbImage, shown: &RgbImage) -> bool {
    let [seen, shown] = [seen, shown].map(|p| narrowed(p, WIDTHS[0]));
    let mut least = 1.0_f64;
    let lines: [[f64; 2]; 3] = std::array::from_fn(|c| {
        let [a, b] = [&seen, &shown].map(|p| p.iter().skip(c).step_by(3));
        let [seen, shown] = [a.clone(), b.clone()].map(moments);
        let product = |(a, b): (&u8, &u8)| (f64::from(*a) - seen.0) * (f64::from(*b) - shown.0);
        let covariance = a.len() as f64 * seen.1 * shown.1;
        least = least.min(a.zip(b).map(product).sum::<f64>() / covariance.max(1.0));
        COMPARED.map(|level| shown.0 + (level - seen.0) * shown.1 / seen.1.max(1.0))
    });
    // Root mean square difference of the lines from those of a normalisation that is followed by the best line common
    // to all channels.
    let off = |statistics: [(f64, f64); 3]| {
        let expected =
            statistics.map(|(mean, by)| COMPARED.map(|level| (level / 255.0 - mean) / by));
        let centred = [expected, lines].map(|all| {
            let all = all.as_flattened();
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            all.iter().map(|v| v - mean).collect::<Vec<f64>>()
        });
        let product = |a: usize, b: usize| {
            let pairs = centred[a].iter().zip(&centred[b]);
            pairs.map(|(a, b)| a * b).sum::<f64>() / centred[a].len() as f64
        };
        let explained = product(0, 1).powi(2) / product(0, 0);
        (product(1, 1) - explained).max(0.0).sqrt()
    };
    let is_exposure = off([(0.0, 1.0); 3]) < MIN_OFF_EQUAL_LINES;
    least >= MIN_CORRELATION && !is_exposure && off(IMAGENET).min(off(CLIP)) <= MAX_OFF_LINES
}

/// RGB of hue, saturation and value, 0..255. `turn` is the level of a full turn of hue: 256 (PIL) or 180 (OpenCV).
pub(super) fn from_hsv([hue, saturation, value]: [u8; 3], turn: f64) -> [u8; 3] {
    let (saturation, value) = (f64::from(saturation) / 255.0, f64::from(value));
    [5.0, 3.0, 1.0].map(|start| {
        let sector = (start + 6.0 * f64::from(hue) / turn) % 6.0;
        (value * (1.0 - saturation * sector.min(4.0 - sector).clamp(0.0, 1.0))).round() as u8
    })
}

/// sRGB of CIE L*a*b* as OpenCV stores it (L* times 2.55, a* and b* plus 128; white D65).
pub(super) fn from_lab([lightness, a, b]: [u8; 3]) -> [u8; 3] {
    let y = (f64::from(lightness) / 2.55 + 16.0) / 116.0;
    let [x, z] = [
        y + (f64::from(a) - 128.0) / 500.0,
        y - (f64::from(b) - 128.0) / 200.0,
    ];
    let [x, y, z] = [x, y, z].map(|f| {
        if f > 6.0 / 29.0 {
            f.powi(3)
        } else {
            (f - 4.0 / 29.0) * 108.0 / 841.0
        }
    });
    let (x, z) = (0.950_456 * x, 1.088_754 * z);
    let linear = [
        3.240_479 * x - 1.537_150 * y - 0.498_535 * z,
        -0.969_256 * x + 1.875_991 * y + 0.041_556 * z,
        0.055_648 * x - 0.204_043 * y + 1.057_311 * z,
    ];
    linear.map(|v| {
        quantize(
            srgb_from_linear(v.clamp(0.0, 1.0) as f32),
            Quantization::Round,
        )
    })
}

/// Full-range Y, Cb and Cr of RGB (BT.601, as in JPEG).
pub(super) fn to_luma([r, g, b]: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = [r, g, b].map(f64::from);
    let y = 0.299 * r + 0.587 * g + 0.114 * b;
    [y, 128.0 + 0.564 * (b - y), 128.0 + 0.713 * (r - y)].map(|v| v.round() as u8)
}

/// RGB of full-range Y, Cb and Cr (BT.601, as in JPEG).
pub(super) fn from_luma([y, cb, cr]: [u8; 3]) -> [u8; 3] {
    let (y, cb, cr) = (f64::from(y), f64::from(cb) - 128.0, f64::from(cr) - 128.0);
    let rgb = [
        y + 1.402 * cr,
        y - 0.344_136 * cb - 0.714_136 * cr,
        y + 1.772 * cb,
    ];
    rgb.map(|v| v.round() as u8)
}
