//! User-supplied pictures: formats of [`sharp::image_file`], EXR, and float arrays in `.npy` or `.safetensors`.

use std::path::{Path, PathBuf};

use exr::prelude::{AttributeValue, MetaData, read_first_rgba_layer_from_file};
use image::{ImageBuffer, Luma, Rgb, Rgb32FImage, RgbImage};
use sharp::camera::Intrinsics;
use sharp::color::{Quantization, quantize, srgb_from_linear};
use sharp::image_file::{
    self, AlphaRule, ExrTransfer, ImageFileError, OrientationRule, PictureRules,
};
use sharp_checkpoint::{Checkpoint, CheckpointError};
use sharp_datasets::format::{npy, picture};
use sharp_datasets::{DatasetError, files};
use sharp_metrics::{Picture, PictureError};

use crate::io::rendering_files::TRANSFER;

/// Why a picture could not be read; names the file.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    #[error(transparent)]
    Decode(#[from] DatasetError),
    #[error("{}: {reason}", path.display())]
    Malformed { path: PathBuf, reason: String },
    #[error(transparent)]
    Tensors(#[from] CheckpointError),
    #[error("{}: {source}", path.display())]
    Values { path: PathBuf, source: PictureError },
}

/// Picture extensions, in lower case.
pub const EXTENSIONS: [&str; 11] = [
    "png",
    "jpg",
    "jpeg",
    "exr",
    "npy",
    "safetensors",
    "webp",
    "tif",
    "tiff",
    "bmp",
    "jfif",
];

/// Rules for reading a user-supplied picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PictureReading {
    pub rules: PictureRules,
    /// Transfer function of EXR files; if `None`, an EXR that does not state its transfer function
    /// is an error.
    pub exr: Option<ExrTransfer>,
}

/// A picture, and a note for each conversion that affects scores. The note names the setting that controls the
/// conversion.
#[derive(Debug)]
pub struct ReadPicture {
    pub picture: Picture,
    pub notes: Vec<String>,
    /// Whether the file is a JPEG, whatever its extension.
    pub is_jpeg: bool,
    /// Whether an alpha channel, dropped under the rules, has pixels that are not opaque.
    pub dropped_alpha: bool,
}

/// Largest plausible number of pixels per stored byte of a losslessly compressed picture.
const MAX_COMPRESSION: u64 = 1 << 11;

/// Whether the name ends in one of [`EXTENSIONS`], in any case.
pub fn is_picture(path: &Path) -> bool {
    extension(path).is_some_and(|found| EXTENSIONS.contains(&found.as_str()))
}

/// Reads a picture by the default rules; see [`read_as`].
///
/// # Errors
/// If [`read_as`] fails.
pub fn read(path: &Path) -> Result<Picture, ReadError> {
    Ok(read_as(path, &PictureReading::default())?.picture)
}

/// Reads a picture: formats of [`image_file`] as 8 bit; `.exr`, `.npy` and `.safetensors` as floats
/// [H, W, 3] of sRGB-encoded values in 0..1. An EXR written by our renderer is known to be linear
/// and counts as composited over its background.
///
/// # Errors
/// The error names the file and the reason: unreadable, not a picture, wrong shape, values not finite or
/// outside 0..1, or a choice that `reading` must state.
pub fn read_as(path: &Path, reading: &PictureReading) -> Result<ReadPicture, ReadError> {
    if path.is_dir() {
        let inside = files::what_lies_in(path);
        return Err(malformed(
            path,
            format!("a folder, not a picture; {inside}"),
        ));
    }
    let mut notes = Vec::new();
    let (mut is_jpeg, mut dropped_alpha) = (false, false);
    let picture = match extension(path).as_deref() {
        Some("exr") => Picture::RgbF32(read_exr(path, reading, &mut notes)?),
        Some("npy") => {
            let array = npy::parse(&files::read(path)?)
                .map_err(|error| malformed(path, error.to_string()))?;
            from_floats(path, &array.shape, array.values)?
        }
        Some("safetensors") => read_safetensors(path)?,
        _ => {
            let decode = |bytes: &[u8]| Ok(image_file::read(bytes, &reading.rules, None)?);
            let found = files::parse(path, decode)?;
            notes = found.notes(&reading.rules);
            is_jpeg = found.header.format == "JPEG";
            dropped_alpha = matches!(found.alpha, image_file::Alpha::Varying(_))
                && reading.rules.alpha == AlphaRule::Drop;
            Picture::Rgb8(found.image.into_rgb8())
        }
    };
    picture.check().map_err(|source| ReadError::Values {
        path: path.to_owned(),
        source,
    })?;
    Ok(ReadPicture {
        picture,
        notes,
        is_jpeg,
        dropped_alpha,
    })
}

