//! Errors of making and using pair lists.

use std::path::PathBuf;

use sharp_datasets::DatasetError;

use crate::io::atomic_files::FileError;
use crate::io::checkpoint::NetworkError;

#[derive(Debug, thiserror::Error)]
pub enum PairError {
    #[error("pair options: {0}")]
    Options(String),
    #[error("pair id '{text}': {reason}")]
    PairId { text: String, reason: String },
    #[error("{}:{line}: {reason}", path.display())]
    List {
        path: PathBuf,
        line: u64,
        reason: String,
    },
    #[error(transparent)]
    File(#[from] FileError),
    #[error(
        "pair id '{0}' occurs twice, because two datasets or scenes share a name; give each dataset a name of its \
         own (NAME:FORMAT=PATH)"
    )]
    DuplicatePair(String),
    #[error("{what}: depth is {}x{}, but the camera's image is {}x{}", depth.0, depth.1, camera.0, camera.1)]
    DepthSize {
        what: String,
        depth: (u32, u32),
        camera: (u32, u32),
    },
    #[error("{}: {reason}", path.display())]
    Depth { path: PathBuf, reason: String },
    #[error("no pixel has a valid depth in both maps ({}x{} and {}x{})", a.0, a.1, b.0, b.1)]
    NoValidDepth { a: (u32, u32), b: (u32, u32) },
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error("--dataset {spec}: {reason}")]
    DatasetSpec { spec: String, reason: String },
    #[error("no scene matches --scenes {0}")]
    NoScene(String),
    #[error("{0}")]
    Recipe(String),
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// Stopped by a signal or the time budget.
    #[error(
        "the pair list was not finished; the overlaps measured so far are kept if there is a cache; run the same \
         command again to continue"
    )]
    Stopped,
    #[error("no pair to evaluate: {0}")]
    NoPair(String),
}
