//! Loading of a photograph: pixels, orientation, focal length.
//!
//! [`image_file`] reads the photograph in the same way as the SHARP release, except where the release garbles the
//! picture:
//!
//! | picture | here | release |
//! |---|---|---|
//! | palette, two levels | its colours | the indices as grey |
//! | grey with alpha | grey | an error |
//! | 16 bit | divided by 65535 | divided by 255, beyond 1 |
//! | CMYK | converted to RGB by (1 − ink)(1 − black) | cyan, magenta and yellow as red, green and blue |
//! | a colour profile | converted to sRGB, with a warning | taken for sRGB |
//!
//! HEIC, which the release supports, is not supported. As in the release, grey is repeated in all three channels, and
//! alpha is dropped rather than composited, with a warning.

use std::io::Cursor;
use std::path::Path;

use super::ModelError;
use super::predictor::{Planes, planes_of};
use crate::image_file::focal::{Focal, FocalSource, focal_px_from_35mm};
use crate::image_file::{self, AlphaRule, OrientationRule, PictureRules};

/// A focal length below this multiple of the picture's width (a field of view above 136 degrees) gives a warning.
const MIN_WIDTHS: f64 = 0.2;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotoOptions {
    /// Focal length in pixels of the (upright) image; overrides the focal length in the file.
    pub focal_px: Option<f64>,
    /// Images with more pixels are refused before they are decoded.
    pub max_pixels: u64,
    /// Alpha is dropped unless another rule is set. Mirrored orientations are never applied, as in the SHARP release.
    pub rules: PictureRules,
}

impl Default for PhotoOptions {
    fn default() -> Self {
        Self {
            focal_px: None,
            max_pixels: 250_000_000,
            rules: PictureRules {
                alpha: AlphaRule::Drop,
                ..PictureRules::default()
            },
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Photo {
    /// Pixels, `[3, height, width]`, sRGB-encoded, 0..1.
    pub values: Vec<f32>,
    pub width: usize,
    pub height: usize,
    pub focal_px: f64,
    pub focal_source: FocalSource,
    /// Warnings about the picture.
    pub warnings: Vec<String>,
    /// Warnings about the focal length, if the focal length is from the file or the default.
    pub focal_warnings: Vec<String>,
}

impl Photo {
    /// Input for [`Predictor::predict`](super::Predictor::predict).
    pub fn planes(&self) -> Planes<'_> {
        Planes {
            values: &self.values,
            width: self.width,
            height: self.height,
        }
    }

    /// Focal length divided by width: the factor from disparity to metres. Always uses the width, also for portrait
    /// pictures.
    pub fn disparity_factor(&self) -> f32 {
        (self.focal_px / self.width as f64) as f32
    }
}

/// Reads a photograph.
///
/// # Errors
/// [`ModelError::Photograph`] if the photograph cannot be decoded completely; [`ModelError::File`]
/// if it cannot be read, is smaller than 2×2, exceeds the pixel limit, or has a focal length that
/// is not positive.
pub fn load_photo(path: &Path, options: &PhotoOptions) -> Result<Photo, ModelError> {
    let bytes = crate::files::read(path).map_err(|e| ModelError::file(path, e))?;
    photo_from_bytes(path, &bytes, options)
}

fn photo_from_bytes(
    path: &Path,
    bytes: &[u8],
    options: &PhotoOptions,
) -> Result<Photo, ModelError> {
    let refuse = |reason: String| Err(ModelError::file(path, reason));
    let undecodable = |reason| ModelError::Photograph {
        path: path.to_owned(),
        reason,
    };
    let (width, height) = image_file::dimensions(&mut Cursor::new(bytes)).map_err(undecodable)?;
    if width < 2 || height < 2 {
        return refuse(format!(
            "an image of {width}x{height} pixels; at least 2x2 are needed"
        ));
    }
    if u64::from(width) * u64::from(height) > options.max_pixels {
        return refuse(format!(
            "an image of {width}x{height} has more than {} pixels",
            options.max_pixels
        ));
    }
    let header = image_file::header(&mut Cursor::new(bytes)).map_err(undecodable)?;
    let is_mirrored = matches!(header.orientation, 2 | 4 | 5 | 7);
    let rules = if is_mirrored {
        PictureRules {
            orientation: OrientationRule::Stored,
            ..options.rules
        }
    } else {
        options.rules
    };
    let picture = image_file::read(bytes, &rules, None).map_err(undecodable)?;
    let mut warnings = picture.notes(&rules);
    if is_mirrored {
        warnings[0] = format!(
            "orientation {} is mirrored and ignored, as in the release",
            header.orientation
        );
    } else if picture.turned {
        // Remove the note on the rotation: phones always rotate this way, and the SHARP release handles it.
        warnings.remove(0);
    }
    let image = picture.image;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let values = match image.color().bytes_per_pixel() / image.color().channel_count() {
        1 => planes_of(&image.into_rgb8(), |v| f32::from(v) / 255.0),
        _ => planes_of(&image.into_rgb16(), |v| f32::from(v) / 65535.0),
    };
    let (focal_px, focal_source, focal_warnings) = match options.focal_px {
        Some(px) => (px, FocalSource::Given, Vec::new()),
        None => {
            let focal = Focal::of_file(bytes, (width, height));
            (focal.px, focal.source, focal.warnings)
        }
    };
    if !(focal_px.is_finite() && focal_px > 0.0) {
        return refuse(format!(
            "the focal length must be finite and positive, but is {focal_px} pixels"
        ));
    }
    if focal_source == FocalSource::Given && focal_px < MIN_WIDTHS * width as f64 {
        warnings.push(format!(
            "a focal length of {focal_px} px would be a field of view of {:.0} degrees in a picture {width} pixels \
             wide; perhaps it is in millimetres (on 35 mm film, {focal_px} mm would be {:.2} px); set --focal-px",
            2.0 * (width as f64 / (2.0 * focal_px)).atan().to_degrees(),
            focal_px_from_35mm(focal_px, width, height)
        ));
    }
    Ok(Photo {
        values,
        width,
        height,
        focal_px,
        focal_source,
        warnings,
        focal_warnings,
    })
}

#[cfg(test)]
mod tests;
