//! Comparison of a rectified pair's disparities with the places at which the pictures match best.

use super::small_view::{Grey, Sample};

/// Radius of the compared blocks, in reduced pixels.
const RADIUS: u32 = 3;
/// Maximum number of blocks examined; of these, only blocks with enough contrast are compared.
const MAX_BLOCKS: usize = 1500;
/// Minimum standard deviation of a block's levels; blocks with less contrast are not compared.
const MIN_CONTRAST: f32 = 8.0;
/// A block's best match confirms its disparity if the two are at most this far apart, in reduced pixels.
const MAX_OFF: f64 = 1.0;
/// A pair is judged only if at least this many blocks were compared.
const MIN_BLOCKS: usize = 200;
/// A pair is reported if less than this fraction of its blocks match best at their disparity. The
/// fraction is 0.4 to 0.9 in consistent pairs, even with different exposures, and below 0.2 with
/// another scene's disparities.
const MIN_NEAR: f64 = 0.3;
/// Two pictures count as showing the same scene if the median correlation of their best matches is at least this.
const MIN_RELATED: f32 = 0.8;
/// Replaces [`MIN_NEAR`] for pairs that do not reach [`MIN_RELATED`]: blocks of unrelated pictures
/// match equally well anywhere.
const MIN_NEAR_OF_UNRELATED: f64 = 0.12;

/// Differences of a block's levels from their mean, and their Euclidean norm. `None` if the block
/// extends beyond the picture or contains a masked pixel.
fn block(picture: &Grey, x: i64, y: i64) -> Option<(Vec<f32>, f32)> {
    let (width, height) = picture.size();
    let fits = |at: i64, side: u32| at >= i64::from(RADIUS) && at + i64::from(RADIUS) < side.into();
    if !fits(x, width) || !fits(y, height) {
        return None;
    }
    let (x, y) = (x as u32, y as u32);
    let rows = y - RADIUS..=y + RADIUS;
    let levels = rows.flat_map(|v| (x - RADIUS..=x + RADIUS).map(move |u| picture.at(u, v)));
    let mut levels: Vec<f32> = levels.collect();
    let mean = levels.iter().sum::<f32>() / levels.len() as f32;
    levels.iter_mut().for_each(|level| *level -= mean);
    let length = levels.iter().map(|v| v * v).sum::<f32>().sqrt();
    length.is_finite().then_some((levels, length))
}

/// Reports a contradiction if the pictures do not match at the disparities. `samples` hold disparities in place
/// of depth.
pub(super) fn mismatch(left: &Grey, right: &Grey, samples: &[Sample]) -> Option<String> {
    let mut disparities: Vec<f64> = samples.iter().map(|sample| sample.depth).collect();
    disparities.sort_by(f64::total_cmp);
    let [low, high] = [1, 99].map(|percent| disparities.get(disparities.len() * percent / 100));
    let width = i64::from(left.size().0);
    let (low, high) = (low?.floor() as i64 - 8, high?.ceil() as i64 + 8);
    let (low, high) = (low.max(-width), high.min(width));
    let (mut near, mut best) = (0, Vec::new());
    for sample in samples.iter().step_by(samples.len().div_ceil(MAX_BLOCKS)) {
        let (x, y) = (i64::from(sample.x), i64::from(sample.y));
        let Some((own, length)) = block(left, x, y) else {
            continue;
        };
        // A disparity that leads outside the right picture cannot match.
        let is_inside = block(right, x - sample.depth.round() as i64, y).is_some();
        if length < MIN_CONTRAST * (own.len() as f32).sqrt() || !is_inside {
            continue;
        }
        let matches = (low..=high).filter_map(|d| {
            let (other, size) = block(right, x - d, y)?;
            let product: f32 = own.iter().zip(&other).map(|(a, b)| a * b).sum();
            Some((product / (length * size.max(1e-3)), d))
        });
        if let Some((related, d)) = matches.max_by(|a, b| a.0.total_cmp(&b.0)) {
            near += usize::from((d as f64 - sample.depth).abs() <= MAX_OFF);
            best.push(related);
        }
    }
    best.sort_by(f32::total_cmp);
    let share = near as f64 / best.len().max(1) as f64;
    let is_pair = *best.get(best.len() / 2)? >= MIN_RELATED;
    let (least, what, cause) = if is_pair {
        (
            MIN_NEAR,
            "the pictures match each other, but not at the disparities",
            "perhaps the disparity map belongs to another scene or to other pictures",
        )
    } else {
        (
            MIN_NEAR_OF_UNRELATED,
            "the pictures do not seem to show the same scene",
            "perhaps the right picture is from another pair",
        )
    };
    (best.len() >= MIN_BLOCKS && share < least).then(|| {
        format!(
            "{what}: only {:.0} % of {} blocks match best at their disparity (40 % or more is usual); {cause}; if so, \
             replace it with this pair's own",
            100.0 * share,
            best.len()
        )
    })
}
