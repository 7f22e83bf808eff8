//! Error type shared by all readers; includes the file and the reason.

use std::path::PathBuf;

use sharp::camera::CameraError;

use crate::format::error::FormatError;

/// Error of reading a file or folder as part of a dataset.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    #[error("{}: {source}", path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// The file's content is not valid in its format.
    #[error("{}: {source}", path.display())]
    Format { path: PathBuf, source: FormatError },
    /// The file is valid in its format but inconsistent with the dataset.
    #[error("{}: {reason}", path.display())]
    Malformed {
        path: PathBuf,
        /// Description of the error and, if known, of what was expected.
        reason: String,
    },
    /// The file contains an invalid camera.
    #[error("{}: {source}", path.display())]
    Camera { path: PathBuf, source: CameraError },
    /// The folder contains nothing that looks like this dataset.
    #[error("{}: no {format} scene found; expected {expected}{note}", path.display())]
    NoScene {
        path: PathBuf,
        format: &'static str,
        /// Description of the expected layout.
        expected: &'static str,
        /// Text on folders that could not be searched, preceded by a semicolon;
        /// empty if all could be searched.
        note: String,
    },
    /// The photograph of a virtual view was requested.
    #[error("this view is only a camera, without a photograph")]
    NoPhotograph,
    /// An invalid request for a dataset.
    #[error("dataset '{text}': {reason}")]
    Spec { text: String, reason: String },
    #[error("unknown dataset format '{name}'; {known}")]
    UnknownFormat {
        name: String,
        /// Known formats, the closest match first.
        known: String,
    },
}

/// Lists all known names, preceded by the closest match to `name`, if any.
pub fn nearest_of(name: &str, known: &[&str]) -> String {
    let near = known
        .iter()
        .map(|known| (strsim::jaro_winkler(name, known), known));
    let near = near.filter(|(similarity, _)| *similarity > 0.8);
    let nearest = near.max_by(|one, other| one.0.total_cmp(&other.0));
    let meant = nearest.map(|(_, known)| format!("did you mean '{known}'? "));
    format!("{}known: {}", meant.unwrap_or_default(), known.join(", "))
}

impl DatasetError {
    pub fn malformed(path: impl Into<PathBuf>, reason: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.into(),
            reason: reason.into(),
        }
    }

    pub fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::Io {
            path: path.into(),
            source,
        }
    }

    pub(crate) fn camera(path: impl Into<PathBuf>, source: CameraError) -> Self {
        Self::Camera {
            path: path.into(),
            source,
        }
    }

    pub(crate) fn format(path: impl Into<PathBuf>, source: impl Into<FormatError>) -> Self {
        Self::Format {
            path: path.into(),
            source: source.into(),
        }
    }
}
