//! The cluster jackknife: how much the mean of a dataset changes if each of its clusters is left
//! out in turn.

use std::f64::consts::FRAC_PI_2;

use crate::clusters::{Cluster, Clusters};
use crate::distributions::t_two_sided;
use crate::numeric::{integrate, root};

/// Variance of a dataset's mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jackknife {
    /// The estimator CV3: (G − 1)/G Σ (mean without cluster g − mean)², for G clusters.
    pub variance: f64,
    /// Degrees of freedom of the t distribution that mean / √variance is compared with.
    ///
    /// G − 1 for clusters of equal size. For unequal sizes, they are chosen so that Student's t has
    /// the same critical value at the 5 % level as the exact statistic for normal cluster means.
    /// That statistic depends on the variances of the clusters. The degrees of freedom are computed
    /// twice, with equal variances and with estimated variances, which are unreliable for few
    /// clusters; the smaller result is used.
    pub degrees_of_freedom: f64,
}

impl Jackknife {
    /// Computes the variance and degrees of freedom of the mean difference of `sample`, which must have at least two
    /// clusters and only finite scores.
    pub fn new(sample: &Clusters) -> Self {
        let n_clusters = sample.n_clusters() as f64;
        let all = sample.n_pairs() as f64;
        let moves = sample.clusters().iter().zip(sample.residuals());
        let squares: f64 = moves
            .map(|(cluster, residual)| (residual / (all - cluster.pairs)).powi(2))
            .sum();
        Self {
            variance: (n_clusters - 1.0) / n_clusters * squares,
            degrees_of_freedom: degrees_of_freedom(sample),
        }
    }
}

/// The level at which Student's distribution is fitted to the exact distribution.
const FITTED_AT: f64 = 0.05;

/// Computes [`Jackknife::degrees_of_freedom`].
fn degrees_of_freedom(sample: &Clusters) -> f64 {
    let clusters = sample.clusters();
    let equal = clusters.len() as f64 - 1.0;
    if clusters.iter().all(|c| c.pairs == clusters[0].pairs) {
        return equal;
    }
    let fitted = |variances: &[f64]| {
        let statistic = Statistic::new(sample, variances);
        // For large arguments, the tail for many clusters underflows to zero.
        let tail = |log: f64| statistic.two_sided(log.exp()).max(f64::MIN_POSITIVE);
        let excess = |log: f64| tail(log).ln() - FITTED_AT.ln();
        let critical = root(-2.0, 8.0, excess).exp();
        let tail = |log: f64| t_two_sided(critical, log.exp()).max(f64::MIN_POSITIVE);
        let excess = |log: f64| tail(log).ln() - FITTED_AT.ln();
        // With one large cluster among many, the critical value may be below the normal
        // distribution's; the result is then the upper bound `MAX_DEGREES`.
        root(-2.0, MAX_DEGREES.ln(), excess).exp()
    };
    fitted(&vec![1.0; clusters.len()]).min(fitted(&estimated_variances(sample)))
}

/// Degrees of freedom from which Student's distribution is treated as normal.
const MAX_DEGREES: f64 = 1e6;

/// Variances of the clusters' means: the variance between clusters plus the variance between pairs
/// divided by the cluster's number of pairs n, both estimated by the analysis of variance of
/// unweighted means. All variances are 1 if both estimates are zero.
fn estimated_variances(sample: &Clusters) -> Vec<f64> {
    let clusters = sample.clusters();
    let n = clusters.len() as f64;
    let sum_within = clusters
        .iter()
        .map(|c| (c.squares - c.sum * c.sum / c.pairs).max(0.0));
    // Sizes are unequal, so some cluster has more than one pair.
    let within = sum_within.sum::<f64>() / (sample.n_pairs() as f64 - n);
    let means = || clusters.iter().map(|c| c.sum / c.pairs);
    let centre = means().sum::<f64>() / n;
    let of_means = means().map(|m| (m - centre).powi(2)).sum::<f64>() / (n - 1.0);
    let inverse = clusters.iter().map(|c| 1.0 / c.pairs).sum::<f64>() / n;
    let between = (of_means - within * inverse).max(0.0);
    let largest = between + within;
    let relative = |pairs: f64| (between + within / pairs) / largest;
    clusters
        .iter()
        .map(|c| {
            if largest > 0.0 {
                relative(c.pairs)
            } else {
                1.0
            }
        })
        .collect()
}

/// The exact distribution of t = mean / √CV3, for independent normal means x of clusters with weights w and variances v.
///
/// With residuals e = x − w·x, CV3 is Σ d e² with d = (G − 1)/G (w / (1 − w))². So |t| > c means that the quadratic
/// form x'Cx = c² Σ d e² − (w·x)² is negative. With V = diag(v), VC has one negative eigenvalue −ν; all others, μ, are
/// positive. Given the rest of x, its component along the negative eigenvector is a normal variable that must be large
/// enough. Craig's integral for the tail of a normal ("A new, simple and exact result for calculating the probability
/// of error for two-dimensional signal constellations", IEEE MILCOM 1991) averages over the rest: P = 2/π ∫ Π (1 + μ/(ν
/// sin²φ))^−½ dφ over 0..π/2. The product is the determinant of I + VC/(ν sin²φ) without its factor 1 − 1/sin²φ.
struct Statistic {
    /// Weight w, variance v and d of each cluster.
    clusters: Vec<[f64; 3]>,
}

