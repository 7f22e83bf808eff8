//! Detection of depth maps whose far values exceeded 16 bits and start again at 0.

use super::Effort;
use crate::View;
use crate::format::FloatMap;
use crate::view::evenly_spaced;

/// Number of 16-bit values.
const WRAP: f64 = 65536.0;
/// Minimum difference between adjacent values that may be due to an overflow.
const MIN_JUMP: f64 = WRAP / 2.0;
/// Approximate relative tolerance for a surface to continue across a jump. The value after the jump, with the lost bit
/// restored, is compared with the value extrapolated from those before the jump.
const NEAR: f64 = 0.01;
/// A map counts as overflowed only if the surface continues across at least this many jumps.
const MIN_SEAMS: usize = 16;
/// A map counts as overflowed only if the surface continues across at least this fraction of all jumps.
const MIN_SHARE: f64 = 0.15;

/// A sentence on the first of a few views whose depth map overflowed. Files that cannot be read are reported elsewhere.
pub(super) fn overflowed(views: &[View], effort: Effort) -> Option<String> {
    let few = evenly_spaced(views.len(), effort.pairs).into_iter();
    let mut stored = few.filter_map(|i| views[i].content.stored_depth().ok().flatten());
    let (file, _) = stored.find(|(_, map)| has_seams(map))?;
    Some(format!(
        "{}: the depth overflowed 16 bits (surfaces that reach {} continue at 0); store it in a coarser unit or as float",
        file.display(),
        u16::MAX
    ))
}

/// True if surfaces that exceed 16 bits continue at 0. At the edge of an object, restoring the lost bit would not make
/// the surface continue.
fn has_seams(map: &FloatMap) -> bool {
    let is_of_16_bits = |v: &f32| (0.0..WRAP as f32).contains(v) && v.fract() == 0.0;
    if !map.iter().any(|v| f64::from(*v) > (1.0 - NEAR) * WRAP) || !map.iter().all(is_of_16_bits) {
        return false;
    }
    let (w, h) = (map.width() as usize, map.height() as usize);
    let (mut jumps, mut seams) = (0, 0);
    let mut look = |four: [usize; 4]| {
        let four = four.map(|i| f64::from(map.as_raw()[i]));
        for [before, high, low, after] in [four, [four[3], four[2], four[1], four[0]]] {
            let is_jump = high - low > MIN_JUMP && low > 0.0;
            let is_smooth = (before - high).abs() < MIN_JUMP && (after - low).abs() < MIN_JUMP;
            // A repeated value may stand for the sky.
            if is_jump && is_smooth && before > 0.0 && after > 0.0 && before != high {
                jumps += 1;
                seams += usize::from(continues(before, high, low + WRAP));
            }
        }
    };
    for y in 0..h {
        (3..w).for_each(|x| look([0, 1, 2, 3].map(|i| y * w + x - i)));
    }
    for y in 3..h {
        (0..w).for_each(|x| look([0, 1, 2, 3].map(|i| (y - i) * w + x)));
    }
    seams >= MIN_SEAMS && seams as f64 >= MIN_SHARE * f64::from(jumps)
}

/// True if a value continues the two before it: on a plane, the reciprocal of depth changes in equal steps.
fn continues(first: f64, second: f64, third: f64) -> bool {
    let expected = 1.0 / (2.0 / second - 1.0 / first);
    let tolerance = NEAR * second + 0.5 * (expected - second).abs();
    expected > 0.0 && (third - expected).abs() <= tolerance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::tests::views_of;
    use crate::synthetic::SyntheticOptions;

    /// A view's depth map, rounded to integers. The unit is chosen so that a fraction `within` of the positive values fits
    /// in 16 bits.
    fn stored(view: &View, within: f64) -> FloatMap {
        let mut map = view.content.depth().unwrap().unwrap();
        let mut values: Vec<f32> = map.iter().copied().filter(|z| *z > 0.0).collect();
        values.sort_by(f32::total_cmp);
        let most = values[((values.len() - 1) as f64 * within) as usize];
        let unit = f64::from(most) / (WRAP - 2.0);
        let number = |z: &f32| (f64::from(*z) / unit).round() as f32;
        map.iter_mut().for_each(|z| *z = number(z));
        map
    }

    /// Clamped values, and a sky beyond everything else, are not reported.
    #[test]
    fn surfaces_that_continue_at_zero_are_told_from_edges() {
        let mut wrapped = 0;
        for seed in 0..24 {
            let (width, height) = (160, 120);
            let varied = SyntheticOptions::varied(seed);
            let options = SyntheticOptions {
                width,
                height,
                views: 2,
                ..varied
            };
            let view = &views_of(options)[0];
            assert!(!has_seams(&stored(view, 1.0)), "{seed}");
            for within in [0.5, 0.8] {
                let map = stored(view, within);
                let mut clamped = map.clone();
                clamped.iter_mut().for_each(|v| *v = v.min(65534.0));
                assert!(!has_seams(&clamped), "{seed} {within}");
                let mut over = map;
                over.iter_mut().for_each(|v| *v %= WRAP as f32);
                wrapped += usize::from(has_seams(&over));
            }
        }
        assert!(wrapped >= 44, "{wrapped} of 48");
    }
}
