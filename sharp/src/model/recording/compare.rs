//! Stage-by-stage comparison of a network with a recording.

use std::collections::BTreeSet;

use super::file::{RecordedValues, Recording};
use super::observe;
use crate::model::observer::{StageObserver, StageValue};
use crate::model::predictor::{Planes, Predictor};
use crate::model::{ModelError, config::LAYERS};

/// Difference between one stage and its recording.
#[derive(Debug, Clone, PartialEq)]
pub struct StageComparison {
    /// Stage name in the recording.
    pub stage: String,
    /// Largest absolute difference divided by the stage's absmax; infinite if a value is not finite or the shapes
    /// differ.
    pub rel_error: f64,
    pub values: usize,
    /// Reason that the stage was not compared; `None` if it was compared.
    pub note: Option<String>,
}

/// All stages of a recording: first the stages that were computed, in order of computation; then
/// the remaining stages, with an infinite error.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecordingComparison {
    pub stages: Vec<StageComparison>,
}

impl RecordingComparison {
    /// The first stage, in order of computation, whose error exceeds `tolerance`.
    pub fn first_divergence(&self, tolerance: f64) -> Option<&StageComparison> {
        // Not `> tolerance`, so that NaN counts as divergence.
        let within = |s: &&StageComparison| s.rel_error <= tolerance;
        self.stages.iter().find(|s| !within(s))
    }

    /// True if every recorded stage was computed with an error of at most `tolerance`.
    pub fn passes(&self, tolerance: f64) -> bool {
        self.first_divergence(tolerance).is_none()
    }
}

/// A stage that is not compared: quaternions in world space, whose signs depend on how covariances were decomposed.
/// Their covariances are compared instead.
const GAUGE: &str = "world.quaternions";
/// The recording's known depth, an input of the alignment network rather than an output.
const KNOWN_DEPTH: &str = "alignment.gt_depth";

/// Predicts from `image` and compares every stage recorded under `prefix`. If the recording
/// contains stages of the alignment network, that network is run on the recording's own known
/// depth.
///
/// # Errors
/// [`ModelError`] of the prediction, or if the recording is inconsistent or has no such prefix.
pub fn compare(
    predictor: &Predictor,
    image: Planes<'_>,
    focal_px: f64,
    recording: &Recording,
    prefix: &str,
) -> Result<RecordingComparison, ModelError> {
    let pending = recording.stages(prefix).into_iter();
    let pending: BTreeSet<String> = pending
        .filter(|s| ![GAUGE, KNOWN_DEPTH].contains(s))
        .map(str::to_owned)
        .collect();
    if pending.is_empty() {
        return Err(recording.error(format!(
            "no stages under prefix {prefix}; available: {}",
            recording.prefixes().join(", ")
        )));
    }
    let mut comparer = Comparer {
        recording,
        prefix,
        pending,
        stages: Vec::new(),
    };
    let prediction = observe(predictor, image, focal_px, &mut comparer)?;
    if recording.stages(prefix).contains(&KNOWN_DEPTH) {
        let known = recording.stage(prefix, KNOWN_DEPTH)?;
        if let RecordedValues::Whole(known) = known.values
            && LAYERS * known.len() == prediction.depth.len()
        {
            let factors = predictor.alignment_map(&prediction.depth, &known)?;
            let side = prediction.resolution;
            let shape = [1, 1, side, side];
            comparer.stage("alignment.map", StageValue::host(&shape, &factors))?;
        }
    }
    let Comparer {
        mut stages,
        pending,
        ..
    } = comparer;
    stages.extend(pending.into_iter().map(|stage| StageComparison {
        stage,
        rel_error: f64::INFINITY,
        values: 0,
        note: Some("recorded, not computed".to_owned()),
    }));
    Ok(RecordingComparison { stages })
}

struct Comparer<'a> {
    recording: &'a Recording,
    prefix: &'a str,
    pending: BTreeSet<String>,
    stages: Vec<StageComparison>,
}

impl StageObserver for Comparer<'_> {
    fn stage(&mut self, name: &str, value: StageValue<'_>) -> Result<(), ModelError> {
        if !self.pending.remove(name) {
            return Ok(());
        }
        let recorded = self.recording.stage(self.prefix, name)?;
        let mut result = StageComparison {
            stage: name.to_owned(),
            rel_error: f64::INFINITY,
            values: 0,
            note: None,
        };
        let shape = value.shape()?;
        if recorded.shape == shape {
            let found = value.to_vec()?;
            let difference = match &recorded.values {
                RecordedValues::Whole(expected) => {
                    largest_difference(found.iter().zip(expected).map(|(a, b)| (*a, *b)))
                }
                RecordedValues::Sampled(indices, expected) => {
                    let pairs = indices.iter().zip(expected);
                    largest_difference(pairs.map(|(&i, b)| (found[i], *b)))
                }
            };
            result.rel_error = relative(difference.0, recorded.absmax);
            result.values = difference.1;
        } else {
            result.note = Some(format!("shape {shape:?}, recorded {:?}", recorded.shape));
        }
        self.stages.push(result);
        Ok(())
    }
}

/// Largest |a − b| over all pairs, infinite if a or b is NaN, and the number of pairs.
fn largest_difference(pairs: impl Iterator<Item = (f32, f32)>) -> (f64, usize) {
    pairs.fold((0.0, 0), |(largest, n), (a, b)| {
        let difference = (f64::from(a) - f64::from(b)).abs();
        let difference = if difference.is_nan() {
            f64::INFINITY
        } else {
            difference
        };
        (f64::max(largest, difference), n + 1)
    })
}

fn relative(difference: f64, absmax: f64) -> f64 {
    if difference == 0.0 {
        0.0
    } else {
        difference / absmax
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_are_not_numbers_diverge() {
        let (largest, n) = largest_difference([(1.0, 1.0), (f32::NAN, 2.0)].into_iter());
        assert_eq!((largest, n), (f64::INFINITY, 2));
        assert_eq!(relative(0.0, 0.0), 0.0);
        assert_eq!(relative(1.0, 0.0), f64::INFINITY);
    }

    #[test]
    fn the_first_divergence_is_the_first_in_order_of_computation() {
        let stage = |stage: &str, rel_error| StageComparison {
            stage: stage.to_owned(),
            rel_error,
            values: 1,
            note: None,
        };
        let comparison = RecordingComparison {
            stages: vec![stage("b", 1e-7), stage("c", f64::NAN), stage("a", 1.0)],
        };
        assert_eq!(comparison.first_divergence(1e-4).unwrap().stage, "c");
        assert!(!comparison.passes(1e-4));
    }
}
