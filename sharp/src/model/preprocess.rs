//! A photograph from a file: pixels, orientation, focal length.
//!
//! PNG and JPEG, read as the release reads them, with these differences, where the release's way loses the picture:
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
use image::{DynamicImage, ImageDecoder, ImageReader};

use super::ModelError;
use super::predictor::Planes;

/// How to read a photograph.
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

/// Where a focal length comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FocalSource {
    /// The caller.
    Given,
    /// The file's equivalent for 35 mm film, millimetres.
    Equivalent35mm(f64),
    /// The file's focal length, millimetres; below 10 it is taken for a phone's and multiplied by
    /// 8.4, as the release does.
    Lens(f64),
    /// Nothing known: 30 mm on 35 mm film. This silently sets the metric scale.
    Default,
}

/// A photograph, upright.
#[derive(Debug, Clone, PartialEq)]
pub struct Photo {
    /// `[3, height, width]`, sRGB-encoded, 0..1.
    pub values: Vec<f32>,
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Where that comes from.
    pub focal_source: FocalSource,
    /// What the user should know.
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
/// [`ModelError::File`]: not readable, not an image, below 2×2, above the limit of pixels, a value
/// that is not finite, or a focal length given that is not positive.
pub fn load_photo(path: &Path, options: &PhotoOptions) -> Result<Photo, ModelError> {
    let bytes = std::fs::read(path).map_err(|e| ModelError::file(path, e))?;
    photo_from_bytes(&bytes, options).map_err(|reason| ModelError::file(path, reason))
}

fn photo_from_bytes(bytes: &[u8], options: &PhotoOptions) -> Result<Photo, String> {
    let mut warnings = Vec::new();
    let exif = exif::Reader::new()
        .read_from_container(&mut Cursor::new(bytes))
        .ok();
    let image = decode(bytes, options.max_pixels)?;
    let image = upright(image, exif.as_ref(), &mut warnings);
    let (width, height) = (image.width() as usize, image.height() as usize);
    let values = planes(&image);
    if !values.iter().all(|v| v.is_finite()) {
        return Err("the image has values that are not finite".into());
    }
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
        return Err(format!("a focal length of {focal_px} pixels"));
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

/// First bytes of what else people may take for a photograph: floats without a stated encoding, and whatever values.
const OTHER_FILES: [(&[u8], &str); 2] = [
    (b"\x76\x2f\x31\x01", "an OpenEXR file"),
    (b"\x93NUMPY", "a NumPy array"),
];

fn decode(bytes: &[u8], max_pixels: u64) -> Result<DynamicImage, String> {
    if let Some((_, what)) = OTHER_FILES
        .iter()
        .find(|(start, _)| bytes.starts_with(start))
    {
        return Err(format!(
            "not an image that can be read: {what}; photographs are sRGB-encoded PNG or JPEG"
        ));
    }
    check_palette(bytes)?;
    let not_an_image = |e: image::ImageError| format!("not an image that can be read: {e}");
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| e.to_string())?;
    // Sizes are checked here, by the pixel; 16 bytes are the most a pixel takes.
    let mut limits = image::Limits::no_limits();
    limits.max_alloc = Some(max_pixels.saturating_mul(16));
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(not_an_image)?;
    let (width, height) = decoder.dimensions();
    if width < 2 || height < 2 {
        return Err(format!("an image of {width}x{height}: at least 2x2 needed"));
    }
    if u64::from(width) * u64::from(height) > max_pixels {
        return Err(format!(
            "an image of {width}x{height} has more than {max_pixels} pixels"
        ));
    }
    DynamicImage::from_decoder(decoder).map_err(not_an_image)
}

/// Refuses a PNG whose palette is no list of colours: the decoder takes that for granted and would panic.
fn check_palette(bytes: &[u8]) -> Result<(), String> {
    let Some(mut rest) = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n") else {
        return Ok(());
    };
    while let Some((length, chunk)) = rest.split_first_chunk::<4>() {
        let length = u32::from_be_bytes(*length) as usize;
        if chunk.starts_with(b"PLTE") && (!length.is_multiple_of(3) || !(3..=768).contains(&length))
        {
            return Err(format!(
                "not an image that can be read: its palette has {length} bytes, which is no list of colours"
            ));
        }
        // Name, data, checksum.
        match length.checked_add(8).and_then(|whole| chunk.get(whole..)) {
            Some(after) => rest = after,
            None => break,
        }
    }
    Ok(())
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
            // The release goes on with a focal length of 0; it says as little as none.
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

/// Planes in 0..1.
fn planes(image: &DynamicImage) -> Vec<f32> {
    match image {
        DynamicImage::ImageLuma8(i) => bytes_to_planes(i.as_raw(), 1),
        DynamicImage::ImageLumaA8(i) => bytes_to_planes(i.as_raw(), 2),
        DynamicImage::ImageRgb8(i) => bytes_to_planes(i.as_raw(), 3),
        DynamicImage::ImageRgba8(i) => bytes_to_planes(i.as_raw(), 4),
        DynamicImage::ImageLuma16(i) => words_to_planes(i.as_raw(), 1),
        DynamicImage::ImageLumaA16(i) => words_to_planes(i.as_raw(), 2),
        DynamicImage::ImageRgb16(i) => words_to_planes(i.as_raw(), 3),
        DynamicImage::ImageRgba16(i) => words_to_planes(i.as_raw(), 4),
        other => to_planes(other.to_rgb32f().as_raw(), 3, |v| v),
    }
}

fn bytes_to_planes(pixels: &[u8], channels: usize) -> Vec<f32> {
    to_planes(pixels, channels, |v| f32::from(v) / 255.0)
}

fn words_to_planes(pixels: &[u16], channels: usize) -> Vec<f32> {
    to_planes(pixels, channels, |v| f32::from(v) / 65535.0)
}

/// Interleaved grey (1, 2) or colour (3, 4) channels to three planes; alpha is dropped.
fn to_planes<T: Copy>(pixels: &[T], channels: usize, value: impl Fn(T) -> f32) -> Vec<f32> {
    let mut out = Vec::with_capacity(pixels.len() / channels * 3);
    for c in 0..3 {
        let c = if channels < 3 { 0 } else { c };
        out.extend(pixels.iter().skip(c).step_by(channels).map(|&v| value(v)));
    }
    out
}

#[cfg(test)]
mod tests;
