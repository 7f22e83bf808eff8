//! Chooses the best of several scales, as the paper does for methods without metric scale (LVSM,
//! SVC).
//!
//! "For each pair, we apply a linear scale sweep to find the best scale that minimizes the DISTS
//! score": the method renders each pair at several scales of the scene, and the picture closest to
//! the target under DISTS is scored. Because this choice uses the target, reports mention the
//! choice next to the numbers.

use sharp_metrics::{MetricKey, Picture, Scorer, ScorerOptions, Selection, Weights, WeightsError};

use super::ground_truth::{GroundTruth, PairMasks};
use super::metrics::Scoring;
use super::region::Region;

/// Chooses among pictures at several scales.
#[derive(Debug)]
pub struct ScaleChooser {
    scorer: Scorer,
    identity: String,
}

impl ScaleChooser {
    /// The paper's chooser: DISTS. `None` if the weights of the DISTS network are missing.
    ///
    /// # Errors
    /// If a weights file cannot be read or has the wrong content.
    pub fn dists(weights: &Weights, options: ScorerOptions) -> Result<Option<Self>, WeightsError> {
        let selection = Selection::of(&[MetricKey::DISTS]);
        let scoring = Scoring::with_options(&selection, weights, options)?;
        if scoring.scorer.missing_weights().next().is_some() {
            return Ok(None);
        }
        let identity = scoring.metrics.iter().map(|metric| {
            let weights = metric.info.backbone.as_ref().map(ToString::to_string);
            format!("{} {}", metric.key, weights.unwrap_or_default())
        });
        let identity = identity.collect();
        Ok(Some(Self {
            scorer: scoring.scorer,
            identity,
        }))
    }

    /// Metric and weights used for choosing; part of a method's identity.
    pub fn identity(&self) -> &str {
        &self.identity
    }

    /// Index of the best picture. Each candidate is a scale, a picture and the part of the target
    /// that the picture covers; ties go to the first. Errors name neither file nor pair.
    pub(crate) fn best(
        &self,
        truth: &GroundTruth,
        candidates: &[(f64, &Picture, Option<Region>)],
    ) -> Result<usize, String> {
        let pictures: Vec<_> = candidates
            .iter()
            .map(|(_, p, region)| (*p, *region))
            .collect();
        let mut best: Option<(f64, usize)> = None;
        let scores = truth.score(&self.scorer, &pictures, &PairMasks::default());
        for (at, (scores, (scale, ..))) in scores.into_iter().zip(candidates).enumerate() {
            let wrong = |reason: String| format!("scale {scale}: {reason}");
            let distance = match scores.map_err(wrong)?.into_iter().next() {
                Some((_, Ok(value))) if !value.is_nan() => value,
                Some((key, Ok(_))) => return Err(wrong(format!("{key} is not a number"))),
                Some((key, Err(reason))) => return Err(wrong(format!("{key}: {reason}"))),
                None => return Err(wrong("no metric is available to choose by".to_owned())),
            };
            if best.is_none_or(|(least, _)| distance < least) {
                best = Some((distance, at));
            }
        }
        let (_, at) = best.ok_or("no scale was given")?;
        Ok(at)
    }
}
