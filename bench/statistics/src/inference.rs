//! Chooses and applies the inference method for a sample.

use thiserror::Error;

use crate::bootstrap::Bootstrap;
use crate::clusters::Clusters;
use crate::distributions::{detectable_shift, t_critical, t_two_sided};
use crate::jackknife::Jackknife;
use crate::resampling::Resampling;
use crate::sign_flip::SignFlip;

/// Significance level of every test; intervals are at 1 − `ALPHA`.
pub const ALPHA: f64 = 0.05;
/// The power at which a difference counts as detectable.
pub const POWER: f64 = 0.8;
/// Minimum number of effective clusters for computing the p-value and the interval of a single dataset by resampling.
pub const MANY_CLUSTERS: f64 = 30.0;

/// How the interval and p were computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Procedure {
    /// Student's t of the mean over the cluster jackknife's standard error.
    Jackknife,
    /// The more conservative of BCa bootstrap and sign flips.
    Resampled(Resampling),
    /// Sign flips alone, used if all clusters differ by the same amount.
    SignFlips,
}

/// The mean difference with its interval and p.
#[derive(Debug, Clone, PartialEq)]
pub struct Inference {
    /// The mean of the datasets' means.
    pub mean: f64,
    /// 95 % confidence interval; an unbounded end is infinite.
    pub interval: (f64, f64),
    /// Two-sided p for the hypothesis that the mean is zero. p is below 0.05 if and only if the
    /// interval excludes zero.
    pub p: f64,
    /// Standard error by the cluster jackknife, for every procedure; 0 if all clusters differ by the same amount.
    pub standard_error: f64,
    /// Degrees of freedom of the standard error; NaN if the standard error is 0.
    pub degrees_of_freedom: f64,
    pub n_pairs: usize,
    pub n_clusters: usize,
    pub procedure: Procedure,
    /// The sign-flip test, which does not assume a normal distribution. It is shown next to the p
    /// of a single dataset, together with the smallest p that it can give. `None` for several
    /// datasets, because the test would treat the differences between them as noise.
    pub sign_flip: Option<SignFlip>,
}

/// Why there is neither an interval nor a p value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum NoInference {
    #[error("no pairs")]
    NoPairs,
    #[error("a difference is not finite")]
    NotFinite,
    #[error("a single cluster shows no spread between clusters")]
    OneCluster,
    #[error(
        "within each dataset, all clusters have the same difference, and the datasets' differences have \
         opposite signs"
    )]
    NoSpread,
}

/// The mean of the datasets' mean differences, each dataset with equal weight, with its interval
/// and p, by the rule in the [crate's documentation](crate).
pub fn infer(datasets: &[&Clusters], resampling: Resampling) -> Result<Inference, NoInference> {
    if datasets.is_empty() || datasets.iter().any(|d| d.n_pairs() == 0) {
        return Err(NoInference::NoPairs);
    }
    if !datasets.iter().all(|d| d.mean().is_finite()) {
        return Err(NoInference::NotFinite);
    }
    let all_equal = datasets.iter().all(|d| d.all_equal());
    if !all_equal && datasets.iter().any(|d| d.n_clusters() < 2) {
        return Err(NoInference::OneCluster);
    }
    let mean = datasets.iter().map(|d| d.mean()).sum::<f64>() / datasets.len() as f64;
    let sign_flip = match datasets {
        [dataset] => Some(SignFlip::new(dataset, resampling)),
        _ => None,
    };
    let mut inference = Inference {
        mean,
        interval: (mean, mean),
        p: 1.0,
        procedure: Procedure::SignFlips,
        standard_error: 0.0,
        degrees_of_freedom: f64::NAN,
        n_pairs: datasets.iter().map(|d| d.n_pairs()).sum(),
        n_clusters: datasets.iter().map(|d| d.n_clusters()).sum(),
        sign_flip,
    };
    if datasets.iter().all(|d| d.without_spread()) {
        inference.p = p_without_spread(datasets)?;
        if inference.p >= ALPHA && !all_equal {
            inference.interval = (f64::NEG_INFINITY, f64::INFINITY);
        }
        return Ok(inference);
    }
    let (error, degrees_of_freedom) = standard_error(datasets);
    inference.standard_error = error;
    inference.degrees_of_freedom = degrees_of_freedom;
    if let ([dataset], Some(flips)) = (datasets, &inference.sign_flip)
        && dataset.effective_clusters() >= MANY_CLUSTERS
    {
        let bootstrap = Bootstrap::new(dataset, resampling);
        let (a, b) = (bootstrap.interval(ALPHA), flips.interval(ALPHA));
        inference.procedure = Procedure::Resampled(resampling);
        inference.interval = (a.0.min(b.0), a.1.max(b.1));
        inference.p = bootstrap.p().max(flips.p);
    } else {
        let reach = error * t_critical(ALPHA, degrees_of_freedom);
        inference.procedure = Procedure::Jackknife;
        inference.interval = (mean - reach, mean + reach);
        inference.p = t_two_sided(mean.abs() / error, degrees_of_freedom);
    }
    Ok(inference)
}

impl Inference {
    /// The smallest true mean that a t test at the 5 % level detects with 80 % power, given the observed spread between
    /// clusters; NaN without a spread.
    pub fn detectable(&self) -> f64 {
        if self.standard_error > 0.0 {
            self.standard_error * detectable_shift(POWER, ALPHA, self.degrees_of_freedom)
        } else {
            f64::NAN
        }
    }
}

/// Standard error of the mean of the datasets' means, and its degrees of freedom. Variances of independent estimates add
/// up; degrees of freedom combine by Satterthwaite's rule (Biometrics Bulletin 2, 1946).
fn standard_error(datasets: &[&Clusters]) -> (f64, f64) {
    let number = datasets.len() as f64;
    let jackknives: Vec<_> = datasets.iter().map(|d| Jackknife::new(d)).collect();
    let variance: f64 = jackknives.iter().map(|j| j.variance).sum();
    let of_variance = jackknives
        .iter()
        .map(|j| j.variance.powi(2) / j.degrees_of_freedom);
    let degrees_of_freedom = variance.powi(2) / of_variance.sum::<f64>();
    (variance.sqrt() / number, degrees_of_freedom)
}

/// The sign-flip p if all clusters of a dataset have the same difference. A mean as far from zero as the observed one
/// occurs only if either every sign is kept or every sign is flipped.
fn p_without_spread(datasets: &[&Clusters]) -> Result<f64, NoInference> {
    let moved = || datasets.iter().filter(|d| !d.all_equal());
    if moved().any(|d| d.mean() > 0.0) && moved().any(|d| d.mean() < 0.0) {
        return Err(NoInference::NoSpread);
    }
    let clusters: usize = moved().map(|d| d.n_clusters()).sum();
    Ok(0.5_f64.powf(clusters as f64 - 1.0).min(1.0))
}
