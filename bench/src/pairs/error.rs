//! Why a pair list cannot be made or used.

use std::path::PathBuf;

use sharp_datasets::DatasetError;

use sharp::model::ModelError;

use crate::io::atomic_files::FileError;
use crate::io::checkpoint::NoCheckpoint;

/// Why pairs could not be made, read or measured.
#[derive(Debug, thiserror::Error)]
pub enum PairError {
    /// An option's text or value makes no sense.
    #[error("pair options: {0}")]
    Options(String),
    /// A text is not a pair id as this project writes them.
    #[error("pair id '{text}': {reason}")]
    PairId {
        /// What was given.
        text: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A pair list cannot be read.
    #[error("{}:{line}: {reason}", path.display())]
    List {
        /// The list.
        path: PathBuf,
        /// Line in the file, from 1.
        line: u64,
        /// What is wrong.
        reason: String,
    },
    /// A file of ours that the operating system refused.
    #[error(transparent)]
    File(#[from] FileError),
    /// Two pairs of the given scenes have one id.
    #[error(
        "pair id '{0}' occurs twice: two datasets or scenes share a name (give each dataset its own: NAME:FORMAT=PATH)"
    )]
    DuplicatePair(String),
    /// Depth and camera of a view disagree in size.
    #[error("{what}: depth is {}x{}, the camera says {}x{}", depth.0, depth.1, camera.0, camera.1)]
    DepthSize {
        /// The view.
        what: String,
        /// Width and height of the depth map.
        depth: (u32, u32),
        /// Width and height of the camera's image.
        camera: (u32, u32),
    },
    /// Depth for the overlap that cannot be used.
    #[error("{}: {reason}", path.display())]
    Depth {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// No pixel has both a predicted and a ground-truth depth.
    #[error("no pixel has a valid depth in both maps ({}x{} and {}x{})", a.0, a.1, b.0, b.1)]
    NoValidDepth {
        /// Size of the ground truth.
        a: (u32, u32),
        /// Size of the prediction.
        b: (u32, u32),
    },
    /// A reader failed.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A dataset given with `--dataset`, before any of its files is read.
    #[error("--dataset {spec}: {reason}")]
    DatasetSpec {
        /// What was given.
        spec: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No scene is left of all datasets.
    #[error("no scene matches --scenes {0}")]
    NoScene(String),
    /// A choice and the files that it needs do not go together.
    #[error("{0}")]
    Recipe(String),
    /// SHARP's checkpoint, whose depth was asked for.
    #[error(transparent)]
    Checkpoint(#[from] NoCheckpoint),
    /// Its configuration.
    #[error(transparent)]
    Config(#[from] ModelError),
    /// Nothing is selected.
    #[error("no pair to evaluate: {0}")]
    NoPair(String),
}
