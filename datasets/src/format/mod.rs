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

pub mod calib;
pub mod colmap;
pub mod colmap_binary;
pub mod colmap_records;
pub mod colmap_text;
pub mod depth_png;
pub mod exr_depth;
mod jpeg_markers;
pub mod lenient_json;
pub mod npy;
pub mod opencv_xml;
pub mod pfm;
pub mod picture;
pub mod ply_points;
mod png_chunks;
pub mod raw_floats;
pub mod trajectory;
pub mod transforms;
mod zip;

use std::path::Path;

use image::{ImageBuffer, Luma};

use crate::{DatasetError, files};

/// A map of raw values, top row first; invalid pixels are whatever the file holds (NaN, ±inf, 0).
pub type FloatMap = ImageBuffer<Luma<f32>, Vec<f32>>;

/// Reads a map of any self-describing format, told apart by the first bytes: PFM, npy, npz, EXR or
/// 16-bit PNG.
///
/// # Errors
/// Names the file and why it cannot be read.
pub fn read_map(path: &Path) -> Result<FloatMap, DatasetError> {
    let bytes = files::read(path)?;
    let map = if bytes.starts_with(b"\x93NUMPY") || bytes.starts_with(b"PK") {
        npy::parse(&bytes).and_then(npy::NpyArray::into_map)
    } else if bytes.starts_with(&[0x76, 0x2F, 0x31, 0x01]) {
        exr_depth::parse(&bytes)
    } else if bytes.starts_with(b"Pf") || bytes.starts_with(b"PF") {
        pfm::parse(&bytes)
    } else {
        depth_png::parse(&bytes)
    };
    map.map_err(|reason| DatasetError::malformed(path, reason))
}
