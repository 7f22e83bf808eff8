//! Detection of a file's format from its first bytes, and checks that the file is complete.

use image::ImageFormat;

use super::{ImageFileError, jpeg_markers, png_chunks};
use crate::camera::Intrinsics;

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Detects the format of a picture; an unsupported format is an error.
pub(super) fn of(bytes: &[u8]) -> Result<ImageFormat, ImageFileError> {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(32)]).to_ascii_lowercase();
    let text = text.trim_start();
    let brand = (bytes.get(4..8) == Some(b"ftyp"))
        .then(|| bytes.get(8..12))
        .flatten();
    let what = if bytes.starts_with(PNG) {
        return Ok(ImageFormat::Png);
    } else if bytes.starts_with(b"\xff\xd8\xff") {
        return Ok(ImageFormat::Jpeg);
    } else if bytes.starts_with(b"II*\0") || bytes.starts_with(b"MM\0*") {
        return Ok(ImageFormat::Tiff);
    } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        return Ok(ImageFormat::WebP);
    } else if bytes.starts_with(b"BM") && bytes.get(6..10) == Some(&[0; 4]) {
        return Ok(ImageFormat::Bmp);
    } else if bytes.is_empty() {
        "the file is empty"
    } else if text.starts_with("version https://git-lfs") {
        "a Git LFS pointer, not the picture itself (run `git lfs pull`)"
    } else if text.starts_with("<!doctype html") || text.starts_with("<html") {
        "an HTML page, not a picture (a failed download?)"
    } else if let Some(b"avif" | b"avis") = brand {
        "an AVIF picture; `avifdec IN.avif OUT.png` or `magick IN.avif OUT.png` converts it"
    } else if brand.is_some() {
        "a HEIC picture; `heif-convert IN.heic OUT.png` or `magick IN.heic OUT.png` converts it"
    } else if bytes.starts_with(b"GIF8") {
        "a GIF; `magick 'IN.gif[0]' OUT.png` converts its first frame"
    } else if bytes.get(4..8) == Some(b"jP  ") || bytes.starts_with(b"\xff\x4f\xff\x51") {
        "a JPEG 2000 picture; `magick IN.jp2 OUT.png` converts it"
    } else if bytes.get(4..8) == Some(b"JXL ") || bytes.starts_with(b"\xff\x0a") {
        "a JPEG XL picture; `djxl IN.jxl OUT.png` converts it"
    } else if bytes.starts_with(b"#?") {
        "a Radiance HDR picture; `magick IN.hdr OUT.exr` converts it to OpenEXR with linear light"
    } else if let [b'P', b'1'..=b'6', b' ' | b'\r' | b'\n', ..] = bytes {
        "a PNM picture; `magick IN.ppm OUT.png` converts it"
    } else if bytes.starts_with(b"\x76\x2f\x31\x01") {
        "an OpenEXR file, which is accepted only as a prediction or a target of `metrics`"
    } else if bytes.starts_with(b"\x93NUMPY") {
        "a NumPy array, which is accepted only as a prediction or a target of `metrics`"
    } else {
        "neither PNG, JPEG, WebP, TIFF nor BMP"
    };
    Err(ImageFileError::Format(what))
}

/// Rejects a truncated file if truncation can be detected without decoding.
pub(super) fn check_complete(bytes: &[u8], format: ImageFormat) -> Result<(), ImageFileError> {
    // RIFF stores the number of bytes after its first eight; BMP stores the size of the whole file
    // (0 in some files).
    let promised = |at: usize| {
        let length = bytes.get(at..)?.first_chunk::<4>()?;
        Some(u32::from_le_bytes(*length) as usize)
    };
    let needed = match format {
        ImageFormat::Jpeg => {
            return jpeg_markers::check_complete(bytes).map_err(ImageFileError::Damaged);
        }
        ImageFormat::Png => {
            return png_chunks::check_complete(bytes).map_err(ImageFileError::Damaged);
        }
        ImageFormat::WebP => promised(4).map_or(0, |length| length.saturating_add(8)),
        ImageFormat::Bmp => promised(2).unwrap_or(0),
        // TIFF strips can be anywhere in the file; the decoder detects missing ones.
        _ => 0,
    };
    if needed <= bytes.len() {
        Ok(())
    } else {
        Err(ImageFileError::Damaged(format!(
            "the file has only {} of {needed} bytes (truncated?)",
            bytes.len()
        )))
    }
}

/// Lower bound on the bytes per pixel of a file, derived from its first bytes, `start`.
fn least_bytes_per_pixel(start: &[u8], format: ImageFormat) -> f64 {
    /// Maximum expansion factor of Deflate.
    const DEFLATE: f64 = 1032.0;
    match format {
        // JPEG needs at least one bit per block of 8×8 pixels.
        ImageFormat::Jpeg => 1.0 / 64.0 / 8.0,
        // A lossless WebP of a single colour has no data.
        ImageFormat::WebP => 0.0,
        ImageFormat::Png => png_bits(start) / 8.0 / DEFLATE,
        _ => 1.0 / 8.0 / DEFLATE,
    }
}

/// Bits per pixel of a PNG before compression.
fn png_bits(start: &[u8]) -> f64 {
    // After the signature, chunk length, chunk name, width and height.
    let (Some(depth), Some(kind)) = (start.get(24), start.get(25)) else {
        return 1.0;
    };
    let channels = match kind {
        2 => 3.0,
        4 => 2.0,
        6 => 4.0,
        // Grey or palette index: one sample per pixel.
        _ => 1.0,
    };
    (f64::from(*depth) * channels).max(1.0)
}

/// Rejects a size that no file of this length can contain. `start` is the file's first bytes.
pub(super) fn check_size(
    (width, height): (u32, u32),
    file_bytes: u64,
    start: &[u8],
    format: ImageFormat,
) -> Result<(), ImageFileError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(ImageFileError::Empty { width, height });
    }
    if (pixels as f64 * least_bytes_per_pixel(start, format)).floor() > file_bytes as f64 {
        return Err(ImageFileError::Oversized {
            width,
            height,
            file_bytes,
        });
    }
    if pixels > Intrinsics::MAX_PIXELS {
        return Err(ImageFileError::TooLarge { width, height });
    }
    Ok(())
}
