//! Pictures that someone else's method made: `DIR/<pair_id>.png|jpg|jpeg|exr`.

use std::path::{Path, PathBuf};

use super::method::{Method, MethodError, PairInput, Prediction};
use crate::pictures;

/// Reads a folder of predicted pictures.
///
/// The sub-folders follow the pair id: `DIR/dataset/scene/source__target.png`. A picture whose size
/// is not the target's is an error, never resized silently. EXR pictures hold sRGB-encoded values
/// in 0..1 and are quantised to 8 bit by rounding like every other prediction.
#[derive(Debug, Clone)]
pub struct Imported {
    /// The instance's label.
    pub label: String,
    /// The folder.
    pub dir: PathBuf,
}

impl Imported {
    const EXTENSIONS: [&'static str; 4] = ["png", "jpg", "jpeg", "exr"];

    fn find(&self, pair_id: &str) -> Result<PathBuf, MethodError> {
        let candidates: Vec<PathBuf> = Self::EXTENSIONS
            .iter()
            .map(|extension| self.dir.join(format!("{pair_id}.{extension}")))
            .filter(|path| path.is_file())
            .collect();
        match candidates.as_slice() {
            [path] => Ok(path.clone()),
            [] => Err(MethodError::File {
                path: self.dir.join(pair_id),
                reason: format!("no picture (looked for {})", Self::EXTENSIONS.join(", ")),
            }),
            [first, second, ..] => Err(MethodError::File {
                path: first.clone(),
                reason: format!("ambiguous, {} exists too", display_name(second)),
            }),
        }
    }
}

fn display_name(path: &Path) -> String {
    path.file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

impl Method for Imported {
    fn label(&self) -> &str {
        &self.label
    }

    /// The folder is not part of it: the bytes of each picture are hashed instead, so a moved
    /// folder does not undo finished work.
    fn identity(&self) -> String {
        "imported".into()
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        Ok(vec![self.find(pair_id)?])
    }

    fn predict(&self, pair: &PairInput) -> Result<Prediction, MethodError> {
        let path = self.find(pair.pair_id)?;
        let image = pictures::read_rgb8(&path).map_err(|error| MethodError::File {
            path: path.clone(),
            reason: error.to_string(),
        })?;
        let expected = pair.target_image.dimensions();
        if image.dimensions() != expected {
            return Err(MethodError::File {
                path,
                reason: format!(
                    "the picture is {}x{}, the target {}x{}",
                    image.width(),
                    image.height(),
                    expected.0,
                    expected.1
                ),
            });
        }
        Ok(Prediction::plain(image))
    }
}
