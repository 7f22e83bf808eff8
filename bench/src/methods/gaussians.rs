//! Gaussians that someone else's method predicted, one file per source view, rendered by us.

use std::path::PathBuf;

use super::method::{Method, MethodError, PairInput, Prediction};
use super::splat::render;
use crate::scene_file;

/// Reads `DIR/<dataset>/<scene>/<source>.ply` or `.safetensors` (percent-encoded like pair ids).
///
/// The Gaussians lie in the source's camera space, metres, OpenCV axes: what `sharp predict` and
/// `sharp-bench predict` write. Whatever camera a file stores is ignored; the dataset's poses and intrinsics place and
/// render them.
///
/// Extras: `mean_alpha`, `hole_share`.
#[derive(Debug, Clone)]
pub struct GaussianFiles {
    /// The instance's label.
    pub label: String,
    /// The folder.
    pub dir: PathBuf,
}

impl GaussianFiles {
    fn find(&self, pair_id: &str) -> Result<PathBuf, MethodError> {
        // Ids encode underscores that would form a second separator.
        let source = pair_id.split("__").next().unwrap_or(pair_id);
        ["ply", "safetensors"]
            .iter()
            .map(|extension| self.dir.join(format!("{source}.{extension}")))
            .find(|path| path.is_file())
            .ok_or_else(|| MethodError::File {
                path: self.dir.join(source),
                reason: "no Gaussians (looked for .ply and .safetensors)".into(),
            })
    }
}

impl Method for GaussianFiles {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> String {
        "gaussians(space=camera)".into()
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        Ok(vec![self.find(pair_id)?])
    }

    fn predict(&self, pair: &PairInput) -> Result<Prediction, MethodError> {
        let path = self.find(pair.pair_id)?;
        let scene =
            scene_file::read(&path).map_err(|error| MethodError::Model(error.to_string()))?;
        render(
            &scene.gaussians,
            pair.target_from_source().to_affine(),
            pair,
        )
    }
}
