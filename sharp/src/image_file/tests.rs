//! Tests on files that the tests create.

use super::*;

const DROP: PictureRules = PictureRules {
    alpha: AlphaRule::Drop,
    color: ColorRule::Convert,
    orientation: OrientationRule::Auto,
};

fn decode(bytes: &[u8]) -> Result<DynamicImage, ImageFileError> {
    Ok(read(bytes, &DROP, None)?.image)
}

fn decode_rgb8(bytes: &[u8]) -> Result<RgbImage, ImageFileError> {
    read_rgb8(bytes, &DROP, None)
}

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
        (b"\0\0\0\x18ftypavif", "AVIF"),
        (b"GIF89a", "GIF"),
        (b"\0\0\0\x0cjP  \r\n", "JPEG 2000"),
        (b"\x76\x2f\x31\x01\x02\0\0\0", "OpenEXR"),
        (b"\x93NUMPY\x01\0", "NumPy"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "Radiance HDR"),
        (b"P6\n2 2\n255\n", "PNM"),
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
        dimensions(&mut Cursor::new(&bytes)).unwrap_err(),
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
        assert_eq!(dimensions(&mut Cursor::new(&whole)).unwrap(), (64, 64));
        let half = decode(&whole[..whole.len() / 2]).unwrap_err();
        assert!(matches!(half, ImageFileError::Damaged(_)), "{half}");
    }
}

#[test]
fn what_a_file_can_hold_depends_on_its_pixels() {
    // At best, deflate reduces a megapixel of 8-bit grey (1,048,576 bytes) to 1,016 bytes, and one
    // of 16-bit colour to 6,096.
    let start = |kind, depth| [&[0; 24][..], &[depth, kind, 0, 0]].concat();
    for (start, format, least) in [
        (start(0, 8), ImageFormat::Png, 1016),
        (start(2, 16), ImageFormat::Png, 6096),
        (start(0, 1), ImageFormat::Png, 127),
        (vec![], ImageFormat::Jpeg, 2048),
    ] {
        let check = |bytes| format::check_size((1024, 1024), bytes, &start, format);
        assert!(check(least).is_ok(), "{format:?}");
        assert!(check(least - 2).is_err(), "{format:?}");
    }
    // Sizes beyond every camera are rejected, whatever the file can hold.
    let check = |size| format::check_size(size, u64::MAX, &[], ImageFormat::Jpeg);
    assert!(check((1 << 14, 1 << 14)).is_ok());
    let error = check((1 << 14, (1 << 14) + 1)).unwrap_err();
    assert!(matches!(error, ImageFileError::TooLarge { .. }), "{error}");
}

#[test]
fn alpha_is_refused_composited_or_dropped_and_opaque_alpha_is_none() {
    let alpha =
        |alpha| png(image::RgbaImage::from_pixel(2, 1, image::Rgba([100, 200, 0, alpha])).into());
    let under = |rule, bytes: &[u8]| {
        let rules = PictureRules {
            alpha: rule,
            ..PictureRules::default()
        };
        Ok::<_, ImageFileError>(read(bytes, &rules, None)?.image.into_rgb8()[(0, 0)].0)
    };
    let half = alpha(51);
    let error = under(AlphaRule::Refuse, &half).unwrap_err();
    assert!(matches!(error, ImageFileError::Alpha { percent: 100.0 }));
    assert!(error.to_string().contains("alpha=white"));
    assert_eq!(under(AlphaRule::Black, &half).unwrap(), [20, 40, 0]);
    assert_eq!(under(AlphaRule::White, &half).unwrap(), [224, 244, 204]);
    assert_eq!(under(AlphaRule::Drop, &half).unwrap(), [100, 200, 0]);
    for rule in AlphaRule::ALL {
        assert_eq!(under(*rule, &alpha(255)).unwrap(), [100, 200, 0]);
    }
    let deep = image::ImageBuffer::from_pixel(1, 1, image::Rgba([0_u16, 65535, 6553, 13107]));
    let deep = png(DynamicImage::ImageRgba16(deep));
    assert_eq!(under(AlphaRule::White, &deep).unwrap(), [204, 255, 209]);
}

#[test]
fn a_picture_is_turned_where_only_its_upright_form_fits() {
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
    // TIFF, big-endian: one entry, orientation 6.
    let exif = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    image::ImageEncoder::set_exif_metadata(&mut encoder, exif.to_vec()).unwrap();
    encoder.encode_image(&RgbImage::new(6, 4)).unwrap();
    let found = header(&mut Cursor::new(&bytes)).unwrap();
    assert_eq!((found.orientation, found.upright_size()), (6, (4, 6)));
    for (rule, fit, turned) in [
        (OrientationRule::Auto, None, true),
        (OrientationRule::Auto, Some((6, 4)), false),
        (OrientationRule::Auto, Some((4, 6)), true),
        (OrientationRule::Stored, Some((4, 6)), false),
        (OrientationRule::Upright, Some((6, 4)), true),
    ] {
        let rules = PictureRules {
            orientation: rule,
            ..PictureRules::default()
        };
        let picture = read(&bytes, &rules, fit).unwrap();
        assert_eq!(picture.turned, turned, "{rule} {fit:?}");
        assert_eq!(picture.image.width(), if turned { 4 } else { 6 });
        assert_eq!(picture.notes(&rules).len(), 1);
    }
}

