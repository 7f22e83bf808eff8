//! Photographs and masks of datasets, by [`sharp::image_file`], the one decoder of photographs.
//!
//! An EXIF orientation is never applied here, because the intrinsics of COLMAP, nerfstudio and ETH3D describe the picture
//! as stored.

use std::io::BufReader;
use std::path::Path;

use image::{GrayImage, RgbImage};
use sharp::image_file::{self, ImageFileError, MAX_PIXELS};

use crate::{DatasetError, files};

/// Decodes a photograph to 8-bit RGB.
///
/// # Errors
/// Names the file; see [`image_file::decode`].
pub fn read(path: &Path) -> Result<RgbImage, DatasetError> {
    files::parse(path, |bytes| Ok(image_file::decode_rgb8(bytes)?))
}

/// Decodes a mask: 8-bit gray, whatever the file has.
///
/// # Errors
/// As [`read`].
pub fn read_mask(path: &Path) -> Result<GrayImage, DatasetError> {
    files::parse(path, |bytes| Ok(image_file::decode(bytes)?.into_luma8()))
}

/// Width and height of a photograph, from its header. What [`read`] would refuse as too large is refused here too: it
/// becomes the size of a camera.
///
/// # Errors
/// As [`read`], as far as the header shows.
pub fn dimensions(path: &Path) -> Result<(u32, u32), DatasetError> {
    let file = BufReader::new(files::open(path)?);
    let size = image_file::dimensions(file).and_then(|(width, height)| {
        match u64::from(width) * u64::from(height) > MAX_PIXELS {
            true => Err(ImageFileError::TooLarge { width, height }),
            false => Ok((width, height)),
        }
    });
    size.map_err(|error| DatasetError::format(path, error))
}
