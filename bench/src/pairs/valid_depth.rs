//! Valid values of a depth map, their median and density.

use sharp_datasets::DepthMap;

/// Whether a depth is valid: finite and positive.
pub fn is_valid_depth(depth: f32) -> bool {
    depth > 0.0 && depth < f32::INFINITY
}

/// Share of a map's valid pixels whose right neighbour is valid, too, 0..1. Pixels without a right neighbour do not
/// count; 1 if no other pixels are valid. It is near 1 for an object in front of an empty background, and about the
/// share of valid pixels for scattered points.
pub fn density(depth: &DepthMap) -> f64 {
    let width = depth.width().max(1) as usize;
    let rows = depth.as_raw().chunks_exact(width);
    let couples = rows.flat_map(|row| row.windows(2));
    let (mut valid, mut both) = (0_usize, 0_usize);
    for couple in couples.filter(|couple| is_valid_depth(couple[0])) {
        valid += 1;
        both += usize::from(is_valid_depth(couple[1]));
    }
    match valid {
        0 => 1.0,
        _ => both as f64 / valid as f64,
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
    fn scattered_depth_is_told_from_a_dense_object() {
        let values = vec![0.0, 4.0, 2.0, 1.0, f32::INFINITY, 3.0, f32::NAN, 1.0];
        let depth = DepthMap::from_vec(4, 2, values).unwrap();
        assert_eq!(density(&depth), 2.0 / 3.0);
        assert_eq!(density(&DepthMap::new(0, 0)), 1.0);
        let object = DepthMap::from_fn(100, 50, |x, y| {
            image::Luma([f32::from(u8::from((40..60).contains(&x) && y > 20))])
        });
        assert!(density(&object) > 0.9);
        // A pseudo-random third of the pixels, selected by the bits of a product.
        let points = DepthMap::from_fn(100, 50, |x, y| {
            let hash = (x + 101 * y).wrapping_mul(2_654_435_761) >> 16;
            image::Luma([f32::from(u8::from(hash % 5 == 0))])
        });
        assert!(density(&points) < 0.3);
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
