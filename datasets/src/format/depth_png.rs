//! 16-bit PNG maps: depth as integers, in units such as millimetres.

use std::path::Path;

use image::{ColorType, DynamicImage, ExtendedColorType};
use sharp::image_file;

use super::{FloatMap, FormatError};
use crate::DatasetError;

/// Reads a 16-bit grey PNG with values 0 to 65535, without rescaling.
///
/// # Errors
/// As for a picture; also if the PNG is not 16-bit grey.
pub fn parse(bytes: &[u8]) -> Result<FloatMap, FormatError> {
    let picture = image_file::read_map(bytes)?;
    match picture.image {
        DynamicImage::ImageLuma16(map) if picture.header.color == ColorType::L16 => {
            let (width, height) = map.dimensions();
            let values = map.iter().map(|v| f32::from(*v)).collect();
            FloatMap::from_vec(width, height, values).ok_or_else(|| "too large".into())
        }
        _ => Err(invalid!(
            "a depth map must be 16-bit gray, but this picture's pixels are {:?}",
            picture.header.color
        )),
    }
}

/// Writes integers as a 16-bit grey PNG; values are rounded and clamped.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, map: &FloatMap) -> Result<(), DatasetError> {
    let levels = map.iter().flat_map(|v| (v.round() as u16).to_ne_bytes());
    let levels: Vec<u8> = levels.collect();
    let bytes = image_file::encode_png(&levels, map.dimensions(), ExtendedColorType::L16)
        .map_err(|e| DatasetError::malformed(path, e.to_string()))?;
    std::fs::write(path, bytes).map_err(|e| DatasetError::io(path, e))
}
