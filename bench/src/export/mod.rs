//! Exports pictures and cameras to files with documented conventions, as input for external methods.
//!
//! * [`pairs`]: the pairs of a list, one folder each.
//! * [`cameras`]: every view of some scenes, for producing depth maps or reconstructions.
//! * [`camera_file`]: one camera in JSON.
//! * [`viewer`]: an HTML page that draws Gaussians.
//! * `file`: files that are written only if missing or outdated.

pub mod camera_file;
pub mod cameras;
mod file;
pub mod pairs;
pub mod viewer;

use sharp_datasets::DatasetError;

use crate::io::atomic_files::FileError;

#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
}
