//! Pictures of an external method at several scales of the scene; the best scale is scored.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::imported::Imported;
use super::method::{
    Approach, Candidate, Method, MethodError, MethodIdentity, PredictPicture, PredictScales,
    SourceView, TargetCamera,
};
use super::spec::{MethodSpec, SpecError};
use crate::scoring::ScaleChooser;

/// Reads `DIR/<scale>/<pair_id>.png` for every scale and keeps the best.
///
/// If a pair's picture is missing at any scale, the pair fails, because the best of fewer scales is
/// not comparable. Ties go to the scale listed first.
///
/// Extras: `best_scale`, `scales_tried`, and those of [`Imported`].
#[derive(Debug)]
pub struct ScaleSweep {
    label: String,
    scales: Vec<(f64, Imported)>,
    names: String,
    chooser: Arc<ScaleChooser>,
}

impl ScaleSweep {
    /// Parses `scales=A+B+…`, each the name of a folder.
    ///
    /// # Errors
    /// If a scale is not a positive number, is given twice or has no folder.
    pub(super) fn from_spec(
        spec: &MethodSpec,
        chooser: Arc<ScaleChooser>,
    ) -> Result<Self, SpecError> {
        let pictures = Imported::from_spec(spec)?;
        let names = spec.option("scales").unwrap_or_default().to_owned();
        let mut scales: Vec<(f64, Imported)> = Vec::new();
        let folders: Vec<String> = names
            .split('+')
            .map(|name| name.trim().to_owned())
            .collect();
        let of_names = sweep_scales(&folders);
        for (name, scale) in of_names.map_err(|e| spec.error(format!("scales={names}: {e}")))? {
            let of_scale = pictures.in_folder(&name);
            if !of_scale.dir().is_dir() {
                let dir = of_scale.dir().display();
                return Err(spec.refused(format!("{dir} is not a folder")));
            }
            scales.push((scale, of_scale));
        }
        Ok(Self {
            label: spec.label.clone(),
            scales,
            names,
            chooser,
        })
    }
}

/// Parses the scales of a sweep from its folder names. Errors do not name the method.
pub fn sweep_scales(names: &[String]) -> Result<Vec<(String, f64)>, String> {
    let mut scales: Vec<(String, f64)> = Vec::new();
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

impl Method for ScaleSweep {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        let pictures = self.scales.first().map(|(_, pictures)| pictures.identity());
        let mut settings = pictures.map_or_else(Default::default, |identity| identity.settings);
        settings.insert("scales".to_owned(), self.names.clone());
        settings.insert("chosen_by".to_owned(), self.chooser.identity().to_owned());
        MethodIdentity {
            kind: "imported".to_owned(),
            settings,
        }
    }

    fn sources(&self) -> &'static str {
        self.scales
            .first()
            .map_or("", |(_, pictures)| pictures.sources())
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        let mut files = Vec::new();
        for (_, pictures) in &self.scales {
            files.extend(pictures.input_files(pair_id)?);
        }
        Ok(files)
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Scales(self)
    }
}

impl PredictScales for ScaleSweep {
    fn predict(
        &self,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<Vec<Candidate>, MethodError> {
        let mut candidates: Vec<Candidate> = Vec::new();
        for (scale, pictures) in &self.scales {
            let prediction = pictures.predict(source, target)?;
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
                scale: *scale,
                prediction,
            });
        }
        Ok(candidates)
    }

    fn chooser(&self) -> &ScaleChooser {
        &self.chooser
    }
}