/// Width and height from the header of a compressed picture; `None` for arrays, which need no more memory than their
/// files. If the picture has an EXIF orientation, `rules` must say how to treat it.
///
/// # Errors
/// If the header cannot be read, or has an EXIF orientation for which `rules` have no rule.
pub fn dimensions(path: &Path, rules: &PictureRules) -> Result<Option<(u32, u32)>, ReadError> {
    match extension(path).as_deref() {
        Some("exr") => return exr_dimensions(path).map(Some),
        Some("npy" | "safetensors") => return Ok(None),
        _ => {}
    }
    let header = picture::header(path)?;
    match (header.orientation, rules.orientation) {
        (1, _) | (_, OrientationRule::Stored) => Ok(Some(header.size)),
        (_, OrientationRule::Upright) => Ok(Some(header.upright_size())),
        (orientation, OrientationRule::Auto) => Err(malformed(
            path,
            format!(
                "its EXIF orientation is {orientation}; choose whether to read it as stored (orientation=stored) or \
                 turned (orientation=upright)"
            ),
        )),
    }
}

/// Reads a picture and rounds floats to the nearest of 256 levels.
pub fn read_rgb8(path: &Path) -> Result<RgbImage, ReadError> {
    Ok(match read(path)? {
        Picture::Rgb8(image) => image,
        Picture::RgbF32(image) => to_rgb8(&image),
    })
}

/// Rounds floats in 0..1 to the nearest of 256 levels.
pub fn to_rgb8(image: &Rgb32FImage) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        Rgb(image
            .get_pixel(x, y)
            .0
            .map(|value| quantize(value, Quantization::Round)))
    })
}

/// `[3, height, width]` in 0..1 from interleaved bytes.
pub fn planes(image: &RgbImage) -> Vec<f32> {
    let bytes = image.as_raw();
    (0..3)
        .flat_map(|channel| {
            let values = bytes.iter().skip(channel).step_by(3);
            values.map(|&v| f32::from(v) / 255.0)
        })
        .collect()
}

fn extension(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}

fn malformed(path: &Path, reason: impl Into<String>) -> ReadError {
    ReadError::Malformed {
        path: path.to_owned(),
        reason: reason.into(),
    }
}

/// Size of the first layer. Reading allocates memory for this size, so the size must be plausible
/// for the file's length.
fn exr_dimensions(path: &Path) -> Result<(u32, u32), ReadError> {
    let bytes = std::fs::metadata(path)
        .map_err(|error| malformed(path, error.to_string()))?
        .len();
    let meta = MetaData::read_from_file(path, false);
    let meta = meta.map_err(|error| malformed(path, error.to_string()))?;
    let mut first = None;
    for header in &meta.headers {
        let size = header.layer_size;
        let pixels = size.width() as u64 * size.height() as u64;
        if pixels > Intrinsics::MAX_PIXELS || pixels > bytes.saturating_mul(MAX_COMPRESSION) {
            return Err(malformed(
                path,
                format!(
                    "the header claims {}x{} pixels in a file of {bytes} bytes",
                    size.width(),
                    size.height()
                ),
            ));
        }
        first.get_or_insert((size.width() as u32, size.height() as u32));
    }
    first.ok_or_else(|| malformed(path, "it has no layer"))
}

/// Linear value above which clipping to white changes the pixel: it exceeds 1 by half an 8-bit level.
const BEYOND_WHITE: f32 = 1.0045;

