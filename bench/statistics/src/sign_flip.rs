//! The sign-flip permutation test of a mean, and its confidence interval.

use rayon::prelude::*;

use crate::clusters::Clusters;
use crate::resampling::Resampling;

/// Maximum number of clusters whose sign patterns are enumerated rather than sampled. A pattern and its negative give the
/// same statistic, so at most 2¹³ patterns are computed.
pub(crate) const MAX_ENUMERATED: usize = 14;

/// Sign-flip test of the clusters' differences. The test is exact if each cluster's sum of
/// (difference − true mean) is as likely as the negated sum, whatever the clusters' sizes and
/// spreads (Fisher 1935). For means that are not symmetric, see Romano, "On the behavior of
/// randomization tests without a group invariance assumption", JASA 1990.
#[derive(Debug, Clone, PartialEq)]
pub struct SignFlip {
    /// Share of sign patterns whose mean is at least as far from zero as the observed mean: among
    /// all patterns if all are enumerated, else among the drawn patterns and the observed one.
    pub p: f64,
    /// The smallest possible `p` for this number of clusters: 2/2^G if patterns are enumerated, so no test with fewer
    /// than six clusters is significant at 5 %.
    pub floor: f64,
    /// How patterns were drawn; `None` if all were enumerated.
    pub resampling: Option<Resampling>,
    /// For each pattern, the lowest true mean under which the pattern's mean is at least as far from
    /// its expectation as the observed mean; sorted.
    lows: Vec<f64>,
    /// For each pattern, the highest true mean under which the pattern's mean is at least as far from its expectation
    /// as the observed mean; sorted.
    highs: Vec<f64>,
}

impl SignFlip {
    /// Tests the clusters of `sample`, which must have at least one cluster and only finite scores.
    pub fn new(sample: &Clusters, resampling: Resampling) -> Self {
        let n = sample.n_clusters();
        let enumerated = n <= MAX_ENUMERATED;
        // The observed pattern is consistent with any mean.
        let observed = (f64::NEG_INFINITY, f64::INFINITY);
        let ranges: Vec<(f64, f64)> = if enumerated {
            // A pattern and its opposite are equivalent, so the last cluster keeps its sign.
            (0..1_u64 << (n - 1))
                .map(|pattern| range(sample, || pattern))
                .collect()
        } else {
            let drawn = resampling.indices().into_par_iter().map(|k| {
                let mut random = resampling.stream(2 * u64::from(k) + 1);
                range(sample, || random.next_u64())
            });
            let mut all: Vec<_> = if sample.all_equal() {
                // All flips have the same result, so do not draw any: comparing two identical runs
                // is common and should be quick.
                vec![(0.0, 0.0); resampling.count.get() as usize]
            } else {
                drawn.collect()
            };
            all.push(observed);
            all
        };
        let total = ranges.len() as f64;
        let as_far = ranges
            .iter()
            .filter(|(low, high)| *low <= 0.0 && *high >= 0.0);
        let p = as_far.count() as f64 / total;
        let (mut lows, mut highs): (Vec<f64>, Vec<f64>) = ranges.into_iter().unzip();
        lows.sort_unstable_by(f64::total_cmp);
        highs.sort_unstable_by(f64::total_cmp);
        Self {
            p,
            floor: 1.0 / total,
            resampling: (!enumerated).then_some(resampling),
            lows,
            highs,
        }
    }

    /// The confidence interval: from the lowest to the highest true mean that the test does not reject at level `alpha`. It
    /// contains zero if and only if `p` ≥ `alpha`, and is infinite if `alpha` is not above the floor.
    pub fn interval(&self, alpha: f64) -> (f64, f64) {
        let total = self.highs.len();
        // A mean is inside the interval if at least this many patterns are consistent with it.
        let needed = (alpha * total as f64 - 1e-9).ceil().max(1.0) as usize;
        (self.lows[needed - 1], self.highs[total - needed])
    }
}

