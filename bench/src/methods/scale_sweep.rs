//! Pictures of an external method at several scales of the scene; the best scale is scored.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::method::{
    Approach, Candidate, Method, MethodError, MethodIdentity, PicturePrediction, PredictScales,
    SourceView, TargetCamera,
};
use super::privilege::Privilege;
use super::spec::{MethodSpec, SpecError};
use crate::scoring::ScaleChooser;

/// One scale: its name in `scales=`, and its value.
pub type Scale = (String, f64);

/// A method that can predict a pair at a given scale of the scene.
pub(super) trait PredictAtScale: Method {
    /// Predicts the target's picture with the distance between the two cameras multiplied by the scale.
    fn predict_at(
        &self,
        scale: &Scale,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError>;

    /// Like [`Method::input_files`], for one scale.
    fn input_files_at(&self, _scale: &Scale, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        self.input_files(pair_id)
    }

    /// Fails if the method cannot predict at this scale. Errors do not name the method.
    fn check(&self, _scale: &Scale) -> Result<(), String> {
        Ok(())
    }
}

/// Predicts every pair at every scale and keeps the best scale.
///
/// A pair fails if it fails at any scale, because the best of fewer scales would not be comparable. Of equally good
/// scales, the one listed first is kept.
///
/// Extras: `best_scale`, `scales_tried`, and the method's extras at the best scale.
#[derive(Debug)]
pub(super) struct ScaleSweep<M> {
    method: M,
    scales: Vec<Scale>,
    names: String,
    chooser: Arc<ScaleChooser>,
}

impl<M: PredictAtScale> ScaleSweep<M> {
    /// Parses `scales=A+B+…`.
    ///
    /// # Errors
    /// If a scale is not a positive number, is given twice or cannot be predicted.
    pub(super) fn from_spec(
        spec: &MethodSpec,
        method: M,
        chooser: Arc<ScaleChooser>,
    ) -> Result<Self, SpecError> {
        let names = spec.option("scales").unwrap_or_default().to_owned();
        let each: Vec<String> = names
            .split('+')
            .map(|name| name.trim().to_owned())
            .collect();
        let scales = sweep_scales(&each).map_err(|e| spec.error(format!("scales={names}: {e}")))?;
        for scale in &scales {
            method.check(scale).map_err(|reason| spec.refused(reason))?;
        }
        Ok(Self {
            method,
            scales,
            names,
            chooser,
        })
    }
}

/// Parses the scales of a sweep from their names. Errors do not name the method.
pub fn sweep_scales(names: &[String]) -> Result<Vec<Scale>, String> {
    let mut scales: Vec<Scale> = Vec::new();
    for name in names {
        let scale = name.parse().ok();
        let Some(scale) = scale.filter(|s: &f64| s.is_finite() && *s > 0.0) else {
            return Err(format!("'{name}': expected positive numbers"));
        };
        if scales.iter().any(|(_, known)| *known == scale) {
            return Err(format!("scale {name} is given twice"));
        }
        scales.push((name.clone(), scale));
    }
    Ok(scales)
}

impl<M: PredictAtScale> Method for ScaleSweep<M> {
    fn label(&self) -> &str {
        self.method.label()
    }

    fn identity(&self) -> MethodIdentity {
        let mut identity = self.method.identity();
        let settings = [
            ("scales", &*self.names),
            (MethodIdentity::CHOSEN_BY, self.chooser.identity()),
        ];
        let settings = settings.map(|(key, value)| (key.to_owned(), value.to_owned()));
        identity.settings.extend(settings);
        identity
    }

    fn sources(&self) -> &'static str {
        self.method.sources()
    }

    fn privilege(&self) -> Privilege {
        self.method.privilege()
    }

    fn notes(&self) -> Vec<String> {
        self.method.notes()
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        let mut files = BTreeSet::new();
        for scale in &self.scales {
            files.extend(self.method.input_files_at(scale, pair_id)?);
        }
        Ok(files.into_iter().collect())
    }

    fn begin(&self, logs: &Path, scratch_in: &Path) {
        self.method.begin(logs, scratch_in);
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Scales(self)
    }
}

impl<M: PredictAtScale> PredictScales for ScaleSweep<M> {
    fn predict(
        &self,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<Vec<Candidate>, MethodError> {
        let mut candidates: Vec<Candidate> = Vec::new();
        for scale in &self.scales {
            let prediction = self.method.predict_at(scale, source, target)?;
            if candidates
                .first()
                .is_some_and(|first| first.prediction.region != prediction.region)
            {
                return Err(MethodError::File {
                    path: Path::new(target.pair_id()).to_owned(),
                    reason: "its scales show different parts of the target".to_owned(),
                });
            }
            candidates.push(Candidate {
                scale: scale.1,
                prediction,
            });
        }
        Ok(candidates)
    }

    fn chooser(&self) -> &ScaleChooser {
        &self.chooser
    }
}
