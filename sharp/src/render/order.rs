//! Pass `order`: front to back by the depth of the centres, ties by ascending index.
//!
//! Keys are unique because they end in the index, so an unstable sort has one possible result.

/// Sorts keys made by [`super::emit::key`].
pub(super) fn order(pairs: &mut [u64]) {
    pairs.sort_unstable();
}

/// The indices of all depths, front to back; a GPU that takes its order from the host gets these.
/// Where those that are not drawn end up does not matter, they have no pixels.
#[cfg(feature = "gpu")]
pub(super) fn indices(depths: &[f32]) -> Vec<u32> {
    use rayon::prelude::*;
    let mut keys: Vec<u64> = depths
        .par_iter()
        .enumerate()
        .map(|(index, z)| super::emit::key(*z, index as u32))
        .collect();
    keys.par_sort_unstable();
    keys.into_par_iter().map(|key| key as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::super::emit::key;
    use super::order;

    #[test]
    fn depth_decides_then_index() {
        let next = |z: f32| f32::from_bits(z.to_bits() + 1);
        let mut keys = [
            key(next(2.0), 0),
            key(2.0, 7),
            key(0.01, 9),
            key(2.0, 3),
            key(1e10, 1),
        ];
        order(&mut keys);
        assert_eq!(keys.map(|k| k as u32), [9, 3, 7, 0, 1]);
    }
}
