//! One error type for all readers: it always names the file and the reason.

use std::path::PathBuf;

use sharp::camera::CameraError;

use crate::entry::ENTRIES;
use crate::format::FormatError;

/// Why a file or folder could not be read as part of a dataset.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    #[error("{}: {source}", path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// The file's bytes are not what its format asks for.
    #[error("{}: {source}", path.display())]
    Format { path: PathBuf, source: FormatError },
    /// The file is well-formed but does not fit the dataset.
    #[error("{}: {reason}", path.display())]
    Malformed {
        path: PathBuf,
        /// What is wrong and, where known, what was expected.
        reason: String,
    },
    /// The file holds an impossible camera.
    #[error("{}: {source}", path.display())]
    Camera { path: PathBuf, source: CameraError },
    /// A folder holds nothing that looks like this dataset.
    #[error("{}: no {format} scene found; expected {expected}{note}", path.display())]
    NoScene {
        path: PathBuf,
        format: &'static str,
        /// The layout that was looked for.
        expected: &'static str,
        /// What could not be searched, after a semicolon; empty for nothing.
        note: String,
    },
    /// An invalid request for a dataset.
    #[error("dataset '{text}': {reason}")]
    Spec { text: String, reason: String },
    #[error("unknown dataset format '{name}'; {}", nearest_of(name, &ENTRIES.map(|entry| entry.format)))]
    UnknownFormat { name: String },
}

/// All names that are known, after the one that someone who wrote another may have meant.
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
