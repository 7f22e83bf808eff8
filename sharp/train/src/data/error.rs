//! Errors of training data.

use std::path::{Path, PathBuf};

use sharp::camera::CameraError;
use sharp::model::ModelError;
use sharp::render::RenderError;
use sharp_datasets::DatasetError;
use sharp_datasets::synthetic::TRAINING_SEEDS;
use sharp_metrics::PictureError;

/// Errors of opening training data or reading a sample.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Photograph(#[from] ModelError),
    #[error(transparent)]
    Picture(#[from] PictureError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The dataset has no depth for a view's picture.
    #[error("{}: the dataset has no depth for this picture", image.display())]
    NoDepth { image: PathBuf },
    #[error(
        "{dataset}: no pair of views qualifies; two views of a scene must have depth, different poses, and a distance \
         of at most {limit_m} m (`max_baseline_m`){}",
        left_out.iter().map(|reason| format!("; {reason}")).collect::<String>()
    )]
    NoPair {
        dataset: String,
        limit_m: f64,
        /// Excluded parts of the dataset, each with its reason.
        left_out: Vec<String>,
    },
    #[error("{}: no PNG or JPEG files in this folder", folder.display())]
    NoPicture { folder: PathBuf },
    /// Too few files and subfolders to hold one out.
    #[error(
        "{}: too few files and subfolders with pictures ({count}) to hold out one in {every} (`split.held_out`)",
        folder.display()
    )]
    Unsplit {
        folder: PathBuf,
        count: usize,
        every: usize,
    },
    /// Some of the procedural scenes are held out, i.e. reserved for evaluation.
    #[error(
        "{dataset}: only seeds {} to {} may be used for training; all others are held out",
        TRAINING_SEEDS.start(),
        TRAINING_SEEDS.end()
    )]
    HeldOut { dataset: String },
    #[error("sample {id}: {source}")]
    Sample { id: String, source: Box<DataError> },
    #[error("cannot start the thread that prepares samples: {0}")]
    Start(String),
    #[error("the thread that prepares samples has ended")]
    Stopped,
}

impl DataError {
    pub(crate) fn of_sample(self, id: &str) -> Self {
        Self::Sample {
            id: id.to_owned(),
            source: Box::new(self),
        }
    }

    pub(super) fn no_depth(image: Option<&Path>) -> Self {
        Self::NoDepth {
            image: image.unwrap_or(Path::new("procedural")).to_owned(),
        }
    }
}
