//! Decoding of every picture that is scored, used as input, or used as a mask: PNG, JPEG, WebP, TIFF and BMP,
//! recognised by their first bytes and decoded only if complete.
//!
//! JPEG decoders fill missing data with grey, and a half-grey picture must neither be scored nor used as input, so a
//! file's structure is checked before its pixels are decoded. Alpha, orientation and colour profiles are detected
//! ([`Header`], [`Picture`]) and handled as [`PictureRules`] require; nothing is dropped silently.
//!
//! * [`focal`]: the focal length that a file states.
//! * `format`: recognition, completeness, and limits of size.
//! * `profile`: colour profiles, converted to sRGB.
//! * `rules`: treatment of alpha, colours and orientation.

pub mod focal;
mod format;
mod jpeg_markers;
mod png_chunks;
mod profile;
mod rules;

use std::collections::{BTreeMap, HashSet};
use std::io::{BufRead, Cursor, Read, Seek};

use exif::{In, Tag, Value};
use image::codecs::png::PngEncoder;
use image::metadata::Orientation;
use image::{
    ColorType, DynamicImage, ExtendedColorType, ImageBuffer, ImageDecoder, ImageEncoder as _,
    ImageFormat, ImageReader, ImageResult, Pixel, RgbImage,
};

use crate::camera::Intrinsics;

pub use profile::{MatrixProfile, Profile};
pub use rules::{AlphaRule, ColorRule, ExrTransfer, OrientationRule, PictureRules, parsed};

/// Errors of decoding a picture file.
#[derive(Debug, thiserror::Error)]
pub enum ImageFileError {
    /// The format is not supported; names the detected format, if known.
    #[error("{0}")]
    Format(&'static str),
    /// The file is truncated, damaged, or violates its format.
    #[error("{0}")]
    Damaged(String),
    #[error("the picture is {width}x{height}, so it has no pixels")]
    Empty { width: u32, height: u32 },
    #[error("the header declares {width}x{height} pixels, which {file_bytes} bytes cannot hold")]
    Oversized {
        width: u32,
        height: u32,
        file_bytes: u64,
    },
    /// The picture has more pixels than a camera may have.
    #[error(
        "the picture is {width}x{height}, which exceeds the maximum of {} pixels",
        Intrinsics::MAX_PIXELS
    )]
    TooLarge { width: u32, height: u32 },
    #[error(
        "{percent:.1} % of its pixels are not opaque; alpha=black or alpha=white composites it over that colour, \
         alpha=drop uses its colours as stored"
    )]
    Alpha { percent: f64 },
    #[error(
        "its colour profile '{name}' cannot be converted to sRGB ({reason}); convert the file, or \
         use its stored values with color=as-stored"
    )]
    Profile { name: String, reason: &'static str },
    #[error(
        "its pixels are floating-point numbers without a stated transfer curve; save it as 8 or 16 bit"
    )]
    FloatingPoint,
    #[error(
        "its 16-bit values end at {highest}, as if {bits}-bit values had been stored unscaled; multiply them by \
         {factor}"
    )]
    Unscaled {
        highest: u16,
        bits: u32,
        factor: u32,
    },
    #[error(
        "its 16-bit values are multiples of 256, as if 8-bit values had been multiplied by 256 instead of 257, which \
         darkens them by 0.4 %; store the 8-bit values"
    )]
    Shifted,
    #[error(transparent)]
    Decoder(#[from] image::ImageError),
}

impl From<std::io::Error> for ImageFileError {
    fn from(error: std::io::Error) -> Self {
        Self::Decoder(error.into())
    }
}

/// Format, size, orientation and colour profile, from a file's header.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Actual format, regardless of the file's name: `PNG`, `JPEG`, `WebP`, `TIFF`, `BMP`.
    pub format: &'static str,
    /// Width and height in pixels, as stored.
    pub size: (u32, u32),
    pub color: ColorType,
    /// EXIF orientation, 1 to 8; 1 is upright, and the default if absent.
    pub orientation: u8,
    pub profile: Profile,
}

impl Header {
    /// Size after applying the EXIF orientation.
    pub fn upright_size(&self) -> (u32, u32) {
        match self.orientation {
            5..=8 => (self.size.1, self.size.0),
            _ => self.size,
        }
    }
}

/// Alpha channel of a picture, and the share of its pixels that are not opaque.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Alpha {
    None,
    Opaque,
    /// Percentage of pixels that are not opaque.
    Varying(f64),
}

/// A decoded picture, and the processing applied to it.
#[derive(Debug)]
pub struct Picture {
    /// sRGB without alpha, at the stored bit depth.
    pub image: DynamicImage,
    pub header: Header,
    pub alpha: Alpha,
    /// True if the EXIF orientation was applied.
    pub turned: bool,
}

