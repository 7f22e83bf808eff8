//! The BCa bootstrap of a mean over clusters.

use rayon::prelude::*;

use crate::clusters::Clusters;
use crate::distributions::{normal_quantile, normal_tail};
use crate::numeric::root;
use crate::resampling::Resampling;

/// Means of resampled clusters, corrected for bias and acceleration (Efron, "Better bootstrap confidence intervals",
/// JASA 1987). Each resample draws as many whole clusters as there are, with replacement.
#[derive(Debug, Clone, PartialEq)]
pub struct Bootstrap {
    means: Vec<f64>,
    /// Efron's z₀: the normal quantile of the share of means below the observed one; ties count half.
    pub bias: f64,
    /// Efron's a, from the leave-one-cluster-out means.
    pub acceleration: f64,
}

impl Bootstrap {
    /// Resamples the clusters of `sample`, which must have at least two clusters and only finite
    /// scores.
    pub fn new(sample: &Clusters, resampling: Resampling) -> Self {
        let clusters = sample.clusters();
        let drawn = resampling.indices().into_par_iter().map(|k| {
            let (mut sum, mut pairs) = (0.0, 0.0);
            for index in resampling.drawn(k, clusters.len()) {
                sum += clusters[index].sum;
                pairs += clusters[index].pairs;
            }
            sum / pairs
        });
        let mut means: Vec<f64> = drawn.collect();
        means.sort_unstable_by(f64::total_cmp);
        // Equal means from different draws may be rounded differently.
        let (observed, rounding) = (sample.mean(), sample.rounding() / sample.n_pairs() as f64);
        let below = means.partition_point(|m| *m < observed - rounding);
        let not_above = means.partition_point(|m| *m <= observed + rounding);
        // Keep at least half a mean on either side, so that the quantile is finite.
        let twice = (below + not_above).clamp(1, 2 * means.len() - 1);
        let share = twice as f64 / (2 * means.len()) as f64;
        Self {
            bias: normal_quantile(share),
            acceleration: acceleration(sample),
            means,
        }
    }

    /// Means of the resamples, ascending.
    pub fn means(&self) -> &[f64] {
        &self.means
    }

    /// Confidence interval at level 1 − `alpha`.
    pub fn interval(&self, alpha: f64) -> (f64, f64) {
        let z = normal_quantile(0.5 * alpha);
        (self.end(z), self.end(-z))
    }

    /// The smallest level at which the interval excludes zero; 0 if all resampled means have the same sign.
    pub fn p(&self) -> f64 {
        const FARTHEST: f64 = 37.0;
        let centre = self.end(0.0);
        if centre == 0.0 {
            return 1.0;
        }
        let side = -centre.signum();
        if self.end(side * FARTHEST) * side < 0.0 {
            return 0.0;
        }
        2.0 * normal_tail(root(0.0, FARTHEST, |z| self.end(side * z)))
    }

    /// The end of an interval that corresponds to the normal quantile `z`.
    fn end(&self, z: f64) -> f64 {
        let shifted = self.bias + z;
        let stretch = 1.0 - self.acceleration * shifted;
        // Beyond the correction's pole, the share is 0 or 1.
        let share = if stretch <= 0.0 {
            if shifted > 0.0 { 1.0 } else { 0.0 }
        } else {
            normal_tail(-(self.bias + shifted / stretch))
        };
        let place = share * (self.means.len() - 1) as f64;
        let below = place.floor() as usize;
        let above = (below + 1).min(self.means.len() - 1);
        let (low, high) = (self.means[below], self.means[above]);
        low + (high - low) * (place - below as f64)
    }
}

/// Σ l³ / (6 (Σ l²)^1.5), where l is the decrease of the mean if a cluster is left out.
fn acceleration(sample: &Clusters) -> f64 {
    let all = sample.n_pairs() as f64;
    let without = sample
        .clusters()
        .iter()
        .map(|c| (sample.sum() - c.sum) / (all - c.pairs));
    let without: Vec<f64> = without.collect();
    let centre = without.iter().sum::<f64>() / without.len() as f64;
    let power = |k| without.iter().map(|m| (centre - m).powi(k)).sum::<f64>();
    let squares = power(2);
    if squares > 0.0 {
        power(3) / (6.0 * squares.powf(1.5))
    } else {
        0.0
    }
}
