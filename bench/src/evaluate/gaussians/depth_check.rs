//! Compares the depth of Gaussians in their own source with true depth.

use image::Luma;
use sharp::camera::Intrinsics;
use sharp_datasets::DepthMap;

use crate::pairs::valid_depth::{is_valid_depth, median_of};

/// Rendered depth counts as inverse depth if the spread of log(rendered / true) exceeds this multiple of the spread of
/// log(rendered × true). For inverse depth, the product is constant.
const INVERSE_SIGNIFICANCE: f64 = 2.5;
/// Factor between rendered and true depth above which another unit is suspected. Predictions of unknown scale differ by
/// less.
const MIN_FACTOR: f64 = 1.5;
/// Another unit is reported only if the logarithm of the factor exceeds this multiple of the spread of the logarithmic
/// depth ratios. Prediction errors cause that spread.
const FACTOR_SIGNIFICANCE: f64 = 10.0;
/// Depths are compared only if at least this many pixels have both a rendered and a true depth.
const FEWEST_PIXELS: usize = 20;
/// Factor between the median rendered and median true depth above which another unit is suspected even if the ratios
/// vary strongly from pixel to pixel.
const CERTAIN_FACTOR: f64 = 10.0;
/// Ray lengths are reported only if at least this many pixels were compared.
const FEWEST_RAYS: usize = 300;
/// Ray lengths are reported only if the spread of the logarithmic depth ratios is at least this. In a narrow field of
/// view, ray lengths hardly differ from depths.
const MIN_SPREAD: f64 = 0.01;
/// Ray lengths are reported only if correcting for them reduces the spread of the logarithmic depth ratios to at most
/// this fraction.
const LEFT_BY_RAYS: f64 = 0.4;

/// Warns if the rendered depth differs from the true depth by more than prediction errors explain, as if it had another
/// unit, were inverse depth, or were confused with ray length. For another unit, also returns the ratio of rendered to
/// true depth.
pub(super) fn depth_doubt(
    truth: &DepthMap,
    seen: &DepthMap,
    k: Intrinsics,
    scale: f64,
    id: &str,
) -> Option<(Option<f64>, String)> {
    if truth.dimensions() != seen.dimensions() {
        return None;
    }
    let both = logarithms(truth, seen, k);
    if both.len() < FEWEST_PIXELS {
        return None;
    }
    let middle_and_spread = |power: f64, of_ray: f64| {
        let ratios = both.iter().map(|[t, s, ray]| t - power * s + of_ray * ray);
        let ratios: Vec<f64> = ratios.collect();
        let middle = median_of(ratios.clone())?;
        let spread = median_of(ratios.iter().map(|r| (r - middle).abs()).collect())?;
        Some((middle, spread))
    };
    let ((middle, spread), (_, of_inverse)) =
        (middle_and_spread(1.0, 0.0)?, middle_and_spread(-1.0, 0.0)?);
    if of_inverse * INVERSE_SIGNIFICANCE < spread {
        let text = format!(
            "its Gaussians are far where the dataset's depth is near, and near where it is far \
             ({id}), so inverse depth was probably mistaken for depth; no setting corrects this"
        );
        return Some((None, text));
    }
    let is_unit = middle.abs() > MIN_FACTOR.ln().max(FACTOR_SIGNIFICANCE * 1.4826 * spread);
    for (of_ray, what) in [
        (
            1.0,
            "too far away towards the picture's edges by the factor √(1 + x² + y²), probably because ray lengths \
             were mistaken for depths",
        ),
        (
            -1.0,
            "too near towards the picture's edges by the factor √(1 + x² + y²), probably because depths were \
             mistaken for ray lengths",
        ),
    ] {
        // The spread after the full correction must be below the spreads after half and after 1.5 times the correction,
        // and well below the spread without correction.
        let left = |share: f64| Some(middle_and_spread(1.0, share * of_ray)?.1);
        let (half, own, more) = (left(0.5)?, left(1.0)?, left(1.5)?);
        let is_ray = spread >= MIN_SPREAD && own <= LEFT_BY_RAYS * spread && own < half.min(more);
        if is_ray && both.len() >= FEWEST_RAYS && !is_unit {
            let text = format!(
                "its Gaussians are {what} ({id}); no setting corrects this; a ray's length is z times this factor, \
                 where x and y are distances from the principal point in focal lengths"
            );
            return Some((None, text));
        }
    }
    is_unit.then(|| {
        let factor = (-middle).exp();
        (Some(factor), other_unit(factor, Some(scale), id))
    })
}

/// Warns if the median rendered and the median true depth differ by more than [`CERTAIN_FACTOR`]. Only pixels with both
/// depths count, because a sky has Gaussians and often no true depth. `scale` is the method's setting `scale=`, if it
/// has one.
pub(super) fn other_order_of_magnitude(
    truth: &DepthMap,
    seen: &DepthMap,
    scale: Option<f64>,
    id: &str,
) -> Option<String> {
    if truth.dimensions() != seen.dimensions() {
        return None;
    }
    let both = truth.iter().zip(seen.iter());
    let both = both.filter(|(t, s)| is_valid_depth(**t) && is_valid_depth(**s));
    let [of_truth, of_seen]: [Vec<f32>; 2] = both.unzip().into();
    if of_truth.len() < FEWEST_PIXELS {
        return None;
    }
    let factor = median_of(of_seen)? / median_of(of_truth)?;
    let is_likely = (CERTAIN_FACTOR.recip()..=CERTAIN_FACTOR).contains(&factor);
    (!is_likely).then(|| other_unit(factor, scale, id))
}