impl Picture {
    /// Notes for readers of scores: one sentence per conversion, which names the setting for it.
    /// Empty for an opaque, upright sRGB picture.
    pub fn notes(&self, rules: &PictureRules) -> Vec<String> {
        let mut notes = Vec::new();
        let orientation = self.header.orientation;
        if orientation != 1 {
            notes.push(if self.turned {
format!(
                    "turned upright by its EXIF orientation {orientation} (orientation=stored would not turn it)"
                )
} else {
format!(
                    "its EXIF orientation {orientation} is not applied (orientation=upright would turn it)"
                )
});
        }
        if let (Some(ignored), ColorRule::Convert) = (self.header.profile.ignored(), rules.color) {
            notes.push(format!("it has {ignored}"));
        }
        if let Some(name) = self.header.profile.name() {
            notes.push(match rules.color {
                ColorRule::Convert => format!(
                    "converted from its colour profile '{name}' to sRGB (color=as-stored would not convert it)"
                ),
                ColorRule::AsStored => format!(
                    "its colour profile '{name}' is ignored (color=convert would convert it to sRGB)"
                ),
            });
        }
        if let (Alpha::Varying(percent), AlphaRule::Drop) = (self.alpha, rules.alpha) {
            notes.push(format!(
                "its alpha is dropped, not composited, in the {percent:.1} % of its pixels that are not opaque \
                 (alpha=black or alpha=white would composite)"
            ));
        }
        notes
    }
}

/// Decodes a picture according to `rules`; palettes are expanded, CMYK becomes RGB. `fit` is the expected size.
///
/// # Errors
/// [`ImageFileError`] if the file is damaged or of an unsupported format, or needs a rule that `rules` leaves open.
pub fn read(
    bytes: &[u8],
    rules: &PictureRules,
    fit: Option<(u32, u32)>,
) -> Result<Picture, ImageFileError> {
    decode(bytes, rules, fit, refuse_unscaled)
}

/// Decodes a map of integers, such as depth in millimetres, as stored.
///
/// # Errors
/// As for [`read`], but 16-bit pictures with only small values are accepted.
pub fn read_map(bytes: &[u8]) -> Result<Picture, ImageFileError> {
    decode(bytes, &PictureRules::AS_STORED, None, |_| Ok(()))
}

fn decode(
    bytes: &[u8],
    rules: &PictureRules,
    fit: Option<(u32, u32)>,
    check: fn(&DynamicImage) -> Result<(), ImageFileError>,
) -> Result<Picture, ImageFileError> {
    let format = format::of(bytes)?;
    format::check_complete(bytes, format)?;
    dimensions(&mut Cursor::new(bytes))?;
    let mut file = Cursor::new(bytes);
    let (decoder, header) = open(&mut file, format)?;
    let mut image = DynamicImage::from_decoder(decoder)?;
    if matches!(
        image,
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_)
    ) {
        return Err(ImageFileError::FloatingPoint);
    }
    check(&image)?;
    if rules.color == ColorRule::Convert {
        image = match &header.profile {
            Profile::Srgb | Profile::Ignored { .. } => image,
            Profile::Matrix { to_srgb, .. } => to_srgb.convert(image),
            Profile::Other { name, reason } => {
                return Err(ImageFileError::Profile {
                    name: name.clone(),
                    reason,
                });
            }
        };
    }
    let alpha = alpha_of(&image);
    image = match (alpha, rules.alpha) {
        (Alpha::Varying(percent), AlphaRule::Refuse) => {
            return Err(ImageFileError::Alpha { percent });
        }
        (Alpha::Varying(_), AlphaRule::Black) => composited(image, 0.0),
        (Alpha::Varying(_), AlphaRule::White) => composited(image, 1.0),
        _ => without_alpha(image),
    };
    let turned = rules.turns(&header, fit);
    if turned && let Some(orientation) = Orientation::from_exif(header.orientation) {
        image.apply_orientation(orientation);
    }
    Ok(Picture {
        image,
        header,
        alpha,
        turned,
    })
}

/// Like [`read`], but converts to 8-bit RGB: grey is replicated; 16 bits become 8 by v / 257, rounded.
///
/// # Errors
/// As for [`read`].
pub fn read_rgb8(
    bytes: &[u8],
    rules: &PictureRules,
    fit: Option<(u32, u32)>,
) -> Result<RgbImage, ImageFileError> {
    Ok(read(bytes, rules, fit)?.image.into_rgb8())
}

