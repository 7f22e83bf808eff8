//! The position on the axis beyond which a quantity is above zero, with a confidence interval.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sharp_statistics::Resampling;

use sharp_plots::bins::{Bin, Cuts, bins};

/// The position beyond which the mean of every bin is above zero.
///
/// It lies between the last bin whose mean is not above zero and the next bin that is not empty, where the line through
/// their means crosses zero. If empty bins separate the two, no line joins them, and the position is that of the later
/// bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// The position; −∞ if the means of all bins are above zero, ∞ if the mean of the last bin is not.
    pub x: f64,
    /// 95 % interval of the position over resamples. Each resample draws as many whole clusters as there are, with
    /// replacement. The ends of the interval may be infinite. `None` for fewer than two clusters.
    pub interval: Option<(f64, f64)>,
    pub clusters: usize,
}

/// The value of the quantity for one pair, at the pair's position `x` on the horizontal axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<'a> {
    pub x: f64,
    pub value: f64,
    /// The pair's cluster; samples of one cluster are not independent.
    pub cluster: &'a str,
}

impl Crossing {
    /// Finds the crossing of samples in the bins of `cuts`; `None` if all bins are empty.
    pub fn of(samples: &[Sample<'_>], cuts: &Cuts, resampling: Resampling) -> Option<Self> {
        let values: Vec<(f64, f64)> = samples.iter().map(|s| (s.x, s.value)).collect();
        let bins = bins(&values, cuts);
        if bins.is_empty() {
            return None;
        }
        let means: Vec<Option<f64>> = bins.iter().map(|bin| Some(bin.mean)).collect();
        // Sum and count by cluster and bin.
        let mut sums: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
        for (k, bin) in bins.iter().enumerate() {
            for sample in bin.members.iter().map(|i| &samples[*i]) {
                let row = sums.entry(sample.cluster);
                let (sum, n) = &mut row.or_insert_with(|| vec![(0.0, 0.0); bins.len()])[k];
                *sum += sample.value;
                *n += 1.0;
            }
        }
        let clusters: Vec<&Vec<(f64, f64)>> = sums.values().collect();
        let interval = (clusters.len() > 1).then(|| {
            let places = (0..resampling.count.get()).into_par_iter().map(|k| {
                let mut all = vec![(0.0, 0.0); bins.len()];
                for cluster in resampling.drawn(k, clusters.len()) {
                    for (total, part) in all.iter_mut().zip(clusters[cluster]) {
                        *total = (total.0 + part.0, total.1 + part.1);
                    }
                }
                let means = all.iter().map(|(sum, n)| (*n > 0.0).then(|| sum / n));
                place(&bins, &means.collect::<Vec<_>>())
            });
            middle(places.collect())
        });
        Some(Self {
            x: place(&bins, &means),
            interval,
            clusters: clusters.len(),
        })
    }
}

/// Computes [`Crossing::x`]; bins without a mean count as empty.
fn place(bins: &[Bin], means: &[Option<f64>]) -> f64 {
    let known = bins.iter().zip(means);
    let known: Vec<(&Bin, f64)> = known
        .filter_map(|(bin, mean)| Some((bin, (*mean)?)))
        .collect();
    let Some(last) = known.iter().rposition(|(_, mean)| *mean <= 0.0) else {
        return f64::NEG_INFINITY;
    };
    let Some((next, above)) = known.get(last + 1) else {
        return f64::INFINITY;
    };
    let (before, below) = &known[last];
    let share = -below / (above - below);
    if before.number.checked_add(1) == Some(next.number) && share.is_finite() {
        before.x + (next.x - before.x) * share
    } else {
        next.x
    }
}

/// The bounds of the middle 95 % of the positions, by nearest rank.
fn middle(mut places: Vec<f64>) -> (f64, f64) {
    places.sort_unstable_by(f64::total_cmp);
    let beyond = (0.025 * places.len() as f64).floor() as usize;
    (places[beyond], places[places.len() - 1 - beyond])
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU32;

    use super::*;
    use sharp_plots::bins::Binning;

    const RESAMPLING: Resampling = Resampling {
        seed: 0,
        count: NonZeroU32::new(400).unwrap(),
    };

    fn cuts() -> Cuts {
        "1".parse::<Binning>().unwrap().cuts([], None)
    }

    fn of(samples: &[(f64, f64)]) -> f64 {
        let samples = samples.iter().map(|(x, value)| Sample {
            x: *x,
            value: *value,
            cluster: "a",
        });
        let found = Crossing::of(&samples.collect::<Vec<_>>(), &cuts(), RESAMPLING).unwrap();
        assert_eq!((found.interval, found.clusters), (None, 1));
        found.x
    }

    #[test]
    fn the_line_between_neighbouring_bins_crosses_zero() {
        // From −1 at 0.5 to 3 at 1.5: crosses zero a quarter of the way.
        assert_eq!(of(&[(0.5, -1.0), (1.5, 3.0), (2.5, 9.0)]), 0.75);
        // Above zero twice: the crossing is where it stays above.
        assert_eq!(of(&[(0.5, -1.0), (1.5, 3.0), (2.5, -1.0), (3.5, 1.0)]), 3.0);
        assert_eq!(of(&[(0.5, 0.0), (1.5, 1.0)]), 0.5);
    }

    #[test]
    fn ends_gaps_and_infinities() {
        assert_eq!(of(&[(0.5, 1.0), (1.5, 2.0)]), f64::NEG_INFINITY);
        assert_eq!(of(&[(0.5, 1.0), (1.5, -2.0)]), f64::INFINITY);
        // No line is drawn across the empty bin from 1 to 2.
        assert_eq!(of(&[(0.5, -1.0), (2.5, 1.0)]), 2.5);
        assert_eq!(of(&[(0.5, -1.0), (1.5, f64::INFINITY)]), 0.5);
        assert_eq!(of(&[(0.5, f64::NEG_INFINITY), (1.5, 1.0)]), 1.5);
        assert_eq!(Crossing::of(&[], &cuts(), RESAMPLING), None);
    }

    #[test]
    fn the_interval_is_that_of_clusters_and_not_of_pairs() {
        // Ten equal pairs in each of two clusters; one crosses at 0.75, the other never.
        let cluster = |name, far: f64| {
            let both = [(0.5, -1.0), (1.5, far)];
            both.map(|(x, value)| Sample {
                x,
                value,
                cluster: name,
            })
        };
        let samples: Vec<Sample<'_>> = (0..10)
            .flat_map(|_| [cluster("a", 3.0), cluster("b", -1.0)].concat())
            .collect();
        let found = Crossing::of(&samples, &cuts(), RESAMPLING).unwrap();
        // Together the means are −1 and 1. A quarter of the resamples contains a twice, another quarter b twice.
        assert_eq!(found.x, 1.0);
        assert_eq!(found.interval, Some((0.75, f64::INFINITY)));
        assert_eq!(found, Crossing::of(&samples, &cuts(), RESAMPLING).unwrap());
    }
}