#[test]
fn formats_are_told_by_their_bytes_and_read_alike() {
    let picture = RgbImage::from_fn(16, 8, |x, y| image::Rgb([x as u8 * 9, y as u8 * 20, 7]));
    for (format, name) in [
        (ImageFormat::Png, "PNG"),
        (ImageFormat::Bmp, "BMP"),
        (ImageFormat::Tiff, "TIFF"),
        (ImageFormat::WebP, "WebP"),
    ] {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        let bytes = bytes.into_inner();
        let found = read(&bytes, &PictureRules::default(), None).unwrap();
        assert_eq!((found.header.format, found.header.size), (name, (16, 8)));
        assert!(found.notes(&PictureRules::default()).is_empty());
        assert_eq!(found.image.into_rgb8(), picture, "{name}");
        for cut in [bytes.len() / 2, bytes.len() - 3] {
            assert!(
                decode(&bytes[..cut]).is_err(),
                "{name}, {cut} of {}",
                bytes.len()
            );
        }
    }
}

#[test]
fn values_of_fewer_bits_in_sixteen_are_refused_and_dark_pictures_are_not() {
    let picture = |highest: u32, step: u32| {
        let level = move |x: u32| (x % (highest / step + 1) * step) as u16;
        let image = ImageBuffer::from_fn(64, 4, |x, y| image::Luma([level(x + 64 * y)]));
        decode(&png(DynamicImage::ImageLuma16(image))).map_err(|error| error.to_string())
    };
    for (highest, step, factor) in [(255, 5, 257), (1023, 11, 64), (4095, 45, 16)] {
        let error = picture(highest, step).unwrap_err();
        assert!(
            error.contains(&format!("multiply them by {factor}")),
            "{error}"
        );
    }
    let error = picture(256 * 255, 256).unwrap_err();
    assert!(error.contains("store the 8-bit values"), "{error}");
    // Converted from 8 bits; full range; black; levels of more than 12 bits; levels of fewer than
    // 8; few levels.
    for (highest, step) in [
        (257 * 9, 257),
        (65_535, 257),
        (0, 1),
        (5000, 17),
        (60, 1),
        (5 * 8192, 8192),
    ] {
        assert!(picture(highest, step).is_ok(), "{highest}");
    }
}

#[test]
fn a_palette_of_a_broken_length_is_refused_before_it_is_decoded() {
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x04PLTEabcd".to_vec();
    png.extend(crc32(&png[12..]).to_be_bytes());
    let error = png_chunks::check_complete(&png).unwrap_err();
    assert!(error.contains("4 bytes"), "{error}");
}

/// A PNG with chunks before its pixels.
fn with_chunks(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let plain = png(RgbImage::from_pixel(2, 2, image::Rgb([100; 3])).into());
    // After the signature and the header.
    let (head, rest) = plain.split_at(33);
    let mut bytes = head.to_vec();
    for (name, content) in chunks {
        bytes.extend((content.len() as u32).to_be_bytes());
        let checked = [&name[..], content].concat();
        bytes.extend(&checked);
        bytes.extend(crc32(&checked).to_be_bytes());
    }
    bytes.extend(rest);
    bytes
}

#[test]
fn chunks_that_contradict_srgb_are_named_where_they_alone_speak() {
    let words =
        |values: &[u32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_be_bytes()).collect() };
    let gamma = |value: u32| words(&[value]);
    let srgb = [31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000];
    let rounded = srgb.map(|v: u32| v.next_multiple_of(100));
    let p3 = [31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000];
    let (right, linear) = (gamma(45455), gamma(100_000));
    let (rounded, wide) = (words(&rounded), words(&p3));
    let said = |chunks: &[(&[u8; 4], &[u8])], rules: &PictureRules| {
        let found = read(&with_chunks(chunks), rules, None).unwrap();
        // The values are unchanged, whatever the notes say.
        assert_eq!(found.image.to_rgb8()[(0, 0)].0, [100; 3]);
        found.notes(rules).join("; ")
    };
    let rules = PictureRules::default();
    for chunks in [
        &[(b"gAMA", &right[..])][..],
        &[(b"gAMA", &gamma(45000))],
        &[(b"gAMA", &right), (b"cHRM", &rounded)],
        &[(b"gAMA", &linear), (b"sRGB", &[0])],
        &[(b"cHRM", &wide), (b"cICP", &[1, 13, 0, 1])],
        &[(b"gAMA", &gamma(0))],
        // Chunks that are too short for their values.
        &[(b"gAMA", &[1, 2]), (b"cHRM", &wide[..31])],
    ] {
        assert_eq!(said(chunks, &rules), "", "{chunks:?}");
    }
    for (chunks, part) in [
        (&[(b"gAMA", &linear[..])][..], "(gAMA 1)"),
        (&[(b"gAMA", &gamma(55556)[..])], "(gAMA 0.55556)"),
        (&[(b"cHRM", &wide)], "(cHRM)"),
        (&[(b"cHRM", &wide), (b"gAMA", &linear)], "(gAMA 1 and cHRM)"),
    ] {
        let text = said(chunks, &rules);
        assert!(
            text.contains(part) && text.contains("ignored"),
            "{part}: {text}"
        );
        let as_stored = PictureRules {
            color: ColorRule::AsStored,
            ..rules
        };
        assert_eq!(said(chunks, &as_stored), "");
    }
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
