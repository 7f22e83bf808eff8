//! A photograph from a file: pixels, orientation, focal length.
//!
//! PNG and JPEG, read as the release reads them but where its way loses the picture:
//!
//! | picture | here | release |
//! |---|---|---|
//! | palette, two levels | its colours | the indices as grey |
//! | grey with alpha | grey | an error |
//! | 16 bit | divided by 65535 | divided by 255, beyond 1 |
//! | CMYK | converted to RGB by (1 − ink)(1 − black) | cyan, magenta and yellow as red, green and blue |
//!
//! HEIC, which the release reads, is not. As there, grey is repeated in all three channels, alpha is dropped, not
//! composited, and colour profiles are not applied.

use std::io::Cursor;
use std::path::Path;

use exif::{Context, Exif, In, Tag, Value};
use image::DynamicImage;

use super::ModelError;
use super::predictor::{Planes, planes_of};
use crate::image_file;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotoOptions {
    /// Focal length in pixels of the (upright) image, instead of what the file says.
    pub focal_px: Option<f64>,
    /// Larger images are refused before they are decoded.
    pub max_pixels: u64,
}

impl Default for PhotoOptions {
    fn default() -> Self {
        Self {
            focal_px: None,
            max_pixels: 250_000_000,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FocalSource {
    Given,
    /// The file's equivalent for 35 mm film, millimetres.
    Equivalent35mm(f64),
    /// The file's focal length, millimetres; below 10 it is taken for a phone's and multiplied by
    /// 8.4, as the release does.
    Lens(f64),
    /// Nothing known: 30 mm on 35 mm film. This silently sets the metric scale.
    Default,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Photo {
    /// `[3, height, width]`, sRGB-encoded, 0..1.
    pub values: Vec<f32>,
    pub width: usize,
    pub height: usize,
    pub focal_px: f64,
    pub focal_source: FocalSource,
    pub warnings: Vec<String>,
}

impl Photo {
    /// For [`Predictor::predict`](super::Predictor::predict).
    pub fn planes(&self) -> Planes<'_> {
        Planes {
            values: &self.values,
            width: self.width,
            height: self.height,
        }
    }

    /// Focal length over width: what turns disparity into metres. The width counts alone, also
    /// for upright pictures.
    pub fn disparity_factor(&self) -> f32 {
        (self.focal_px / self.width as f64) as f32
    }
}

/// Focal length of the default: millimetres on 35 mm film.
const DEFAULT_FOCAL_MM: f64 = 30.0;

/// Pixels of `focal_mm` on 35 mm film, by the diagonal, for an image of `width × height`.
pub fn focal_px_from_35mm(focal_mm: f64, width: usize, height: usize) -> f64 {
    let diagonal = (width as f64).hypot(height as f64);
    focal_mm * diagonal / 36.0_f64.hypot(24.0)
}

/// Reads a photograph.
///
/// # Errors
/// [`ModelError::Photograph`] when it cannot be decoded whole; [`ModelError::File`] when it cannot
/// be read, is below 2×2 or above the limit of pixels, or has a focal length that is not positive.
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
    let (width, height) = image_file::dimensions(Cursor::new(bytes)).map_err(undecodable)?;
    if width < 2 || height < 2 {
        return refuse(format!("an image of {width}x{height}: at least 2x2 needed"));
    }
    if u64::from(width) * u64::from(height) > options.max_pixels {
        return refuse(format!(
            "an image of {width}x{height} has more than {} pixels",
            options.max_pixels
        ));
    }
    let image = image_file::decode(bytes).map_err(undecodable)?;
    let exif = exif::Reader::new()
        .read_from_container(&mut Cursor::new(bytes))
        .ok();
    let mut warnings = Vec::new();
    let image = upright(image, exif.as_ref(), &mut warnings);
    let (width, height) = (image.width() as usize, image.height() as usize);
    let values = match image.color().bytes_per_pixel() / image.color().channel_count() {
        1 => planes_of(&image.into_rgb8(), |v| f32::from(v) / 255.0),
        _ => planes_of(&image.into_rgb16(), |v| f32::from(v) / 65535.0),
    };
    let focal_source = match options.focal_px {
        Some(_) => FocalSource::Given,
        None => focal_source(exif.as_ref()),
    };
    let focal_mm = match focal_source {
        FocalSource::Equivalent35mm(mm) => mm,
        FocalSource::Lens(mm) if mm < 10.0 => mm * 8.4,
        FocalSource::Lens(mm) => mm,
        FocalSource::Given | FocalSource::Default => DEFAULT_FOCAL_MM,
    };
    if focal_source == FocalSource::Default {
        warnings.push(format!(
            "no focal length in the file: {DEFAULT_FOCAL_MM} mm on 35 mm film assumed, which sets \
             the metric scale; give the focal length in pixels if you know it"
        ));
    }
    let focal_px = match options.focal_px {
        Some(px) => px,
        None => focal_px_from_35mm(focal_mm, width, height),
    };
    if !(focal_px.is_finite() && focal_px > 0.0) {
        return refuse(format!("a focal length of {focal_px} pixels"));
    }
    Ok(Photo {
        values,
        width,
        height,
        focal_px,
        focal_source,
        warnings,
    })
}

/// Turns the image as its file asks; mirrored orientations are left alone, as in the release.
fn upright(image: DynamicImage, exif: Option<&Exif>, warnings: &mut Vec<String>) -> DynamicImage {
    let orientation = number(exif, &[(Context::Tiff, Tag::Orientation)]);
    match orientation.map(|v| v as i64) {
        Some(3) => image.rotate180(),
        Some(6) => image.rotate90(),
        Some(8) => image.rotate270(),
        Some(mirrored @ (2 | 4 | 5 | 7)) => {
            warnings.push(format!(
                "orientation {mirrored} is mirrored and ignored, as in the release"
            ));
            image
        }
        _ => image,
    }
}

fn focal_source(exif: Option<&Exif>) -> FocalSource {
    let either = |tag| number(exif, &[(Context::Tiff, tag), (Context::Exif, tag)]);
    match either(Tag::FocalLengthIn35mmFilm) {
        Some(mm) if mm >= 1.0 => FocalSource::Equivalent35mm(mm),
        _ => match either(Tag::FocalLength) {
            // 0 is as good as no entry; the release would continue with it.
            Some(mm) if mm.is_finite() && mm > 0.0 => FocalSource::Lens(mm),
            _ => FocalSource::Default,
        },
    }
}

/// The first number that one of the tags holds; the main directory goes before the Exif one.
fn number(exif: Option<&Exif>, tags: &[(Context, Tag)]) -> Option<f64> {
    let exif = exif?;
    let field = tags
        .iter()
        .find_map(|(context, tag)| exif.get_field(Tag(*context, tag.number()), In::PRIMARY))?;
    match &field.value {
        Value::Rational(v) => v.first().map(exif::Rational::to_f64),
        Value::SRational(v) => v.first().map(exif::SRational::to_f64),
        Value::Float(v) => v.first().map(|&v| f64::from(v)),
        Value::Double(v) => v.first().copied(),
        other => other.get_uint(0).map(f64::from),
    }
}

#[cfg(test)]
mod tests;
