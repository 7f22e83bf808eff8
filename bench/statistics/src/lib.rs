//! Inference on paired differences when pairs within a cluster depend on each other.
//!
//! The input is pure numbers: paired scores of two sides, with the cluster of each pair (for pictures, the physical
//! scene that they show), grouped by dataset. The result is a mean difference with its 95 % interval, a p value, the
//! smallest difference that could have been detected, and a verdict. Independent of metrics and datasets.
//!
//! # The rule
//! The sample consists of clusters, never of pairs: the number of clusters and how much their sizes differ determine
//! the method. The mean of one dataset is over its pairs; that of several datasets is the mean of their means.
//!
//! | sample | interval and p |
//! |---|---|
//! | one dataset of 30 [effective clusters](Clusters::effective_clusters) or more | BCa bootstrap over clusters and sign flips: the union of the two intervals, the larger p |
//! | any other | Student's t of the mean over the standard error CV3 of the cluster jackknife |
//! | every cluster of a dataset differs by the same amount | sign flips: p = 2/2^G for G clusters, no bounds if that is above 0.05 |
//! | a dataset with one cluster, or a difference that is not finite | none |
//!
//! p and interval never contradict each other: p is below 0.05 if and only if the interval excludes zero, because
//! either both are computed from one statistic, or each is the more conservative of the same two.
//!
//! * **CV3.** MacKinnon, Nielsen and Webb ("Fast and reliable jackknife and bootstrap methods for cluster-robust
//!   inference", Journal of Applied Econometrics 38, 2023; "Cluster-robust inference: a guide to empirical practice",
//!   Journal of Econometrics 232, 2023) recommend this standard error if clusters are few or unequal. They compare it
//!   with t(G − 1), which is exact for clusters of equal size; for unequal ones it rejects too often, and
//!   Satterthwaite's degrees of freedom (Bell and McCaffrey, Survey Methodology 28, 2002) too rarely if one cluster
//!   dominates. Here degrees of freedom are fitted to the statistic's exact distribution, see [`Jackknife`]. For
//!   several datasets, variances add up, with Satterthwaite's degrees of freedom.
//! * **BCa.** Efron, "Better bootstrap confidence intervals", JASA 82, 1987. Alone it is too narrow for few clusters,
//!   by about G/(G − 1) in variance, so it is not used there.
//! * **Sign flips.** Exact if clusters deviate from the true mean symmetrically, whatever their sizes; the restricted
//!   wild cluster bootstrap of Cameron, Gelbach and Miller ("Bootstrap-based improvements for inference with clustered
//!   errors", Review of Economics and Statistics 90, 2008) with Rademacher weights is the same test of a mean,
//!   studentised. Up to 14 clusters all patterns are enumerated. With few clusters it is reported next to the t test,
//!   with its floor: with seven clusters its p is never below 2/2⁷ = 0.0156, and with five or fewer never below 0.05. A
//!   t test's p below that floor relies on cluster means being about normal. One cluster alone can never make a
//!   difference significant: moving it raises the standard error by as much.
//! * **Several datasets** always use the t test, because sign flips would treat differences between datasets as noise.
//!
//! `reports/statistics.md` has the error rates of these procedures in simulations.
//!
//! # Special cases
//! | input | answer |
//! |---|---|
//! | all pairs equal | mean 0, p 1, interval 0..0, verdict none, even with one cluster |
//! | ties | they are differences of zero, and count |
//! | both scores infinite, of one sign | a difference of zero |
//! | one score infinite | mean infinite, no interval, no p: nothing is left out silently |
//! | NaN | mean NaN, no interval, no p |
//! | a pair that is missing on one side | not part of the sample: the caller leaves it out and counts it |
//! | one pair, one scene | the mean, no interval, no p |
//!
//! # Random numbers
//! Resample k of seed s uses its own `sharp::random::SplitMix64` generator, seeded with `mix(s ^ mix(2k))` for the
//! bootstrap and `mix(s ^ mix(2k + 1))` for signs; `mix` is its finaliser. Results are bit-identical for any number of
//! threads, and record the seed and the number of resamples.

mod bootstrap;
mod clusters;
mod decision;
pub mod distributions;
mod inference;
mod jackknife;
mod numeric;
mod resampling;
mod sign_flip;

pub use bootstrap::Bootstrap;
pub use clusters::Clusters;
pub use decision::{Verdict, holm, verdict};
pub use inference::{ALPHA, Inference, MANY_CLUSTERS, NoInference, POWER, Procedure, infer};
pub use jackknife::Jackknife;
pub use numeric::{mean, sample_std};
pub use resampling::Resampling;
pub use sign_flip::SignFlip;
