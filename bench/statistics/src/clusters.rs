//! Scores of two sides as differences summed by cluster.

use std::collections::BTreeMap;

/// Sums over one cluster, a group of pairs that are not independent.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Cluster {
    /// Sum of the differences.
    pub(crate) sum: f64,
    /// Sum of the squared differences.
    pub(crate) squares: f64,
    /// Number of pairs, an integer.
    pub(crate) pairs: f64,
}

/// The scores of one dataset's pairs on side A and on side B, by cluster; differences are B − A.
///
/// A pair without a score on both sides must be left out, and should be counted in the output. Equal scores have a
/// difference of zero, even if infinite (the PSNR of identical pictures). A score that is infinite on only one side
/// makes the mean infinite; NaN makes it NaN.
#[derive(Debug, Clone, PartialEq)]
pub struct Clusters {
    clusters: Vec<Cluster>,
    n_pairs: usize,
    n_infinite: usize,
    all_equal: bool,
    /// Sums of A, of B, and of their differences.
    sums: [f64; 3],
    /// The largest finite magnitude of a score.
    largest: f64,
}

impl Clusters {
    /// Builds the sums from pairs, each with its cluster and its scores `[a, b]`. The order of
    /// pairs affects only rounding.
    pub fn new<K: Ord>(pairs: impl IntoIterator<Item = (K, [f64; 2])>) -> Self {
        let mut by_key: BTreeMap<K, Cluster> = BTreeMap::new();
        let mut all = Self {
            clusters: Vec::new(),
            n_pairs: 0,
            n_infinite: 0,
            all_equal: true,
            sums: [0.0; 3],
            largest: 0.0,
        };
        for (key, [a, b]) in pairs {
            let difference = if a == b { 0.0 } else { b - a };
            let cluster = by_key.entry(key).or_default();
            cluster.sum += difference;
            cluster.squares += difference * difference;
            cluster.pairs += 1.0;
            all.n_pairs += 1;
            all.n_infinite += usize::from(a.is_infinite() || b.is_infinite());
            all.all_equal &= difference == 0.0;
            all.sums[0] += a;
            all.sums[1] += b;
            let finite = [a, b].into_iter().filter(|value| value.is_finite());
            all.largest = finite.fold(all.largest, |largest, value| largest.max(value.abs()));
        }
        all.clusters.extend(by_key.into_values());
        all.sums[2] = all.clusters.iter().map(|cluster| cluster.sum).sum();
        all
    }

    /// Mean difference over pairs; NaN without pairs.
    pub fn mean(&self) -> f64 {
        self.sums[2] / self.n_pairs as f64
    }

    /// Mean of side A over pairs.
    pub fn mean_a(&self) -> f64 {
        self.sums[0] / self.n_pairs as f64
    }

    /// Mean of side B over pairs.
    pub fn mean_b(&self) -> f64 {
        self.sums[1] / self.n_pairs as f64
    }

    pub fn n_pairs(&self) -> usize {
        self.n_pairs
    }

    pub fn n_clusters(&self) -> usize {
        self.clusters.len()
    }

    /// Pairs with an infinite score on either side.
    pub fn n_infinite(&self) -> usize {
        self.n_infinite
    }

    /// True if all differences are zero or there are no differences.
    pub fn all_equal(&self) -> bool {
        self.all_equal
    }

    /// The number of clusters of equal size that would contain as much information: (Σn)² / Σn² for clusters of n
    /// pairs. This is the effective number of Carter, Schnepel and Steigerwald ("Asymptotic behavior of a t-test robust
    /// to cluster heterogeneity", Review of Economics and Statistics, 2017) for a mean over pairs whose differences are
    /// equal within each cluster.
    pub fn effective_clusters(&self) -> f64 {
        let squares: f64 = self.clusters.iter().map(|c| c.pairs * c.pairs).sum();
        (self.n_pairs as f64).powi(2) / squares
    }

    pub(crate) fn clusters(&self) -> &[Cluster] {
        &self.clusters
    }

    /// Sum of all differences.
    pub(crate) fn sum(&self) -> f64 {
        self.sums[2]
    }

    /// Upper bound on the rounding error of a sum of differences that is exactly zero.
    pub(crate) fn rounding(&self) -> f64 {
        1e-13 * self.largest * self.n_pairs as f64
    }

    /// Residual of each cluster: Σ (difference − mean).
    pub(crate) fn residuals(&self) -> impl Iterator<Item = f64> {
        let mean = self.mean();
        self.clusters.iter().map(move |c| c.sum - mean * c.pairs)
    }

    /// Whether all clusters have the same mean up to rounding, so that their spread cannot be estimated.
    pub(crate) fn without_spread(&self) -> bool {
        self.residuals().all(|r| r.abs() <= self.rounding())
    }
}
