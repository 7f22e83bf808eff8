//! A generator simple enough to be reimplemented in any language, so that anyone can verify a published selection.

/// splitmix64 (Steele, Lea, Flood: "Fast splittable pseudorandom number generators", 2014).
#[derive(Debug, Clone)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        mix(self.state)
    }

    /// A uniform random number in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * unit(self.next_u64())
    }

    /// Uniform in `0..n`, n > 0: the first draw `r ≥ 2⁶⁴ mod n`, taken modulo n, which avoids bias.
    pub fn below(&mut self, n: u64) -> u64 {
        let surplus = (u64::MAX % n + 1) % n;
        loop {
            let r = self.next_u64();
            if r >= surplus {
                return r % n;
            }
        }
    }

    /// Fisher–Yates from the front: position i receives a uniform choice among positions i and later. The first k
    /// entries are thus a uniform sample of size k.
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in 0..items.len() {
            let left = items.len() - i;
            items.swap(i, i + self.below(left as u64) as usize);
        }
    }
}

/// splitmix64's finaliser: every input bit affects every output bit.
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// The top 53 bits as a number in 0..1.
pub fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_outputs_of_seed_zero() {
        // The generator's published test values.
        let mut g = SplitMix64::new(0);
        assert_eq!(g.next_u64(), 0xE220_A839_7B1D_CDAF);
        assert_eq!(g.next_u64(), 0x6E78_9E6A_A1B9_65F4);
        assert_eq!(g.next_u64(), 0x06C4_5D18_8009_454F);
    }

    #[test]
    fn a_shuffle_is_a_permutation_and_stays_what_it_was() {
        let mut items: Vec<u32> = (0..10).collect();
        SplitMix64::new(0).shuffle(&mut items);
        // Computed by an independent Python implementation of the documented rule.
        assert_eq!(items, [5, 1, 9, 7, 0, 4, 3, 2, 6, 8]);
        items.sort_unstable();
        assert_eq!(items, (0..10).collect::<Vec<_>>());
    }

    #[test]
    fn every_permutation_of_three_is_equally_frequent() {
        let mut counts = std::collections::BTreeMap::new();
        let mut g = SplitMix64::new(7);
        for _ in 0..60_000 {
            let mut items = [0, 1, 2];
            g.shuffle(&mut items);
            *counts.entry(items).or_insert(0_u32) += 1;
        }
        assert_eq!(counts.len(), 6);
        // Six standard deviations of a binomial with p = 1/6.
        for (order, n) in counts {
            assert!(n.abs_diff(10_000) < 550, "{order:?}: {n}");
        }
    }
}
