//! Scores two pictures.

use std::collections::BTreeMap;
use std::path::PathBuf;

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use sharp_metrics::{MetricRegion, Scorer as Core, Selection, Weights};

use crate::arrays;
use crate::errors::{failed, refused};

/// A selection of metrics, with loaded networks.
#[pyclass(frozen)]
pub(crate) struct Scorer {
    core: Core,
    selection: Selection,
}

/// Scores, then reasons for missing scores, each with the metric's key.
type Scored = (Vec<(String, f64)>, Vec<(String, String)>);

#[pymethods]
impl Scorer {
    #[new]
    fn new(metrics: &str, masked: bool, weights: BTreeMap<String, PathBuf>) -> PyResult<Self> {
        let mut selection = Selection::parse(metrics).map_err(refused)?;
        let has_own = |region| selection.keys().any(|key| key.region() == region);
        if masked && !has_own(MetricRegion::Given) {
            selection = selection.with_region(MetricRegion::Given);
        }
        let mut found = Weights::at_hand();
        for (name, file) in weights {
            found = found.with_file(name.parse().map_err(refused)?, file);
        }
        let core = Core::new(&selection, &found).map_err(failed)?;
        Ok(Self { core, selection })
    }

    /// Scores pictures `[H, W, 3]` of uint8 or float32, optionally within a mask `[H, W]` of bool. A metric without a
    /// value is an error if it was selected by its own name; if selected as part of a group, it is listed with its
    /// reason.
    #[pyo3(signature = (prediction, target, mask=None))]
    fn score(
        &self,
        py: Python<'_>,
        prediction: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        mask: Option<PyReadonlyArray2<'_, bool>>,
    ) -> PyResult<Scored> {
        let (prediction, target) = (arrays::picture(prediction)?, arrays::picture(target)?);
        let mask = mask.as_ref().map(arrays::mask).transpose()?;
        let scores = py.detach(|| self.core.score(&prediction, &target, mask.as_ref()));
        let (mut values, mut reasons) = (Vec::new(), Vec::new());
        for (key, score) in scores.map_err(refused)? {
            match score {
                Ok(value) => values.push((key.to_string(), value)),
                Err(reason) if self.selection.is_explicit(key) => {
                    return Err(failed(anyhow::anyhow!("{key}: {reason}")));
                }
                Err(reason) => reasons.push((key.to_string(), reason.to_string())),
            }
        }
        Ok((values, reasons))
    }

    /// Conventions of each key, as `sharp-bench metrics --explain --json` prints them.
    fn conventions(&self) -> PyResult<String> {
        serde_json::to_string(&self.core.info()).map_err(failed)
    }
}