impl Statistic {
    fn new(sample: &Clusters, variances: &[f64]) -> Self {
        let n = sample.n_clusters() as f64;
        let of_cluster = |(cluster, &v): (&Cluster, &f64)| {
            let w = cluster.pairs / sample.n_pairs() as f64;
            [w, v, (n - 1.0) / n * (w / (1.0 - w)).powi(2)]
        };
        let clusters = sample.clusters().iter().zip(variances);
        Self {
            clusters: clusters.map(of_cluster).collect(),
        }
    }

    /// The determinant of I + τVC, as the logarithm of a positive factor, and a second factor with
    /// the determinant's sign. VC is diagonal plus rank two, so the matrix determinant lemma
    /// reduces it to sums over clusters.
    fn determinant(&self, tau: f64, c: f64) -> (f64, f64) {
        let (mut log, mut w_kept, mut w2_kept, mut d_kept) = (0.0, 0.0, 0.0, 0.0);
        for [w, v, d] in &self.clusters {
            let scaled = tau * c * c * d;
            let kept = 1.0 / (1.0 + scaled * v);
            log += (scaled * v).ln_1p();
            w_kept += w * kept;
            w2_kept += w * w * v * kept;
            d_kept += scaled * kept;
        }
        (log, w_kept * w_kept + w2_kept * (d_kept - tau))
    }

    /// P(|t| > c), to nine digits.
    fn two_sided(&self, c: f64) -> f64 {
        // 1/ν, the only τ > 0 where the determinant vanishes, is at least one over the variance of the mean.
        let start = -self
            .clusters
            .iter()
            .map(|[w, v, _]| w * w * v)
            .sum::<f64>()
            .ln();
        let sign = |log: f64| self.determinant(log.exp(), c).1;
        let zero = root(start - 1.0, start + 60.0, sign).exp();
        let product = |phi: f64| {
            // At sin φ = 1 the determinant and its factor both vanish, so take the quotient of the
            // two slightly off that point.
            let s = (1.0 / phi.sin().powi(2)).max(1.0 + 1e-7);
            let (log, rest) = self.determinant(s * zero, c);
            (-0.5 * log).exp() / (rest / (1.0 - s)).sqrt()
        };
        integrate(FRAC_PI_2, product) / FRAC_PI_2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All pairs of a cluster have the same difference, so only the clusters' means vary.
    fn constant(sizes: &[usize]) -> Clusters {
        let pairs = sizes.iter().enumerate().flat_map(|(cluster, size)| {
            let mean = [3.0, 1.0, 4.0, 1.5, 9.0][cluster % 5];
            (0..*size).map(move |_| (cluster, [0.0, mean]))
        });
        Clusters::new(pairs)
    }

    #[test]
    fn variance_by_hand() {
        let pairs = [(0, 8.0), (1, 1.5), (1, 1.5), (2, 1.0), (2, 1.0)];
        let sample = Clusters::new(pairs.map(|(cluster, d)| (cluster, [1.0, 1.0 + d])));
        // The mean is 13/5, and without one cluster 5/4, 10/3, 11/3.
        let moves = [5.0 / 4.0 - 2.6, 10.0 / 3.0 - 2.6, 11.0 / 3.0 - 2.6];
        let expected = 2.0 / 3.0 * moves.iter().map(|m: &f64| m * m).sum::<f64>();
        assert!((Jackknife::new(&sample).variance - expected).abs() < 1e-12);
    }

    #[test]
    fn degrees_of_freedom_of_clusters_of_any_sizes() {
        assert_eq!(Jackknife::new(&constant(&[70; 7])).degrees_of_freedom, 6.0);
        // Computed from the eigenvalues of the quadratic form with numpy and scipy.
        let unequal: [(&[usize], f64); 3] = [
            (&[1, 3], 1.0491559832049073),
            (&[10, 20, 40, 80], 2.1049011497173105),
            (
                &[4, 8, 10, 12, 15, 18, 20, 22, 25, 30, 36, 40, 60],
                7.499314967404127,
            ),
        ];
        for (sizes, degrees) in unequal {
            let ours = Jackknife::new(&constant(sizes)).degrees_of_freedom;
            assert!((ours / degrees - 1.0).abs() < 1e-7, "{ours} for {degrees}");
        }
    }

    #[test]
    fn many_clusters_of_unequal_sizes_have_many_degrees_of_freedom() {
        // Two in three clusters have one pair, the others have two. The degrees of freedom are
        // close to the effective number of clusters, (Σn)² / Σn², minus one.
        for clusters in [139, 200, 1000, 5000] {
            let sizes: Vec<usize> = (0..clusters).map(|k| 1 + usize::from(k % 3 == 0)).collect();
            let sample = constant(&sizes);
            let (ours, near) = (
                Jackknife::new(&sample).degrees_of_freedom,
                sample.effective_clusters() - 1.0,
            );
            assert!((0.5..2.0).contains(&(ours / near)), "{ours} for {near}");
            let found = crate::infer(&[&sample], crate::Resampling::default()).unwrap();
            assert!(found.detectable() > 0.0 && found.p < 0.05, "{found:?}");
        }
    }
}
