//! Files made on the spot.

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
        decode_rgb8(&png(gray.into())).unwrap().as_raw(),
        &[7, 7, 7, 200, 200, 200]
    );
    let rgba = image::RgbaImage::from_vec(1, 1, vec![1, 2, 3, 0]).unwrap();
    assert_eq!(decode_rgb8(&png(rgba.into())).unwrap().as_raw(), &[1, 2, 3]);
    let levels: Vec<u16> = (0..=u16::MAX).flat_map(|v| [v, 0, 65535]).collect();
    let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_vec(256, 256, levels).unwrap();
    let found = decode_rgb8(&png(deep.into())).unwrap();
    for (v, rgb) in found.pixels().enumerate() {
        assert_eq!(rgb.0, [((v + 128) / 257) as u8, 0, 255]);
    }
    let grey = image::ImageBuffer::<image::Luma<u16>, _>::from_vec(2, 1, vec![128, 129]).unwrap();
    assert_eq!(
        decode_rgb8(&png(grey.into())).unwrap().as_raw(),
        &[0, 0, 0, 1, 1, 1]
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
        (b"\x76\x2f\x31\x01\x02\0\0\0", "OpenEXR"),
        (b"\x93NUMPY\x01\0", "NumPy"),
        (b"hello", "neither"),
    ] {
        let error = decode(bytes).unwrap_err();
        assert!(
            matches!(error, ImageFileError::Format(what) if what.contains(reason)),
            "{error}"
        );
    }
}

#[test]
fn a_header_cannot_make_us_allocate() {
    let mut bytes = png(image::GrayImage::new(1, 1).into());
    // IHDR: width at 16, height at 20, its checksum at 29.
    bytes[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    let crc = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&crc.to_be_bytes());
    for error in [
        decode(&bytes).unwrap_err(),
        dimensions(Cursor::new(&bytes)).unwrap_err(),
    ] {
        assert!(
            matches!(error, ImageFileError::Oversized { width: 65536, .. }),
            "{error}"
        );
    }
}

#[test]
fn truncated_files_are_refused() {
    let mut jpeg = Cursor::new(Vec::new());
    let picture = RgbImage::from_fn(64, 64, |x, y| image::Rgb([(x * y) as u8, 7, 200]));
    picture.write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
    for whole in [jpeg.into_inner(), png(picture.clone().into())] {
        assert_eq!(dimensions(Cursor::new(&whole)).unwrap(), (64, 64));
        let half = decode(&whole[..whole.len() / 2]).unwrap_err();
        assert!(matches!(half, ImageFileError::Damaged(_)), "{half}");
    }
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
    // Beyond every camera, whatever the file can hold.
    assert!(check_size(1 << 14, 1 << 14, u64::MAX, None).is_ok());
    let error = check_size(1 << 14, (1 << 14) + 1, u64::MAX, None).unwrap_err();
    assert!(matches!(error, ImageFileError::TooLarge { .. }), "{error}");
    let deep = image::ImageBuffer::<image::Rgb<u16>, _>::new(3, 2);
    assert_eq!(bits_per_pixel(&png(deep.into())), Some(48));
    assert_eq!(bits_per_pixel(&[0xFF, 0xD8, 0xFF, 0xE0].repeat(9)), None);
}

#[test]
fn a_palette_of_a_broken_length_is_refused_before_it_is_decoded() {
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x04PLTEabcd".to_vec();
    png.extend(crc32(&png[12..]).to_be_bytes());
    let error = png_chunks::check_complete(&png).unwrap_err();
    assert!(error.contains("4 bytes"), "{error}");
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
