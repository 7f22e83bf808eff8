//! The global scale from predicted to ground-truth depth (the paper's equation `eq:global_scale`):
//! `s = median over p of gt(p) / pred(p)`; the adjusted depth is `s · pred`.

use image::Luma;
use rayon::prelude::*;
use sharp_datasets::DepthMap;

use super::PairError;
use super::valid_depth::{is_valid_depth, median_of};

/// A scale, and the number of pixels that it was computed from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MedianScale {
    pub scale: f64,
    /// Number of pixels at which both depths are valid.
    pub pixels: usize,
}

/// The median of `ground_truth / prediction` over the pixels at which both are finite and positive.
///
/// This is the median of ratios, not the ratio of medians. For an even count, it is the mean of the two middle ratios.
/// If the sizes differ, the prediction is sampled bilinearly at the ground truth's pixel centres; the ground truth,
/// which may be sparse, is never resampled.
///
/// # Errors
/// [`PairError::NoValidDepth`] if no pixel qualifies.
pub fn median_scale(
    ground_truth: &DepthMap,
    prediction: &DepthMap,
) -> Result<MedianScale, PairError> {
    let (width, height) = ground_truth.dimensions();
    let (pred_width, pred_height) = prediction.dimensions();
    let same_size = (width, height) == (pred_width, pred_height);
    let (sx, sy) = (
        f64::from(pred_width) / f64::from(width),
        f64::from(pred_height) / f64::from(height),
    );
    let ratio_at = |x: u32, y: u32| -> Option<f64> {
        let Luma([gt]) = *ground_truth.get_pixel(x, y);
        if !is_valid_depth(gt) {
            return None;
        }
        let pred = if same_size {
            let Luma([pred]) = *prediction.get_pixel(x, y);
            is_valid_depth(pred).then(|| f64::from(pred))?
        } else {
            sample(
                prediction,
                (f64::from(x) + 0.5) * sx,
                (f64::from(y) + 0.5) * sy,
            )?
        };
        Some(f64::from(gt) / pred)
    };
    let ratios: Vec<f64> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| (0..width).filter_map(move |x| ratio_at(x, y)))
        .collect();
    let pixels = ratios.len();
    let scale = median_of(ratios).ok_or(PairError::NoValidDepth {
        a: (width, height),
        b: (pred_width, pred_height),
    })?;
    Ok(MedianScale { scale, pixels })
}

/// Bilinear sample at continuous coordinates, with the border repeated; `None` if a contributing pixel is invalid.
fn sample(map: &DepthMap, u: f64, v: f64) -> Option<f64> {
    let (width, height) = map.dimensions();
    if width == 0 || height == 0 {
        return None;
    }
    let taps = |at: f64, n: u32| {
        let at = (at - 0.5).clamp(0.0, f64::from(n - 1));
        let first = at.floor() as u32;
        let share = at - f64::from(first);
        [(first, 1.0 - share), ((first + 1).min(n - 1), share)]
    };
    let mut sum = 0.0;
    for (y, wy) in taps(v, height) {
        for (x, wx) in taps(u, width) {
            let weight = wx * wy;
            if weight > 0.0 {
                let Luma([depth]) = *map.get_pixel(x, y);
                if !is_valid_depth(depth) {
                    return None;
                }
                sum += weight * f64::from(depth);
            }
        }
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(width: u32, height: u32, values: &[f32]) -> DepthMap {
        DepthMap::from_vec(width, height, values.to_vec()).unwrap()
    }

    #[test]
    fn a_prediction_of_another_size_is_sampled_at_the_ground_truths_centres() {
        // A plane in x. The prediction's row of 4 pixels has its centres at 1, 3, 5, 7 of 8; the ground truth's 8
        // centres are at 0.5, 1.5, …
        let prediction = map(4, 1, &[1.0, 3.0, 5.0, 7.0]);
        // Inside, bilinear samples lie on the plane, so the ratio is exactly 2. The ground truth is
        // sparse: it has no depth at the other pixels.
        let gt = map(8, 1, &[0.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, f32::NAN]);
        let found = median_scale(&gt, &prediction).unwrap();
        assert_eq!(
            found,
            MedianScale {
                scale: 2.0,
                pixels: 6
            }
        );
        // At the border the outermost sample is repeated: 2 / 1 and 14 / 7.
        let border = map(8, 1, &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 14.0]);
        assert_eq!(median_scale(&border, &prediction).unwrap().scale, 2.0);
    }

    #[test]
    fn an_invalid_neighbour_spoils_a_sample() {
        let prediction = map(2, 1, &[0.0, 5.0]);
        let gt = map(4, 1, &[1.0, 1.0, 1.0, 10.0]);
        let found = median_scale(&gt, &prediction).unwrap();
        assert_eq!((found.scale, found.pixels), (2.0, 1));
    }

    #[test]
    fn no_valid_pixel_is_an_error_that_names_the_sizes() {
        let error = median_scale(&map(1, 2, &[1.0, 0.0]), &map(1, 2, &[0.0, 1.0])).unwrap_err();
        assert_eq!(
            error.to_string(),
            "no pixel has a valid depth in both maps (1x2 and 1x2)"
        );
        assert!(median_scale(&map(1, 1, &[1.0]), &DepthMap::new(0, 0)).is_err());
    }
}
