//! One error type for the protocol.

use std::path::PathBuf;

use sharp_datasets::DatasetError;

use crate::durable::FileError;

/// Why pairs could not be made, read or measured.
#[derive(Debug, thiserror::Error)]
pub enum ProtocolError {
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
}