fn other_unit(factor: f64, scale: Option<f64>, id: &str) -> String {
    let fit = scale.map_or_else(String::new, |scale| {
        format!("`scale={}`, or ", rounded(scale / factor))
    });
    format!(
        "its Gaussians are {factor:.3} times as far away as the dataset's depth ({id}); if the dataset's unit is right, use \
         {fit}`depth=privileged` if each source has its own unit"
    )
}

/// Natural logarithms of the true depth, the rendered depth and the ray's length per depth, of about ten thousand pixels
/// that have both depths.
fn logarithms(truth: &DepthMap, seen: &DepthMap, k: Intrinsics) -> Vec<[f64; 3]> {
    let step = (truth.as_raw().len() / 10_000).max(1);
    let both = truth.enumerate_pixels().zip(seen.pixels()).step_by(step);
    both.filter(|((_, _, Luma([t])), Luma([s]))| is_valid_depth(*t) && is_valid_depth(*s))
        .map(|((x, y, Luma([t])), Luma([s]))| {
            let across = (f64::from(x) + 0.5 - k.cx) / k.fx;
            let down = (f64::from(y) + 0.5 - k.cy) / k.fy;
            let ray = across.hypot(down).hypot(1.0);
            [f64::from(*t), f64::from(*s), ray].map(f64::ln)
        })
        .collect()
}

pub(super) fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_depth_is_told_and_errors_of_depth_are_not() {
        let map =
            |of: fn(f32) -> f32| DepthMap::from_fn(40, 32, |x, y| Luma([of((x * 32 + y) as f32)]));
        let truth = map(|at| 1.0 + at / 100.0);
        let said = |seen: fn(f32) -> f32| {
            depth_doubt(&truth, &map(seen), camera(), 1.0, "s").map(|found| found.1)
        };
        let text = said(|at| 3.0 / (1.0 + at / 100.0)).unwrap_or_default();
        assert!(text.contains("inverse depth"), "{text}");
        for proper in [
            (|at| 1.0 + at / 100.0) as fn(f32) -> f32,
            |at| 1.2 + at / 150.0 + 0.5 * (at * 7.0).sin(),
            |_| 3.0,
            |at| 4.0 + (at * 7.0).sin(),
        ] {
            assert_eq!(said(proper), None);
        }
    }

    fn camera() -> Intrinsics {
        Intrinsics::new((40.0, 40.0), (20.0, 16.0), (40, 32)).unwrap()
    }

    #[test]
    fn ray_lengths_taken_as_depth_are_told_and_errors_at_the_edges_are_not() {
        // Boxes before a slanted wall; `seen` gives the factor from x, y and noise, in half pictures.
        let truth = |x: u32, y: u32| 2.0 + 0.05 * f64::from(x) + f64::from((x / 9 + y / 7) % 3);
        let said = |seen: fn(f64, f64, f64) -> f64| {
            let map = |of: &dyn Fn(u32, u32) -> f64| {
                DepthMap::from_fn(40, 32, |x, y| Luma([of(x, y) as f32]))
            };
            let factor = |x: u32, y: u32| {
                let noise = f64::from((x * 7919 + y * 104_729) % 101) / 50.0 - 1.0;
                seen(
                    (f64::from(x) - 19.5) / 40.0,
                    (f64::from(y) - 15.5) / 40.0,
                    noise,
                )
            };
            let other = map(&|x, y| truth(x, y) * factor(x, y));
            let found = depth_doubt(&map(&truth), &other, camera(), 1.0, "s");
            found.map_or_else(String::new, |found| found.1)
        };
        let text = said(|x, y, noise| 1.2 * x.hypot(y).hypot(1.0) * (1.0 + 0.01 * noise));
        assert!(text.contains("too far away towards"), "{text}");
        let text = said(|x, y, _| 1.0 / x.hypot(y).hypot(1.0));
        assert!(text.contains("too near towards"), "{text}");
        for proper in [
            (|_, _, _| 1.0) as fn(f64, f64, f64) -> f64,
            |_, _, noise| 1.0 + 0.2 * noise,
            |x, y, noise| x.hypot(y).hypot(1.0) * (1.0 + 0.2 * noise),
            |x, _, _| 1.0 + 0.3 * x,
            |x, y, _| 1.0 + 0.1 * (7.0 * x + 3.0 * y).sin(),
            |x, y, _| 1.0 + 0.15 * (x * x + y * y),
            |x, y, _| 1.0 + x * x + y * y,
        ] {
            assert_eq!(said(proper), "");
        }
    }

    #[test]
    fn a_sky_without_true_depth_is_no_other_unit() {
        let truth = DepthMap::from_fn(40, 32, |_, y| Luma([if y < 24 { 0.0 } else { 3.0 }]));
        let seen = |ground: f32| {
            DepthMap::from_fn(40, 32, |_, y| Luma([if y < 24 { 500.0 } else { ground }]))
        };
        let said = |ground: f32| other_order_of_magnitude(&truth, &seen(ground), Some(2.0), "s");
        assert_eq!(said(3.5), None);
        assert_eq!(said(25.0), None);
        let text = said(3000.0).unwrap_or_default();
        assert!(text.contains("1000.000 times as far away"), "{text}");
        assert!(
            text.contains("use `scale=0.002`, or `depth=privileged`"),
            "{text}"
        );
        assert!(said(0.2).is_some());
    }
}
