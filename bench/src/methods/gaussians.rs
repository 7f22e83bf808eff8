//! Gaussians that someone else's method predicted, one file per source view, rendered by us.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use sharp::gaussians::Gaussians;

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
#[derive(Debug)]
pub struct GaussianFiles {
    label: String,
    dir: PathBuf,
    /// The Gaussians of the source last asked for: pairs come source by source.
    last: Mutex<Option<(PathBuf, Arc<Gaussians>)>>,
}

impl GaussianFiles {
    /// The files of a folder, under a label.
    pub fn new(label: String, dir: PathBuf) -> Self {
        Self {
            label,
            dir,
            last: Mutex::new(None),
        }
    }

    fn read(&self, path: &Path) -> Result<Arc<Gaussians>, MethodError> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, gaussians)) = last.as_ref()
            && known == path
        {
            return Ok(Arc::clone(gaussians));
        }
        let scene =
            scene_file::read(path).map_err(|error| MethodError::Model(error.to_string()))?;
        let gaussians = Arc::new(scene.gaussians);
        *last = Some((path.to_owned(), Arc::clone(&gaussians)));
        Ok(gaussians)
    }

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
        let gaussians = self.read(&path)?;
        render(&gaussians, pair.target_from_source().to_affine(), pair)
    }
}
