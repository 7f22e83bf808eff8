//! The decoder of photographs: PNG or JPEG, told apart by their first bytes.
//!
//! Whoever turns a photograph into pixels should call this, so that damaged files are refused
//! everywhere and a picture has the same pixels for every purpose:
//!
//! | function | gives | for |
//! |---|---|---|
//! | [`read`], [`parse`] | 8-bit RGB | datasets and scoring |
//! | [`decode`] | the stored samples, up to 16 bits and with alpha | whoever needs more than 8 bits |
//! | [`read_mask`] | 8-bit gray | masks |
//! | [`dimensions`] | the size, from the header | checks before decoding |
//!
//! In 8-bit RGB, gray is replicated, palettes are expanded, CMYK is converted, alpha is dropped (not
//! composited: datasets use it as a mask, if at all), 16 bits become 8 by v / 257, rounded. Pixels
//! are taken as sRGB whatever profile is embedded. An EXIF orientation is never applied here, because
//! the intrinsics of COLMAP, nerfstudio and ETH3D describe the picture as stored; a caller without
//! intrinsics turns the picture itself.

use std::io::{BufReader, Cursor, Read};
use std::path::Path;

use image::{DynamicImage, GrayImage, ImageDecoder, ImageFormat, ImageReader, RgbImage};

use super::{FormatError, jpeg_markers, png_chunks};
use crate::{DatasetError, files};

/// Decodes a photograph.
///
/// # Errors
/// Names the file: unreadable, not a PNG or JPEG (a Git LFS pointer or a web page saved under an
/// image's name is recognised), truncated, failing its checksum, or promising more pixels than a
/// file of its length can hold.
pub fn read(path: &Path) -> Result<RgbImage, DatasetError> {
    files::parse(path, parse)
}

/// As [`read`], from bytes, and with the same errors.
pub fn parse(bytes: &[u8]) -> Result<RgbImage, FormatError> {
    let image = match decode(bytes)? {
        DynamicImage::ImageRgb8(image) => return Ok(image),
        other => other,
    };
    let color = image.color();
    let channels = usize::from(color.channel_count());
    let bytes_per_sample = usize::from(color.bytes_per_pixel()) / channels;
    let level: fn(&[u8]) -> u8 = match bytes_per_sample {
        1 => |sample| sample[0],
        // v / 257 to the nearest level: 65535 becomes 255, and v · 257 comes back as v.
        2 => |v| ((u32::from(u16::from_ne_bytes([v[0], v[1]])) + 128) / 257) as u8,
        _ => {
            return Err(FormatError::Unsupported(format!(
                "pixels of kind {color:?}"
            )));
        }
    };
    let mut rgb = RgbImage::new(image.width(), image.height());
    let pixels = image.as_bytes().chunks_exact(channels * bytes_per_sample);
    for (into, pixel) in rgb.chunks_exact_mut(3).zip(pixels) {
        let samples = pixel.chunks_exact(bytes_per_sample);
        // One or two channels are gray (and alpha), three or four colour.
        match channels {
            1 | 2 => into.fill(level(&pixel[..bytes_per_sample])),
            _ => into
                .iter_mut()
                .zip(samples)
                .for_each(|(value, sample)| *value = level(sample)),
        }
    }
    Ok(rgb)
}

/// Decodes a mask: 8-bit gray, whatever the file has.
///
/// # Errors
/// As [`read`].
pub fn read_mask(path: &Path) -> Result<GrayImage, DatasetError> {
    files::parse(path, |bytes| Ok(decode(bytes)?.into_luma8()))
}

