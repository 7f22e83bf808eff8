//! Pictures and cameras in files, with their conventions spelled out: what a foreign method is given.
//!
//! * [`pairs`]: the pairs of a list, a folder each.
//! * [`cameras`]: every view of some scenes, for those who make depth maps or reconstructions.
//! * [`camera_file`]: one camera in JSON.
//! * `file`: files that are written once.

pub mod camera_file;
pub mod cameras;
mod file;
pub mod pairs;

use std::path::PathBuf;

use sharp_datasets::DatasetError;

use crate::io::atomic_files::FileError;

/// Why something could not be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A file of ours that the system refused.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file of the dataset.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The folder holds something else.
    #[error("{}: {reason}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}
