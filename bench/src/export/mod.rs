//! Pictures and cameras in files, with their conventions spelled out: what a foreign method is given.
//!
//! * [`pairs`]: the pairs of a list, a folder each.
//! * [`cameras`]: every view of some scenes, for those who make depth maps or reconstructions.
//! * [`camera_file`]: one camera in JSON.
//! * [`viewer`]: Gaussians in a page that draws them.
//! * `file`: files that are written once.

pub mod camera_file;
pub mod cameras;
mod file;
pub mod pairs;
pub mod viewer;

use std::path::PathBuf;

use sharp_datasets::DatasetError;

use crate::io::atomic_files::FileError;

#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error("{}: {reason}", path.display())]
    Folder { path: PathBuf, reason: String },
}