fn read_exr(
    path: &Path,
    reading: &PictureReading,
    notes: &mut Vec<String>,
) -> Result<Rgb32FImage, ReadError> {
    let (LinearPicture { mut rgb, alpha }, said) = read_rgba(path)?;
    let percent = |count: usize| 100.0 * count as f64 / alpha.len() as f64;
    let is_ours = said.is_some();
    let transfer = said.or(reading.exr).ok_or_else(|| {
        malformed(
            path,
            "it does not state whether its values are linear light or sRGB-encoded; set exr=linear (what most \
             programs write) or exr=srgb",
        )
    })?;
    // OpenEXR's colours are premultiplied; used unchanged, they are composited over black.
    let varying = alpha.iter().filter(|alpha| **alpha < 1.0).count();
    let white = match reading.rules.alpha {
        AlphaRule::Refuse if varying > 0 && !is_ours => {
            let error = ImageFileError::Alpha {
                percent: percent(varying),
            };
            return Err(malformed(path, error.to_string()));
        }
        AlphaRule::White => 1.0,
        _ => 0.0,
    };
    let is_brighter = |pixel: &&Rgb<f32>| pixel.0.iter().any(|v| *v > BEYOND_WHITE);
    let brighter = rgb.pixels().filter(is_brighter).count();
    if transfer == ExrTransfer::Linear && brighter > 0 && !is_ours {
        notes.push(format!(
            "{:.2} % of its pixels are brighter than 1 and are clipped to 1 (exr=linear); tone-map the picture like \
             those that it is compared with",
            percent(brighter)
        ));
    }
    for (pixel, alpha) in rgb.pixels_mut().zip(alpha.iter()) {
        for value in &mut pixel.0 {
            *value += white * (1.0 - alpha.clamp(0.0, 1.0));
            // Infinities are rejected later, like NaN.
            if transfer == ExrTransfer::Linear && value.is_finite() {
                *value = srgb_from_linear(value.clamp(0.0, 1.0));
            }
        }
    }
    Ok(rgb)
}

/// Coverage (alpha), 0..1.
pub type Alpha = ImageBuffer<Luma<f32>, Vec<f32>>;

/// A rendering in linear light, before sRGB encoding.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearPicture {
    /// Linear light, premultiplied, over the background.
    pub rgb: Rgb32FImage,
    pub alpha: Alpha,
}

/// Reads an EXR that our renderer wrote.
///
/// # Errors
/// The error names the file and the reason: unreadable, values that are not finite, or a file not
/// known to be linear.
pub fn read_linear(path: &Path) -> Result<LinearPicture, ReadError> {
    let (picture, said) = read_rgba(path)?;
    let mut values = picture.rgb.iter().chain(picture.alpha.iter());
    match (
        said == Some(ExrTransfer::Linear),
        values.all(|value| value.is_finite()),
    ) {
        (true, true) => Ok(picture),
        (false, _) => Err(malformed(path, "it is not marked as linear")),
        (_, false) => Err(malformed(path, "it has values that are not finite")),
    }
}

/// The first layer as stored, and its transfer function if our renderer wrote the file, else
/// `None`.
fn read_rgba(path: &Path) -> Result<(LinearPicture, Option<ExrTransfer>), ReadError> {
    let reason = |error: exr::error::Error| malformed(path, error.to_string());
    exr_dimensions(path)?;
    let image = read_first_rgba_layer_from_file(
        path,
        |size, _| LinearPicture {
            rgb: Rgb32FImage::new(size.width() as u32, size.height() as u32),
            alpha: Alpha::new(size.width() as u32, size.height() as u32),
        },
        |image, at, (r, g, b, a): (f32, f32, f32, f32)| {
            let (x, y) = (at.x() as u32, at.y() as u32);
            image.rgb.put_pixel(x, y, Rgb([r, g, b]));
            image.alpha.put_pixel(x, y, Luma([a]));
        },
    )
    .map_err(reason)?;
    let transfer = image.layer_data.attributes.other.get(TRANSFER.as_bytes());
    let said = match transfer {
        Some(AttributeValue::Text(text)) => text.to_string().parse().ok(),
        _ => None,
    };
    Ok((image.layer_data.channel_data.pixels, said))
}

fn read_safetensors(path: &Path) -> Result<Picture, ReadError> {
    let file = Checkpoint::open(path)?;
    let names: Vec<&str> = file.names().collect();
    let [name] = names.as_slice() else {
        return Err(malformed(
            path,
            format!("{} tensors; expected one tensor [H, W, 3]", names.len()),
        ));
    };
    let shape = file.shape(name)?.to_vec();
    let values = file.tensor_f32(name)?;
    from_floats(path, &shape, values)
}

fn from_floats(path: &Path, shape: &[usize], values: Vec<f32>) -> Result<Picture, ReadError> {
    let wrong = || malformed(path, format!("shape {shape:?}; expected [H, W, 3]"));
    let &[height, width, 3] = shape else {
        return Err(wrong());
    };
    let (Ok(width), Ok(height)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(wrong());
    };
    Rgb32FImage::from_raw(width, height, values)
        .map(Picture::RgbF32)
        .ok_or_else(wrong)
}
