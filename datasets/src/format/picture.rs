//! Photographs and masks of datasets, by [`sharp::image_file`], the one decoder of pictures.

use std::io::BufReader;
use std::path::Path;

use image::{GrayImage, RgbImage};
use sharp::image_file::{self, Header, OrientationRule, PictureRules};

use crate::{DatasetError, files};

/// Decodes a photograph to 8-bit RGB; `fit` is the size that it should have.
///
/// # Errors
/// Names the file; see [`image_file::read`].
pub fn read(
    path: &Path,
    rules: &PictureRules,
    fit: Option<(u32, u32)>,
) -> Result<RgbImage, DatasetError> {
    files::parse(path, |bytes| Ok(image_file::read_rgb8(bytes, rules, fit)?))
}

/// sha256 of a photograph's bytes, 64 lower-case hexadecimal digits.
///
/// # Errors
/// As [`read`]; of pixels only that there are too few.
pub fn sha256_of_whole(path: &Path) -> Result<String, DatasetError> {
    files::parse(path, |bytes| {
        image_file::check_complete(bytes)?;
        Ok(files::sha256_of(bytes))
    })
}

/// Decodes a mask: 8-bit gray, as stored.
///
/// # Errors
/// As [`read`]; when the mask lies in an alpha channel, or holds levels above 0 and none of 255.
pub fn read_mask(path: &Path) -> Result<GrayImage, DatasetError> {
    let as_stored = |bytes: &[u8]| Ok(image_file::read(bytes, &PictureRules::AS_STORED, None)?);
    let picture = files::parse(path, as_stored)?;
    let refused = |reason: String| Err(DatasetError::malformed(path, reason));
    if let image_file::Alpha::Varying(percent) = picture.alpha {
        return refused(format!(
            "its alpha is below 255 in {percent:.1} % of the pixels: a mask is read from gray levels; save the alpha as a gray \
             picture"
        ));
    }
    let mask = picture.image.into_luma8();
    match mask.iter().max() {
        Some(highest @ 1..=254) => refused(format!(
            "its highest level is {highest}; a mask is 255 on one side and 0 on the other: multiply it by {:.4}",
            255.0 / f64::from(*highest)
        )),
        _ => Ok(mask),
    }
}

/// A photograph's header, without decoding its pixels.
///
/// # Errors
/// As [`read`], as far as the header shows.
pub fn header(path: &Path) -> Result<Header, DatasetError> {
    let file = BufReader::new(files::open(path)?);
    image_file::header(file).map_err(|error| DatasetError::format(path, error))
}

/// Width and height of a photograph that has no camera's size to fit.
///
/// # Errors
/// As [`header`].
pub fn size_as_read(path: &Path, rules: &PictureRules) -> Result<(u32, u32), DatasetError> {
    match rules.orientation {
        OrientationRule::Upright => Ok(header(path)?.upright_size()),
        _ => dimensions(path),
    }
}

/// Width and height of a photograph as stored, from its header.
///
/// # Errors
/// As [`read`], as far as the header shows.
pub fn dimensions(path: &Path) -> Result<(u32, u32), DatasetError> {
    let file = BufReader::new(files::open(path)?);
    image_file::dimensions(file).map_err(|error| DatasetError::format(path, error))
}
