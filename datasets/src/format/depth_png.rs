//! 16-bit PNG maps: depth as integers, in units such as millimetres.

use std::path::Path;

use image::{ColorType, DynamicImage};
use sharp::image_file;

use super::{FloatMap, FormatError};
use crate::DatasetError;

/// Reads a 16-bit grey PNG with values 0 to 65535, without rescaling.
///
/// # Errors
/// As for a picture; also if it is not 16-bit grey.
pub fn parse(bytes: &[u8]) -> Result<FloatMap, FormatError> {
    let picture = image_file::read_map(bytes)?;
    match picture.image {
        DynamicImage::ImageLuma16(map) if picture.header.color == ColorType::L16 => {
            let (width, height) = map.dimensions();
            let values = map.iter().map(|v| f32::from(*v)).collect();
            FloatMap::from_vec(width, height, values).ok_or_else(|| "too large".into())
        }
        _ => Err(invalid!(
            "a depth map must be 16-bit gray; this picture's pixels are {:?}",
            picture.header.color
        )),
    }
}

/// Writes integers as a 16-bit grey PNG; values are rounded and clamped.
///
/// # Errors
/// [`DatasetError::Malformed`] if it cannot be written.
pub fn write(path: &Path, map: &FloatMap) -> Result<(), DatasetError> {
    let values = map.iter().map(|v| v.round() as u16).collect();
    image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_vec(map.width(), map.height(), values)
        .ok_or_else(|| DatasetError::malformed(path, "the map's size overflows"))?
        .save(path)
        .map_err(|e| DatasetError::malformed(path, e.to_string()))
}
