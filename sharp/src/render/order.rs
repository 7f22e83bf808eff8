//! Pass `order`: front to back by the depth of the centres, ties by ascending index.
//!
//! Keys are unique because they end in the index, so an unstable sort has one possible result.

/// Sorts keys made by [`super::emit::key`].
pub(super) fn order(pairs: &mut [u64]) {
    pairs.sort_unstable();
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
