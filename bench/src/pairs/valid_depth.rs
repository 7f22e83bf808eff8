//! Valid values of a depth map, their median and share.

use sharp_datasets::DepthMap;

/// Whether a depth is valid: finite and positive.
pub fn is_valid_depth(depth: f32) -> bool {
    depth > 0.0 && depth < f32::INFINITY
}

/// Share of a map's pixels that have valid depth, 0..1; 0 for an empty map.
pub fn coverage(depth: &DepthMap) -> f64 {
    let pixels = depth.as_raw().len();
    let valid = depth.iter().filter(|d| is_valid_depth(**d)).count();
    if pixels == 0 {
        0.0
    } else {
        valid as f64 / pixels as f64
    }
}

/// The median; for an even count, the mean of the two middle values; `None` if empty.
pub(crate) fn median_of<T: Copy + Into<f64>>(mut values: Vec<T>) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    let even = values.len().is_multiple_of(2);
    let order = |a: &T, b: &T| (*a).into().total_cmp(&(*b).into());
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, order);
    let upper = upper.into();
    if !even {
        return Some(upper);
    }
    let lower = below.iter().copied().max_by(order)?.into();
    Some(0.5 * (lower + upper))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_finite_positive_depth_is_valid() {
        assert!(is_valid_depth(1e-6));
        for bad in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!is_valid_depth(bad), "{bad}");
        }
    }

    #[test]
    fn coverage_counts_valid_pixels() {
        let values = vec![0.0, 4.0, f32::INFINITY, f32::NAN];
        let depth = DepthMap::from_vec(2, 2, values).unwrap();
        assert_eq!(coverage(&depth), 0.25);
        assert_eq!(coverage(&DepthMap::new(0, 0)), 0.0);
    }

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!(median_of::<f64>(vec![]), None);
        assert_eq!(median_of(vec![3.0]), Some(3.0));
        assert_eq!(median_of(vec![3.0, 1.0]), Some(2.0));
        assert_eq!(median_of(vec![9.0_f32, 1.0, 2.0]), Some(2.0));
        assert_eq!(median_of(vec![9.0, 2.0, 1.0, 4.0]), Some(3.0));
    }
}
