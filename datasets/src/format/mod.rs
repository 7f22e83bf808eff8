//! File formats, one a file, and knowing nothing about datasets.
//!
//! * [`calib`]: Middlebury's `calib.txt`.
//! * [`colmap`]: COLMAP models, from [`colmap_text`] or [`colmap_binary`], as [`colmap_records`].
//! * [`depth_png`]: 16-bit PNG maps.
//! * [`exr_depth`]: depth in OpenEXR files.
//! * [`lenient_json`]: JSON as Python writes it.
//! * [`npy`]: NumPy's arrays.
//! * [`opencv_xml`]: OpenCV's FileStorage.
//! * [`pfm`]: portable float maps.
//! * [`picture`]: photographs, as 8-bit RGB.
//! * [`ply_points`]: points and triangles.
//! * [`raw_floats`]: bare f32 values.
//! * [`trajectory`]: poses by frame number.
//! * [`transforms`][]: `transforms.json`.

/// [`FormatError::Invalid`] with a formatted reason.
macro_rules! invalid {
    ($($reason:tt)*) => {
        $crate::format::FormatError::Invalid(format!($($reason)*))
    };
}

pub mod calib;
pub mod colmap;
pub mod colmap_binary;
pub mod colmap_records;
pub mod colmap_text;
pub mod depth_png;
pub mod exr_depth;
pub mod lenient_json;
pub mod npy;
pub mod opencv_xml;
pub mod pfm;
pub mod picture;
pub mod ply_points;
pub mod raw_floats;
pub mod trajectory;
pub mod transforms;

use std::path::Path;

use image::{ImageBuffer, Luma};
use sharp::image_file::ImageFileError;
use sharp::ply::table::TableError;

use crate::lens::LensError;
use crate::{DatasetError, files};

/// Why bytes are not a file of a format.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FormatError {
    /// The header promises more than follows it.
    #[error("{what} takes {needed} bytes; only {available} follow the header (truncated?)")]
    Truncated {
        what: String,
        needed: u128,
        available: usize,
    },
    /// Well-formed, but of a kind that is not read.
    #[error("{0}")]
    Unsupported(String),
    /// Anything else: what is wrong and where.
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

/// A map of raw values, top row first; invalid pixels are whatever the file holds (NaN, ±inf, 0).
pub type FloatMap = ImageBuffer<Luma<f32>, Vec<f32>>;

/// Reads a map of any self-describing format, told apart by the first bytes: PFM, npy, npz, EXR or
/// 16-bit PNG.
///
/// # Errors
/// Names the file and why it cannot be read.
pub fn read_map(path: &Path) -> Result<FloatMap, DatasetError> {
    files::parse(path, |bytes| {
        if bytes.starts_with(b"\x93NUMPY") || bytes.starts_with(b"PK") {
            npy::parse(bytes).and_then(npy::NpyArray::into_map)
        } else if bytes.starts_with(&[0x76, 0x2F, 0x31, 0x01]) {
            exr_depth::parse(bytes)
        } else if bytes.starts_with(b"Pf") || bytes.starts_with(b"PF") {
            pfm::parse(bytes)
        } else {
            depth_png::parse(bytes)
        }
    })
}
