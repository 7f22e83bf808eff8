//! The trait that every method implements, what it is given and what it returns.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use image::RgbImage;
use sharp::camera::RigidTransform;
use sharp_datasets::{DatasetError, View};
use sharp_metrics::{Mask, Picture, Scorer, Scores};

use super::truth::Truth;
use crate::protocol::Region;
use crate::rendering::SharedRenderer;

/// One pair, as a method sees it.
///
/// The target view is handed over whole, but only its camera may be used for a prediction; the
/// self-test `target` is the one exception.
#[derive(Debug, Clone, Copy)]
pub struct PairInput<'a> {
    /// `dataset/scene/source__target`.
    pub pair_id: &'a str,
    /// The view that a method starts from.
    pub source: &'a View,
    /// The view to predict.
    pub target: &'a View,
    /// The source's photograph, 8-bit sRGB.
    pub source_image: &'a RgbImage,
    /// The target's photograph and which of its pixels count: the ground truth.
    pub truth: &'a Truth,
    /// Renders the Gaussians of methods that have some.
    pub renderer: &'a SharedRenderer,
}

impl PairInput<'_> {
    /// Extrinsics between the two cameras.
    pub fn target_from_source(&self) -> RigidTransform {
        self.target
            .camera_from_world
            .after(&self.source.camera_from_world.inverse())
    }
}

/// What a method made of a pair.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// sRGB, of the target's size, or of [`Self::region`]'s.
    pub picture: Picture,
    /// The part of the target that the picture shows; `None` for all of it.
    pub region: Option<Region>,
    /// Facts about this prediction that become columns (`mean_alpha`, `hole_share`, …).
    pub extras: BTreeMap<String, f64>,
}

impl Prediction {
    /// A picture without further facts.
    pub fn plain(image: RgbImage) -> Self {
        Self {
            picture: Picture::Rgb8(image),
            region: None,
            extras: BTreeMap::new(),
        }
    }

    /// Scores it against the ground truth, cropped like itself. Errors are the bare reason.
    pub(crate) fn score(
        &self,
        scorer: &Scorer,
        truth: &Truth,
        frustum: Option<&Mask>,
    ) -> Result<Scores, String> {
        let size = truth.dimensions();
        let region = self.region.unwrap_or(Region::whole(size));
        if !region.fits(size) {
            return Err(format!(
                "the crop {region} is not inside the target, {}x{}",
                size.0, size.1
            ));
        }
        truth.score(scorer, &self.picture, region, frustum)
    }
}

/// Why a method failed on a pair. It becomes a recorded failure; the other pairs go on.
#[derive(Debug, thiserror::Error)]
pub enum MethodError {
    /// A file of the dataset.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The view lacks what the method needs.
    #[error("{view}: {reason}")]
    Unsuitable {
        /// The view.
        view: String,
        /// What is missing or wrong.
        reason: String,
    },
    /// A file that the method reads itself.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Someone's program.
    #[error("'{run}': {reason}")]
    Program {
        /// Its command line.
        run: String,
        /// What went wrong.
        reason: String,
    },
    /// The network or the file of Gaussians.
    #[error("{0}")]
    Model(String),
    /// The renderer refused.
    #[error("render: {0}")]
    Render(String),
    /// The renderer's device was lost or is out of memory. It says nothing about the pair: the run ends, the unit
    /// stays undone, and a restart tries it again.
    #[error("{0}")]
    Device(String),
}

/// A way to predict a target view from a source view.
pub trait Method: Send + Sync {
    /// Fills the `method` column.
    fn label(&self) -> &str;

    /// Everything about the instance that a predicted picture depends on, as stable text. It goes
    /// into the key of a unit and into the manifest.
    fn identity(&self) -> String;

    /// Files besides the two views that this pair's prediction depends on, for the unit's key.
    ///
    /// # Errors
    /// As [`Self::predict`].
    fn input_files(&self, _pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        Ok(Vec::new())
    }

    /// The part of the target, of the given size, that the method predicts, where its options or files say so before
    /// it predicts; `None` for all of it.
    ///
    /// # Errors
    /// As [`Self::predict`].
    fn region(&self, _pair_id: &str, _target: (u32, u32)) -> Result<Option<Region>, MethodError> {
        Ok(None)
    }

    /// Told once, before the first prediction of a run, the folder for logs; it need not exist.
    fn begin(&self, _logs: &Path) {}

    /// Predicts the target view.
    ///
    /// # Errors
    /// Names the file or view and the reason.
    fn predict(&self, pair: &PairInput) -> Result<Prediction, MethodError>;
}