/// Checks that a file is complete, without decoding it (except TIFF, whose pixels can be anywhere in the file).
///
/// # Errors
/// [`ImageFileError`] if the file is truncated or of an unsupported format.
pub fn check_complete(bytes: &[u8]) -> Result<(), ImageFileError> {
    let format = format::of(bytes)?;
    if format == ImageFormat::Tiff {
        DynamicImage::from_decoder(open(&mut Cursor::new(bytes), format)?.0)?;
    }
    format::check_complete(bytes, format)
}

/// Reads a file's header without decoding its pixels.
///
/// # Errors
/// Every [`ImageFileError`] that the header reveals.
pub fn header(file: &mut dyn ReadSeek) -> Result<Header, ImageFileError> {
    dimensions(file)?;
    file.rewind()?;
    let start = start_of(file)?;
    match format::of(&start)? {
        // The JPEG decoder takes ownership of the whole file.
        format @ ImageFormat::Jpeg => {
            let mut head = Cursor::new(jpeg_markers::head(file)?);
            Ok(open(&mut head, format)?.1)
        }
        format => Ok(open(file, format)?.1),
    }
}

/// Width and height as stored; reads only the file's header.
///
/// # Errors
/// Every [`ImageFileError`] that the header reveals.
pub fn dimensions(file: &mut dyn ReadSeek) -> Result<(u32, u32), ImageFileError> {
    let file_bytes = file.seek(std::io::SeekFrom::End(0))?;
    file.rewind()?;
    let start = start_of(file)?;
    let format = format::of(&start)?;
    let size = match format {
        ImageFormat::Jpeg => {
            let mut head = Cursor::new(jpeg_markers::head(file)?);
            let head: &mut dyn ReadSeek = &mut head;
            ImageReader::with_format(head, format).into_dimensions()?
        }
        _ => ImageReader::with_format(file, format).into_dimensions()?,
    };
    format::check_size(size, file_bytes, &start, format)?;
    Ok(size)
}

/// Encodes a picture as PNG; 16-bit samples are given in native byte order. Unlike `image`'s `save`, this does not
/// compile the encoders of all other formats.
///
/// # Errors
/// If the samples do not fit the size.
pub fn encode_png(
    samples: &[u8],
    (width, height): (u32, u32),
    color: ExtendedColorType,
) -> ImageResult<Vec<u8>> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes).write_image(samples, width, height, color)?;
    Ok(bytes)
}

/// A seekable source of bytes. Used as a trait object, so that each decoder is compiled once, in this crate.
pub trait ReadSeek: BufRead + Seek {}

impl<T: BufRead + Seek> ReadSeek for T {}

fn start_of(file: &mut dyn ReadSeek) -> Result<Vec<u8>, ImageFileError> {
    let mut start = Vec::with_capacity(32);
    file.take(32).read_to_end(&mut start)?;
    file.rewind()?;
    Ok(start)
}

fn open<'a>(
    mut file: &'a mut dyn ReadSeek,
    format: ImageFormat,
) -> Result<(Box<dyn ImageDecoder + 'a>, Header), ImageFileError> {
    let chunks = match format {
        ImageFormat::Png => png_chunks::before_pixels(&mut file)?,
        _ => BTreeMap::new(),
    };
    let mut reader = ImageReader::with_format(file, format);
    // The size was checked against the file's length, which is a tighter limit than any fixed one.
    reader.no_limits();
    let mut decoder = reader.into_decoder()?;
    let icc = decoder.icc_profile().ok().flatten();
    let exif = decoder.exif_metadata().ok().flatten();
    let exif = exif.and_then(|bytes| exif::Reader::new().read_raw(bytes).ok());
    // Adobe RGB is marked in EXIF by cameras that embed no profile.
    let is_adobe_rgb = exif
        .as_ref()
        .and_then(|exif| exif.get_field(Tag::InteroperabilityIndex, In::PRIMARY))
        .is_some_and(|field| match &field.value {
            Value::Ascii(texts) => texts.iter().any(|text| text.starts_with(b"R03")),
            _ => false,
        });
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let header = Header {
        format: match format {
            ImageFormat::Png => "PNG",
            ImageFormat::Jpeg => "JPEG",
            ImageFormat::WebP => "WebP",
            ImageFormat::Tiff => "TIFF",
            _ => "BMP",
        },
        size: decoder.dimensions(),
        color: decoder.color_type(),
        orientation: orientation.to_exif(),
        profile: match (chunks.get(b"cICP").and_then(|cicp| cicp.first_chunk()), icc) {
            (Some(cicp), _) => Profile::of_cicp(*cicp),
            (None, Some(icc)) => Profile::of_icc(&icc),
            (None, None) if is_adobe_rgb => Profile::adobe_rgb(),
            (None, None) => match png_chunks::against_srgb(&chunks) {
                Some(chunks) => Profile::Ignored { chunks },
                None => Profile::Srgb,
            },
        },
    };
    Ok((Box::new(decoder), header))
}