/// Decodes a photograph without converting its samples.
///
/// # Errors
/// As [`read`], without the file's name.
pub fn decode(bytes: &[u8]) -> Result<DynamicImage, FormatError> {
    let format = sniff(bytes)?;
    if format == ImageFormat::Jpeg {
        // The decoder fills what is missing with gray; a truncated file must not be scored.
        jpeg_markers::check_complete(bytes)?;
    } else {
        png_chunks::check_complete(bytes)?;
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    // The bound below is tighter than any fixed limit, and lets a 50-megapixel picture pass.
    reader.no_limits();
    let decoder = reader.into_decoder().map_err(|e| invalid!("{e}"))?;
    let (width, height) = decoder.dimensions();
    check_size(width, height, bytes.len() as u64, bits_per_pixel(bytes))?;
    DynamicImage::from_decoder(decoder).map_err(|e| invalid!("{e}"))
}

/// Width and height of a photograph, from its header.
///
/// # Errors
/// As [`read`], as far as the header shows.
pub fn dimensions(path: &Path) -> Result<(u32, u32), DatasetError> {
    let mut file = files::open(path)?;
    let mut start = [0; 32];
    let mut filled = 0;
    while filled < start.len() {
        match file.read(&mut start[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) => return Err(DatasetError::io(path, e)),
        }
    }
    let malformed = |error: FormatError| DatasetError::format(path, error);
    let format = sniff(&start[..filled]).map_err(malformed)?;
    let length = file
        .metadata()
        .map_err(|e| DatasetError::io(path, e))?
        .len();
    let (width, height) = ImageReader::with_format(BufReader::new(files::open(path)?), format)
        .into_dimensions()
        .map_err(|e| malformed(invalid!("{e}")))?;
    let bits = bits_per_pixel(&start[..filled]);
    check_size(width, height, length, bits).map_err(malformed)?;
    Ok((width, height))
}

fn sniff(bytes: &[u8]) -> Result<ImageFormat, FormatError> {
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
    } else {
        "neither a PNG nor a JPEG picture"
    };
    Err(what.into())
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
) -> Result<(), FormatError> {
    const DEFLATE: u64 = 1032;
    const BLOCKS_PER_BYTE: u64 = 8;
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(invalid!("the picture is {width}x{height}, without a pixel"));
    }
    let least = match bits_per_pixel {
        Some(bits) => u128::from(pixels) * u128::from(bits) / 8 / u128::from(DEFLATE),
        None => u128::from(pixels) / 64 / u128::from(BLOCKS_PER_BYTE),
    };
    if least > u128::from(file_bytes) {
        return Err(invalid!(
            "the header promises {width}x{height} pixels, which {file_bytes} bytes cannot hold"
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(image: DynamicImage) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn every_pixel_layout_becomes_rgb() {
        let gray = image::GrayImage::from_vec(2, 1, vec![7, 200]).unwrap();
        assert_eq!(
            parse(&png(gray.into())).unwrap().as_raw(),
            &[7, 7, 7, 200, 200, 200]
        );
        let rgba = image::RgbaImage::from_vec(1, 1, vec![1, 2, 3, 0]).unwrap();
        assert_eq!(parse(&png(rgba.into())).unwrap().as_raw(), &[1, 2, 3]);
        let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_vec(
            2,
            1,
            vec![0, 128, 129, 257, 65535, 65406],
        )
        .unwrap();
        assert_eq!(
            parse(&png(deep.into())).unwrap().as_raw(),
            &[0, 0, 1, 1, 255, 254]
        );
    }

    #[test]
    fn what_is_not_a_picture_is_named() {
        for (bytes, reason) in [
            (b"".as_slice(), "empty"),
            (b"version https://git-lfs.github.com/spec/v1\n", "LFS"),
            (b"\n<!DOCTYPE HTML><html>", "HTML"),
            (b"\0\0\0\x18ftypheic", "HEIC"),
            (b"RIFF\0\0\0\0WEBPVP8 ", "WebP"),
            (b"hello", "neither"),
        ] {
            let error = parse(bytes).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }

    #[test]
    fn a_header_cannot_make_us_allocate() {
        let mut bytes = png(image::GrayImage::new(1, 1).into());
        // IHDR: width at 16, height at 20, its checksum at 29.
        bytes[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
        let crc = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.to_be_bytes());
        let error = parse(&bytes).unwrap_err();
        assert!(error.to_string().contains("cannot hold"), "{error}");
    }

    #[test]
    fn what_a_file_can_hold_depends_on_its_pixels() {
        // A megapixel: 1,048,576 bytes of gray deflate to 1,016 at best, of 16-bit colour to 6,096.
        for (bits, least) in [
            (Some(8), 1016),
            (Some(48), 6096),
            (Some(1), 127),
            (None, 2048),
        ] {
            assert!(check_size(1024, 1024, least, bits).is_ok(), "{bits:?}");
            assert!(check_size(1024, 1024, least - 2, bits).is_err(), "{bits:?}");
        }
        let deep = image::ImageBuffer::<image::Rgb<u16>, _>::new(3, 2);
        assert_eq!(bits_per_pixel(&png(deep.into())), Some(48));
        assert_eq!(bits_per_pixel(&[0xFF, 0xD8, 0xFF, 0xE0].repeat(9)), None);
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(u32::MAX, |mut crc, byte| {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
            }
            crc
        })
    }
}