/// The true means δ under which a pattern of signs is at least as far from its expectation as the
/// observed pattern: |Σ ±(s − δn)| ≥ |Σ (s − δn)| over clusters of sum s and size n. These means
/// lie between the mean of the clusters that keep their sign and the mean of the clusters that do
/// not (Hartigan's "typical values", JASA 1969). Each call of `signs` returns 64 signs.
fn range(sample: &Clusters, mut signs: impl FnMut() -> u64) -> (f64, f64) {
    let (mut sum, mut pairs) = (0.0, 0.0);
    for clusters in sample.clusters().chunks(64) {
        let bits = signs();
        for (k, cluster) in clusters.iter().enumerate() {
            let flip = ((bits >> k) & 1) << 63;
            sum += f64::from_bits(cluster.sum.to_bits() ^ flip);
            pairs += f64::from_bits(cluster.pairs.to_bits() ^ flip);
        }
    }
    let (all_sum, all_pairs) = (sample.sum(), sample.n_pairs() as f64);
    // Counts are integers, so their sums are exact.
    if pairs.abs() == all_pairs {
        return (f64::NEG_INFINITY, f64::INFINITY);
    }
    let mean = |sum: f64, pairs: f64| {
        if sum.abs() <= sample.rounding() {
            0.0
        } else {
            sum / pairs
        }
    };
    let kept = mean(all_sum + sum, all_pairs + pairs);
    let flipped = mean(all_sum - sum, all_pairs - pairs);
    (kept.min(flipped), kept.max(flipped))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(sizes: &[usize], seed: u64) -> Clusters {
        let mut random = sharp::random::SplitMix64::new(seed);
        let shift = random.between(-0.4, 0.4);
        let each = sizes.iter().enumerate();
        let pairs = each.flat_map(|(cluster, size)| (0..*size).map(move |_| cluster));
        Clusters::new(pairs.map(|cluster| (cluster, [0.0, shift + random.between(-1.0, 1.0)])))
    }

    /// Share of all patterns whose deviation from `mean` is at least as large as the observed one, computed from the
    /// definition.
    fn share(sample: &Clusters, mean: f64) -> f64 {
        let deviations: Vec<f64> = sample
            .clusters()
            .iter()
            .map(|c| c.sum - mean * c.pairs)
            .collect();
        let observed = deviations.iter().sum::<f64>().abs() - 1e-9;
        let patterns = 1_u32 << deviations.len();
        let as_far = (0..patterns).filter(|pattern| {
            let signed = deviations.iter().enumerate();
            let sum: f64 = signed
                .map(|(k, d)| if (pattern >> k) & 1 == 1 { -d } else { *d })
                .sum();
            sum.abs() >= observed
        });
        as_far.count() as f64 / f64::from(patterns)
    }

    #[test]
    fn enumerated_p_and_interval_are_those_of_the_definition() {
        for seed in 0..40 {
            let sample = sample(&[3, 1, 4, 1, 5, 9, 2, 6], seed);
            let flips = SignFlip::new(&sample, Resampling::default());
            assert_eq!(flips.p, share(&sample, 0.0));
            for (alpha, step) in [(0.05, 1e-6), (0.05, -1e-6), (0.3, 1e-6), (0.3, -1e-6)] {
                let (low, high) = flips.interval(alpha);
                assert_eq!(share(&sample, low - step) < alpha, step > 0.0);
                assert_eq!(share(&sample, high + step) < alpha, step > 0.0);
            }
        }
    }

    #[test]
    fn the_floor_is_reached_where_all_clusters_agree() {
        for (n, floor) in [
            (1, 1.0),
            (5, 0.0625),
            (7, 0.015625),
            (14, 2.0_f64.powi(-13)),
        ] {
            let sample = Clusters::new((0..n).map(|k| (k, [0.0, 1.0 + f64::from(k)])));
            let flips = SignFlip::new(&sample, Resampling::default());
            assert_eq!(
                (flips.p, flips.floor, flips.resampling),
                (floor, floor, None)
            );
            assert_eq!(flips.interval(0.05).0.is_finite(), floor < 0.05);
        }
    }

    #[test]
    fn drawn_patterns_agree_with_all_of_them() {
        for seed in 0..8 {
            let sample = sample(&[2, 3, 1, 4, 2, 3, 1, 4, 2, 3, 1, 4, 2, 3, 1, 4], seed);
            let flips = SignFlip::new(&sample, Resampling::default());
            assert_eq!(flips.resampling, Some(Resampling::default()));
            assert_eq!(flips.floor, 1.0 / 10_001.0);
            // Five standard deviations of a share of 10 000.
            let exact = share(&sample, 0.0);
            let allowed = 5.0 * (exact * (1.0 - exact) / 1e4).sqrt() + 1e-4;
            assert!((flips.p - exact).abs() < allowed, "{} for {exact}", flips.p);
        }
    }
}