/// The scaling of 16-bit levels is not checked in pictures with fewer pixels.
const FEWEST_PIXELS: u32 = 256;
/// Levels that are all multiples of 256 could be a coincidence if the picture has fewer different levels.
const FEWEST_LEVELS: usize = 8;

/// Rejects 16-bit pictures that are nearly black because their values have only 8 to 12 bits, and
/// pictures whose 8-bit values were multiplied by 256. Accepts pictures converted from 8 bits
/// properly, whose values are multiples of 257, and pictures with too few pixels or levels to
/// judge.
fn refuse_unscaled(image: &DynamicImage) -> Result<(), ImageFileError> {
    let (values, has_alpha, channels) = match image {
        DynamicImage::ImageLuma16(image) => (image.as_raw(), false, 1),
        DynamicImage::ImageLumaA16(image) => (image.as_raw(), true, 2),
        DynamicImage::ImageRgb16(image) => (image.as_raw(), false, 3),
        DynamicImage::ImageRgba16(image) => (image.as_raw(), true, 4),
        _ => return Ok(()),
    };
    let colors = || {
        let pixels = values.chunks_exact(channels);
        pixels.flat_map(|pixel| &pixel[..channels - usize::from(has_alpha)])
    };
    let highest = colors().copied().max().unwrap_or(0);
    let bits = (u16::BITS - highest.leading_zeros()).next_multiple_of(2);
    let is_picture = image.width() * image.height() >= FEWEST_PIXELS;
    if is_picture && (8..=12).contains(&bits) && colors().any(|value| value % 257 != 0) {
        return Err(ImageFileError::Unscaled {
            highest,
            bits,
            factor: 65_535 / ((1 << bits) - 1),
        });
    }
    let is_shifted = is_picture && colors().all(|value| value % 256 == 0);
    if is_shifted && colors().collect::<HashSet<_>>().len() >= FEWEST_LEVELS {
        return Err(ImageFileError::Shifted);
    }
    Ok(())
}

fn alpha_of(image: &DynamicImage) -> Alpha {
    fn share<P: Pixel>(image: &ImageBuffer<P, Vec<P::Subpixel>>, opaque: P::Subpixel) -> Alpha {
        let pixels = image.pixels().len();
        let last = usize::from(P::CHANNEL_COUNT) - 1;
        let varying = image.pixels().filter(|p| p.channels()[last] != opaque);
        match varying.count() {
            0 => Alpha::Opaque,
            count => Alpha::Varying(100.0 * count as f64 / pixels as f64),
        }
    }
    match image {
        DynamicImage::ImageLumaA8(image) => share(image, u8::MAX),
        DynamicImage::ImageRgba8(image) => share(image, u8::MAX),
        DynamicImage::ImageLumaA16(image) => share(image, u16::MAX),
        DynamicImage::ImageRgba16(image) => share(image, u16::MAX),
        _ => Alpha::None,
    }
}

fn without_alpha(image: DynamicImage) -> DynamicImage {
    match image {
        DynamicImage::ImageLumaA8(_) => image.into_luma8().into(),
        DynamicImage::ImageRgba8(_) => image.into_rgb8().into(),
        DynamicImage::ImageLumaA16(_) => image.into_luma16().into(),
        DynamicImage::ImageRgba16(_) => image.into_rgb16().into(),
        opaque => opaque,
    }
}

/// Composites over black (0) or white (1) in encoded values, rounded to the picture's own levels.
fn composited(image: DynamicImage, background: f64) -> DynamicImage {
    let level = |color: f64, alpha: f64, highest: f64| {
        let alpha = alpha / highest;
        (color * alpha + background * highest * (1.0 - alpha)).round()
    };
    if image.color().bytes_per_pixel() / image.color().channel_count() > 1 {
        let image = image.into_rgba16();
        let over = ImageBuffer::from_fn(image.width(), image.height(), |x, y| {
            let [rgb @ .., alpha] = image[(x, y)].0.map(f64::from);
            image::Rgb(rgb.map(|color| level(color, alpha, 65535.0) as u16))
        });
        return over.into();
    }
    let image = image.into_rgba8();
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let [rgb @ .., alpha] = image[(x, y)].0.map(f64::from);
        image::Rgb(rgb.map(|color| level(color, alpha, 255.0) as u8))
    })
    .into()
}

#[cfg(test)]
mod tests;
