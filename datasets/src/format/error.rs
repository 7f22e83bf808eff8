//! Errors of parsing a file format.

use sharp::image_file::ImageFileError;
use sharp::ply::table::TableError;

use crate::lens::LensError;

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FormatError {
    /// The file has less data than its header states.
    #[error("{what} takes {needed} bytes, but only {available} follow the header (truncated?)")]
    Truncated {
        what: String,
        needed: u128,
        available: usize,
    },
    /// The file is valid, but of an unsupported kind.
    #[error("{0}")]
    Unsupported(String),
    /// Any other error: what is wrong and where.
    #[error("{0}")]
    Invalid(String),
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error(transparent)]
    Ply(#[from] TableError),
}

impl From<ImageFileError> for FormatError {
    fn from(error: ImageFileError) -> Self {
        Self::Invalid(error.to_string())
    }
}

impl From<String> for FormatError {
    fn from(reason: String) -> Self {
        Self::Invalid(reason)
    }
}

impl From<&str> for FormatError {
    fn from(reason: &str) -> Self {
        Self::Invalid(reason.to_owned())
    }
}
