//! Compares the depth of Gaussians in their own source with true depth.

use image::Luma;
use sharp_datasets::DepthMap;

use crate::pairs::valid_depth::{is_valid_depth, median_of};

/// Rendered depth counts as inverse depth if the ratio of true to rendered depth varies this many
/// times as much as their product.
const INVERSE_SIGNIFICANCE: f64 = 2.5;
/// A depth factor may indicate another unit only from this value on; predictions without a unit are
/// off by less.
const LEAST_FACTOR: f64 = 1.5;
/// The factor's logarithm must be at least this many times the spread of depth ratios, which
/// prediction errors cause.
const FACTOR_SIGNIFICANCE: f64 = 10.0;

/// Warns if rendered depth has another unit than true depth, or is its inverse, and prediction errors do not explain
/// this. Of another unit, also how many times the true depth is seen.
pub(super) fn depth_doubt(
    truth: &DepthMap,
    seen: &DepthMap,
    scale: f64,
    id: &str,
) -> Option<(Option<f64>, String)> {
    if truth.dimensions() != seen.dimensions() {
        return None;
    }
    // About ten thousand pixels are enough.
    let step = (truth.as_raw().len() / 10_000).max(1);
    let both = truth.pixels().zip(seen.pixels()).step_by(step);
    let both: Vec<[f64; 2]> = both
        .filter(|(Luma([t]), Luma([s]))| is_valid_depth(*t) && is_valid_depth(*s))
        .map(|(Luma([t]), Luma([s]))| [f64::from(*t).ln(), f64::from(*s).ln()])
        .collect();
    if both.len() < 20 {
        return None;
    }
    let middle_and_spread = |power: f64| {
        let ratios: Vec<f64> = both.iter().map(|[t, s]| t - power * s).collect();
        let middle = median_of(ratios.clone())?;
        let spread = median_of(ratios.iter().map(|r| (r - middle).abs()).collect())?;
        Some((middle, spread))
    };
    let ((middle, spread), (_, of_inverse)) = (middle_and_spread(1.0)?, middle_and_spread(-1.0)?);
    if of_inverse * INVERSE_SIGNIFICANCE < spread {
        let text = format!(
            "its Gaussians are far where the dataset's depth is near, and near where it is far \
             ({id}): inverse depth was probably mistaken for depth, which no setting corrects"
        );
        return Some((None, text));
    }
    let is_unit = middle.abs() > LEAST_FACTOR.ln().max(FACTOR_SIGNIFICANCE * 1.4826 * spread);
    is_unit.then(|| {
        let factor = (-middle).exp();
        let text = format!(
            "its Gaussians are {factor:.3} times as far away as the dataset's depth ({id}): use `scale={}`, or \
             `depth=privileged` if each source has its own unit",
            rounded(scale / factor)
        );
        (Some(factor), text)
    })
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
        let said =
            |seen: fn(f32) -> f32| depth_doubt(&truth, &map(seen), 1.0, "s").map(|found| found.1);
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
}
