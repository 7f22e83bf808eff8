//! Gaussians that someone else's method predicted, one file per source view, rendered by us.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::method::{
    Approach, GaussianPrediction, GaussianSpace, Method, MethodError, MethodIdentity,
    PredictGaussians, Privilege, SourceView,
};
use super::spec::{MethodSpec, SpecError};
use crate::io::{fingerprints, gaussian_files};
use crate::pairs::pair_id::path_of;

/// Reads `DIR/<dataset>/<scene>/<source>.ply` or `.safetensors` (percent-encoded like pair ids).
///
/// The Gaussians lie in the source's camera space, metres, OpenCV axes: what `sharp predict` and
/// `sharp-bench predict` write. Whatever camera a file stores is ignored; the dataset's poses and intrinsics place and
/// render them.
#[derive(Debug)]
pub struct GaussianFiles {
    label: String,
    dir: PathBuf,
    privilege: Privilege,
}

impl GaussianFiles {
    pub(super) fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        Ok(Self {
            label: spec.label.clone(),
            dir: spec.folder()?,
            privilege: spec.privilege(Privilege::DepthScale)?,
        })
    }

    fn find(&self, source: &str) -> Result<PathBuf, MethodError> {
        ["ply", "safetensors"]
            .iter()
            .map(|extension| self.dir.join(format!("{}.{extension}", path_of(source))))
            .find(|path| path.is_file())
            .ok_or_else(|| {
                let reason = "no Gaussians (looked for .ply and .safetensors)";
                MethodError::file(&self.dir.join(source), reason)
            })
    }
}

impl Method for GaussianFiles {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        MethodIdentity::new("gaussians", [("space", "camera".to_owned())])
    }

    fn sources(&self) -> &'static str {
        fingerprints::FILES
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        // Ids encode underscores that would form a second separator.
        let source = pair_id.split("__").next().unwrap_or(pair_id);
        Ok(vec![self.find(source)?])
    }

    fn privilege(&self) -> Privilege {
        self.privilege
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Gaussians(self)
    }
}

impl PredictGaussians for GaussianFiles {
    fn predict(&self, source: &SourceView) -> Result<GaussianPrediction, MethodError> {
        let path = self.find(source.name())?;
        let scene = gaussian_files::read(&path);
        let scene = scene.map_err(|error| MethodError::Model(error.to_string()))?;
        Ok(GaussianPrediction {
            gaussians: scene.gaussians,
            space: GaussianSpace::Camera,
            first_layer: None,
            extras: BTreeMap::new(),
        })
    }
}
