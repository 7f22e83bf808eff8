//! Photographs and masks of datasets, decoded by [`sharp::image_file`].

use std::io::BufReader;
use std::path::Path;

use image::{GrayImage, RgbImage};
use sharp::image_file::{self, Header, OrientationRule, PictureRules};
use sharp_checkpoint::hash::sha256_hex;

use crate::mask_labels::labels;
use crate::{DatasetError, files};

/// Decodes a photograph to 8-bit RGB; `fit` is the expected size.
///
/// # Errors
/// Names the file and the reason; see [`image_file::read`].
pub fn read(
    path: &Path,
    rules: &PictureRules,
    fit: Option<(u32, u32)>,
) -> Result<RgbImage, DatasetError> {
    files::parse(path, |bytes| Ok(image_file::read_rgb8(bytes, rules, fit)?))
}

/// SHA-256 of a photograph's bytes, 64 lower-case hexadecimal digits, after checking that the file is complete.
///
/// # Errors
/// As for [`read`], but the pixels are only checked for completeness.
pub fn sha256_of_whole(path: &Path) -> Result<String, DatasetError> {
    files::parse(path, |bytes| {
        image_file::check_complete(bytes)?;
        Ok(sha256_hex(bytes))
    })
}

/// Decodes a mask: 8-bit grey, as stored.
///
/// # Errors
/// As for [`read`]; also if the mask is in an alpha channel, or contains levels above 0 but none of `white` or more.
pub fn read_mask(path: &Path, white: u8) -> Result<GrayImage, DatasetError> {
    let as_stored = |bytes: &[u8]| Ok(image_file::read(bytes, &PictureRules::AS_STORED, None)?);
    let picture = files::parse(path, as_stored)?;
    let refused = |reason: String| Err(DatasetError::malformed(path, reason));
    if let image_file::Alpha::Varying(percent) = picture.alpha {
        return refused(format!(
            "{percent:.1} % of its pixels are not opaque, but masks are read from grey levels; save the alpha \
             channel as a grey picture"
        ));
    }
    let mask = picture.image.into_luma8();
    match mask.iter().max() {
        Some(highest) if (1..white).contains(highest) => refused(match labels(&mask) {
            Some(labels) => format!(
                "its areas have the levels {labels} like a map of objects; write a mask with level 255 for the objects to \
                 keep and 0 elsewhere"
            ),
            None => format!(
                "its maximum level is {highest}, but a mask has levels 0 and 255; multiply its levels by {:.4}",
                255.0 / f64::from(*highest)
            ),
        }),
        _ => Ok(mask),
    }
}

/// Reads a photograph's header without decoding its pixels.
///
/// # Errors
/// The errors of [`read`] that the header reveals.
pub fn header(path: &Path) -> Result<Header, DatasetError> {
    let mut file = BufReader::new(files::open(path)?);
    image_file::header(&mut file).map_err(|error| DatasetError::format(path, error))
}

/// Width and height of a photograph read under `rules`, for photographs that need not match a
/// camera's size.
pub fn size_as_read(path: &Path, rules: &PictureRules) -> Result<(u32, u32), DatasetError> {
    match rules.orientation {
        OrientationRule::Upright => Ok(header(path)?.upright_size()),
        _ => dimensions(path),
    }
}

/// Width and height of a photograph as stored; reads only its header.
///
/// # Errors
/// The errors of [`read`] that the header reveals.
pub fn dimensions(path: &Path) -> Result<(u32, u32), DatasetError> {
    let mut file = BufReader::new(files::open(path)?);
    image_file::dimensions(&mut file).map_err(|error| DatasetError::format(path, error))
}
