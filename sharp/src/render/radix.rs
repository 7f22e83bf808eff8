//! Pass `radix`: sorts front to back by the depth of the centres, ties by ascending index.
//!
//! A stable radix sort, least significant digit first, 8 bits per pass, of keys that are initially in index order.

const DIGITS: usize = 256;
/// Number of 8-bit digits of the depth, the upper half of a key. The lower half, the index, is already sorted.
const PASSES: usize = 4;

fn digit(key: u64, pass: usize) -> usize {
    (key >> (32 + 8 * pass)) as usize % DIGITS
}

/// Sorts keys made by [`super::emit::key`] by depth; keys of equal depth keep their order. `scratch` is reusable
/// memory.
pub(super) fn sort(keys: &mut Vec<u64>, scratch: &mut Vec<u64>) {
    let mut histograms = [[0_u32; DIGITS]; PASSES];
    for key in &*keys {
        for (pass, histogram) in histograms.iter_mut().enumerate() {
            histogram[digit(*key, pass)] += 1;
        }
    }
    scratch.resize(keys.len(), 0);
    for (pass, places) in histograms.iter_mut().enumerate() {
        // Similar depths share their upper digits, so passes without effect are skipped.
        let Some(first) = keys.first() else { return };
        if places[digit(*first, pass)] as usize == keys.len() {
            continue;
        }
        let mut next = 0;
        for place in places.iter_mut() {
            (*place, next) = (next, next + *place);
        }
        for key in &*keys {
            let place = &mut places[digit(*key, pass)];
            scratch[*place as usize] = *key;
            *place += 1;
        }
        std::mem::swap(keys, scratch);
    }
}

#[cfg(test)]
mod tests {
    use super::super::emit::key;
    use super::sort;

    #[test]
    fn depth_decides_then_index() {
        let next = |z: f32| f32::from_bits(z.to_bits() + 1);
        let mut keys = vec![
            key(next(2.0), 0),
            key(1e10, 1),
            key(2.0, 3),
            key(2.0, 7),
            key(0.01, 9),
        ];
        sort(&mut keys, &mut Vec::new());
        let order: Vec<u32> = keys.iter().map(|k| *k as u32).collect();
        assert_eq!(order, [9, 3, 7, 0, 1]);
    }

    #[test]
    fn any_number_of_any_keys() {
        let mut scratch = Vec::new();
        let mut random = 1_u64;
        for count in [0, 1, 2, 255, 256, 4097] {
            let mut keys: Vec<u64> = (0..count)
                .map(|index| {
                    random = random
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1);
                    // Every third depth is one of a few, so that there are ties.
                    let bits = (random >> 33) as u32;
                    let z = f32::from_bits(if index % 3 == 0 { bits % 5 } else { bits });
                    key(z, index)
                })
                .collect();
            let mut expected = keys.clone();
            expected.sort_by_key(|key| key >> 32);
            sort(&mut keys, &mut scratch);
            assert_eq!(keys, expected);
        }
    }
}
