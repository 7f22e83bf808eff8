//! Photographs in files: PNG or JPEG, told apart by their first bytes, decoded only when complete.
//!
//! Decoders of JPEG fill what is missing with grey, and a half grey picture must neither be scored
//! nor predicted from; so a file's structure is checked before its pixels are decoded. Colour
//! profiles and orientation are left to the caller.

mod jpeg_markers;
mod png_chunks;

use std::io::{BufRead, Cursor, Read, Seek};

use image::{DynamicImage, ImageFormat, ImageReader, RgbImage};

/// Why a file was not decoded.
#[derive(Debug, thiserror::Error)]
pub enum ImageFileError {
    /// Neither PNG nor JPEG; says what it is instead, where that shows.
    #[error("{0}")]
    Format(&'static str),
    /// Ends before it should, damaged, or against its format's rules.
    #[error("{0}")]
    Damaged(String),
    #[error("the picture is {width}x{height}, without a pixel")]
    Empty { width: u32, height: u32 },
    #[error("the header promises {width}x{height} pixels, which {file_bytes} bytes cannot hold")]
    Oversized {
        width: u32,
        height: u32,
        file_bytes: u64,
    },
    #[error("the picture is {width}x{height}, more than {MAX_PIXELS} pixels")]
    TooLarge { width: u32, height: u32 },
    #[error(transparent)]
    Decoder(#[from] image::ImageError),
}

/// Beyond this a header is taken for a mistake or a bomb: 2^28 pixels, eleven times a 6048×4032 photograph.
pub const MAX_PIXELS: u64 = 1 << 28;

impl From<std::io::Error> for ImageFileError {
    fn from(error: std::io::Error) -> Self {
        Self::Decoder(error.into())
    }
}

/// Decodes a PNG or JPEG; pixels keep their depth and channels, palettes are expanded, CMYK becomes
/// RGB.
///
/// # Errors
/// [`ImageFileError`].
pub fn decode(bytes: &[u8]) -> Result<DynamicImage, ImageFileError> {
    decode_up_to(u64::MAX, bytes)
}

fn decode_up_to(pixels: u64, bytes: &[u8]) -> Result<DynamicImage, ImageFileError> {
    let format = format_of(bytes)?;
    match format {
        ImageFormat::Jpeg => jpeg_markers::check_complete(bytes),
        _ => png_chunks::check_complete(bytes),
    }
    .map_err(ImageFileError::Damaged)?;
    let (width, height) = dimensions(Cursor::new(bytes))?;
    if u64::from(width) * u64::from(height) > pixels {
        return Err(ImageFileError::TooLarge { width, height });
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    // The size was checked against the file's, which is tighter than any fixed limit.
    reader.no_limits();
    Ok(reader.decode()?)
}

/// As [`decode`], to 8-bit RGB, of at most [`MAX_PIXELS`]: grey is replicated, alpha dropped (not composited), 16 bits become
/// 8 by v / 257, rounded.
///
/// # Errors
/// [`ImageFileError`].
pub fn decode_rgb8(bytes: &[u8]) -> Result<RgbImage, ImageFileError> {
    Ok(decode_up_to(MAX_PIXELS, bytes)?.into_rgb8())
}

/// Width and height from a file's header, which is all that is read of it.
///
/// # Errors
/// [`ImageFileError`], as far as the header shows.
pub fn dimensions(mut file: impl BufRead + Seek) -> Result<(u32, u32), ImageFileError> {
    let file_bytes = file.seek(std::io::SeekFrom::End(0))?;
    file.rewind()?;
    let mut start = Vec::with_capacity(32);
    file.by_ref().take(32).read_to_end(&mut start)?;
    file.rewind()?;
    let format = format_of(&start)?;
    let (width, height) = ImageReader::with_format(file, format).into_dimensions()?;
    check_size(width, height, file_bytes, bits_per_pixel(&start))?;
    Ok((width, height))
}

fn format_of(bytes: &[u8]) -> Result<ImageFormat, ImageFileError> {
    const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(32)]).to_ascii_lowercase();
    let text = text.trim_start();
    let what = if bytes.starts_with(PNG) {
        return Ok(ImageFormat::Png);
    } else if bytes.starts_with(b"\xff\xd8\xff") {
        return Ok(ImageFormat::Jpeg);
    } else if bytes.is_empty() {
        "the file is empty"
    } else if text.starts_with("version https://git-lfs") {
        "a Git LFS pointer, not the picture itself (run `git lfs pull`)"
    } else if text.starts_with("<!doctype html") || text.starts_with("<html") {
        "an HTML page, not a picture (a failed download?)"
    } else if bytes.get(4..8) == Some(b"ftyp") {
        "a HEIC or AVIF picture; convert it to PNG or JPEG"
    } else if bytes.starts_with(b"II*\0") || bytes.starts_with(b"MM\0*") {
        "a TIFF picture; convert it to PNG or JPEG"
    } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        "a WebP picture; convert it to PNG or JPEG"
    } else if bytes.starts_with(b"\x76\x2f\x31\x01") {
        "an OpenEXR file; photographs are sRGB-encoded PNG or JPEG"
    } else if bytes.starts_with(b"\x93NUMPY") {
        "a NumPy array; photographs are sRGB-encoded PNG or JPEG"
    } else {
        "neither a PNG nor a JPEG picture"
    };
    Err(ImageFileError::Format(what))
}

/// What a pixel takes in a PNG before it is deflated, from the start of the file; `None` for a JPEG.
fn bits_per_pixel(start: &[u8]) -> Option<u64> {
    // After signature, length, name, width and height.
    let (Some(depth), Some(kind)) = (start.get(24), start.get(25)) else {
        return Some(1);
    };
    let channels = match kind {
        2 => 3,
        4 => 2,
        6 => 4,
        // Gray or an index into a palette.
        _ => 1,
    };
    start
        .starts_with(b"\x89PNG")
        .then(|| (u64::from(*depth) * channels).max(1))
}

/// Refuses a size that no file of this length can hold. Deflate expands at most 1032-fold; a JPEG
/// takes at least one bit a block of 8×8 pixels.
fn check_size(
    width: u32,
    height: u32,
    file_bytes: u64,
    bits_per_pixel: Option<u64>,
) -> Result<(), ImageFileError> {
    const DEFLATE: u64 = 1032;
    const BLOCKS_PER_BYTE: u64 = 8;
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(ImageFileError::Empty { width, height });
    }
    let least = match bits_per_pixel {
        Some(bits) => u128::from(pixels) * u128::from(bits) / 8 / u128::from(DEFLATE),
        None => u128::from(pixels) / 64 / u128::from(BLOCKS_PER_BYTE),
    };
    if least > u128::from(file_bytes) {
        return Err(ImageFileError::Oversized {
            width,
            height,
            file_bytes,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
