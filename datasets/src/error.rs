//! One error type for all readers: it always names the file and the reason.

use std::path::PathBuf;

use sharp::camera::CameraError;

/// Why a file or folder could not be read as part of a dataset.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file was read, but what it says is wrong.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong and, where known, what was expected.
        reason: String,
    },
    /// The file holds a camera that cannot be one.
    #[error("{}: {source}", path.display())]
    Camera {
        /// The file.
        path: PathBuf,
        /// What is wrong with the camera.
        source: CameraError,
    },
    /// A folder holds nothing that looks like this dataset.
    #[error("{}: no {format} scene found; expected {expected}{note}", path.display())]
    NoScene {
        /// The folder that was searched.
        path: PathBuf,
        /// Name of the format.
        format: &'static str,
        /// The layout that was looked for.
        expected: &'static str,
        /// What was there and could not be looked into, after a semicolon; empty for nothing.
        note: String,
    },
    /// A dataset was asked for in a way that makes no sense.
    #[error("dataset '{text}': {reason}")]
    Spec {
        /// What was asked for.
        text: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No reader of that name.
    #[error("unknown dataset format '{name}'; known: {known}")]
    UnknownFormat {
        /// What was asked for.
        name: String,
        /// The names there are.
        known: String,
    },
}

impl DatasetError {
    /// Shorthand for [`DatasetError::Malformed`].
    pub fn malformed(path: impl Into<PathBuf>, reason: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.into(),
            reason: reason.into(),
        }
    }

    /// Shorthand for [`DatasetError::Io`].
    pub fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::Io {
            path: path.into(),
            source,
        }
    }
}
