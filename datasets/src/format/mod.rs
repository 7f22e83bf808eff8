//! File formats, one a file, and knowing nothing about datasets.
//!
//! * [`calib`]: Middlebury's `calib.txt`.
//! * [`pfm`]: disparity as portable float maps.
//! * [`picture`]: photographs, as 8-bit RGB.

pub mod calib;
mod jpeg_markers;
pub mod pfm;
pub mod picture;

use image::{ImageBuffer, Luma};

/// A map of raw values, top row first; invalid pixels are whatever the file holds (NaN, ±inf, 0).
pub type FloatMap = ImageBuffer<Luma<f32>, Vec<f32>>;
