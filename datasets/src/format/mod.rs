//! File formats, one per module, independent of datasets.
//!
//! * [`calib`]: Middlebury's `calib.txt`.
//! * [`colmap`]: COLMAP models, read by [`colmap_text`] or [`colmap_binary`] into [`colmap_records`].
//! * [`depth_png`]: 16-bit PNG maps.
//! * [`exr_depth`]: depth in OpenEXR files.
//! * [`lenient_json`]: JSON as written by Python.
//! * [`npy`]: NumPy's arrays.
//! * [`opencv_xml`]: OpenCV's FileStorage.
//! * [`pfm`]: portable float maps.
//! * [`picture`]: photographs, as 8-bit RGB.
//! * [`ply_points`]: points and triangles.
//! * [`raw_floats`]: bare f32 values.
//! * [`trajectory`]: numbered poses.
//! * [`transforms`][]: `transforms.json`.

/// Shorthand for [`FormatError::Invalid`] with a formatted reason.
macro_rules! invalid {
    ($($reason:tt)*) => {
        $crate::format::error::FormatError::Invalid(format!($($reason)*))
    };
}

/// True if most values are absurd as stored, but hardly any would be in the other byte order.
pub(crate) fn is_byte_swapped(values: &[f32]) -> bool {
    let counts = |v: &f32| v.is_finite() && *v != 0.0;
    let absurd = |v: &f32| counts(v) && !(1e-10..=1e10).contains(&v.abs());
    let swapped = values
        .iter()
        .map(|v| f32::from_bits(v.to_bits().swap_bytes()));
    let all = values.iter().filter(|v| counts(v)).count();
    2 * values.iter().filter(|v| absurd(v)).count() > all
        && 100 * swapped.filter(absurd).count() <= values.len()
}

pub mod calib;
pub mod colmap;
pub mod colmap_binary;
pub mod colmap_records;
pub mod colmap_text;
pub mod depth_png;
pub(crate) mod error;
pub mod exr_depth;
pub mod lenient_json;
mod map;
pub mod npy;
pub mod opencv_xml;
pub mod pfm;
pub mod picture;
pub mod ply_points;
pub mod raw_floats;
pub mod trajectory;
pub mod transforms;

use image::{ImageBuffer, Luma};

pub use error::FormatError;
pub use map::read_map;
pub(crate) use map::read_map_if;

/// A map of raw values, top row first; invalid pixels are as stored (NaN, ±inf, 0).
pub type FloatMap = ImageBuffer<Luma<f32>, Vec<f32>>;
