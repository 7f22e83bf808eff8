//! The best of several scales: what the paper does for methods that know no metric scale (LVSM, SVC).
//!
//! "For each pair, we apply a linear scale sweep to find the best scale that minimizes the DISTS score": the method
//! rendered each pair at several scales of the scene, and the one whose picture is nearest to the target under DISTS is
//! scored. This looks at the target; the report says so beside the numbers.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sharp_metrics::Scorer;

use super::imported::Imported;
use super::method::{Method, MethodError, PairInput, Prediction};
use super::spec::{MethodSpec, SpecError};
use super::truth::Truth;
use crate::protocol::Region;

/// What chooses among scales.
#[derive(Debug)]
pub struct ScaleChooser {
    /// Computes exactly one metric, of which less is better.
    pub scorer: Scorer,
    /// The metric and its weights, for identities.
    pub identity: String,
}

/// Reads `DIR/<scale>/<pair_id>.png` for every scale and keeps the best.
///
/// A pair of which one scale's picture is missing is a failure: the best of fewer is another number. Equally good scales
/// go to the one named first.
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
    /// Reads `scales=A+B+…`, each the name of a folder.
    ///
    /// # Errors
    /// When a scale is no positive number, is given twice or has no folder.
    pub(super) fn from_spec(
        spec: &MethodSpec,
        chooser: Arc<ScaleChooser>,
    ) -> Result<Self, SpecError> {
        let pictures = Imported::from_spec(spec)?;
        let names = spec.options.get("scales").cloned().unwrap_or_default();
        let mut scales: Vec<(f64, Imported)> = Vec::new();
        for name in names.split('+').map(str::trim) {
            let scale = name.parse().ok();
            let Some(scale) = scale.filter(|s: &f64| s.is_finite() && *s > 0.0) else {
                return Err(spec.error(format!(
                    "scales={names}: positive numbers joined by '+' are needed, each the name of a folder"
                )));
            };
            if scales.iter().any(|(known, _)| *known == scale) {
                return Err(spec.error(format!("scale {name} is given twice")));
            }
            let of_scale = pictures.in_folder(name);
            if !of_scale.dir().is_dir() {
                let dir = of_scale.dir().display();
                return Err(spec.error(format!("{dir} is not a folder")));
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

    /// The chooser's number; less is better.
    fn badness(&self, prediction: &Prediction, truth: &Truth) -> Result<f64, String> {
        let scores = prediction.score(&self.chooser.scorer, truth, None)?;
        match scores.into_iter().next() {
            Some((_, Ok(value))) if !value.is_nan() => Ok(value),
            Some((key, Ok(_))) => Err(format!("{key} is not a number")),
            Some((key, Err(reason))) => Err(format!("{key}: {reason}")),
            None => Err("no metric chooses".to_owned()),
        }
    }
}

impl Method for ScaleSweep {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> String {
        let pictures = self.scales.first();
        let pictures = pictures.map_or_else(String::new, |(_, p)| p.identity());
        format!(
            "{pictures}, best of scales {} by {}",
            self.names, self.chooser.identity
        )
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        let mut files = Vec::new();
        for (_, pictures) in &self.scales {
            files.extend(pictures.input_files(pair_id)?);
        }
        Ok(files)
    }

    fn region(&self, pair_id: &str, target: (u32, u32)) -> Result<Option<Region>, MethodError> {
        let mut regions = Vec::new();
        for (_, pictures) in &self.scales {
            regions.push(pictures.region(pair_id, target)?);
        }
        let first = regions.first().copied().flatten();
        if regions.iter().any(|region| *region != first) {
            return Err(MethodError::File {
                path: Path::new(pair_id).to_owned(),
                reason: "its scales show different parts of the target".to_owned(),
            });
        }
        Ok(first)
    }

    fn predict(&self, pair: &PairInput) -> Result<Prediction, MethodError> {
        self.region(pair.pair_id, pair.truth.dimensions())?;
        let mut best: Option<(f64, f64, Prediction)> = None;
        for (scale, pictures) in &self.scales {
            let prediction = pictures.predict(pair)?;
            let badness = self.badness(&prediction, pair.truth);
            let badness = badness.map_err(|reason| MethodError::Unsuitable {
                view: pair.pair_id.to_owned(),
                reason: format!("scale {scale}: {reason}"),
            })?;
            if best.as_ref().is_none_or(|(least, ..)| badness < *least) {
                best = Some((badness, *scale, prediction));
            }
        }
        let Some((_, scale, mut prediction)) = best else {
            return Err(MethodError::Unsuitable {
                view: pair.pair_id.to_owned(),
                reason: "no scale was given".to_owned(),
            });
        };
        let tried = self.scales.len() as f64;
        prediction.extras.insert("best_scale".to_owned(), scale);
        prediction.extras.insert("scales_tried".to_owned(), tried);
        Ok(prediction)
    }
}
