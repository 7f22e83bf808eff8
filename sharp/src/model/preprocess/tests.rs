//! Tests on photographs that the tests create, so that every byte is known.

use super::*;
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageFormat, RgbImage};

fn read(bytes: &[u8]) -> Result<Photo, ModelError> {
    photo_from_bytes(Path::new("photo"), bytes, &PhotoOptions::default())
}

fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    image.into().write_to(&mut out, ImageFormat::Png).unwrap();
    out.into_inner()
}

/// Four columns, three rows; red counts columns, green rows.
fn grid() -> RgbImage {
    RgbImage::from_fn(4, 3, |x, y| image::Rgb([x as u8 * 50, y as u8 * 50, 7]))
}

/// A directory entry: tag, type, one value (offset for rationals).
type Entry = (u16, u16, u32);

/// A PNG of [`grid`] with Exif: orientation in the main directory, `entries` in the Exif one,
/// rationals stored as numerator over 10.
fn with_exif(orientation: u16, entries: &[Entry]) -> Vec<u8> {
    with_exif_of(&grid(), orientation, entries)
}

fn with_exif_of(picture: &RgbImage, orientation: u16, entries: &[Entry]) -> Vec<u8> {
    let mut tiff = b"II*\0\x08\0\0\0\x02\0".to_vec();
    let entry = |tiff: &mut Vec<u8>, (tag, kind, value): Entry| {
        tiff.extend(tag.to_le_bytes());
        tiff.extend(kind.to_le_bytes());
        tiff.extend(1_u32.to_le_bytes());
        tiff.extend(value.to_le_bytes());
    };
    entry(&mut tiff, (0x0112, 3, u32::from(orientation)));
    let exif_at = 8 + 2 + 2 * 12 + 4;
    entry(&mut tiff, (0x8769, 4, exif_at));
    tiff.extend([0; 4]);
    tiff.extend((entries.len() as u16).to_le_bytes());
    let mut data_at = exif_at + 2 + 12 * entries.len() as u32 + 4;
    let mut data = Vec::new();
    for &(tag, kind, value) in entries {
        if kind == 5 {
            entry(&mut tiff, (tag, kind, data_at));
            data.extend(value.to_le_bytes());
            data.extend(10_u32.to_le_bytes());
            data_at += 8;
        } else {
            entry(&mut tiff, (tag, kind, value));
        }
    }
    tiff.extend([0; 4]);
    tiff.extend(data);
    let mut out = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut out);
    encoder.set_exif_metadata(tiff).unwrap();
    encoder
        .write_image(
            picture.as_raw(),
            picture.width(),
            picture.height(),
            ExtendedColorType::Rgb8,
        )
        .unwrap();
    out
}

const FOCAL_35MM: u16 = 0xa405;
const FOCAL: u16 = 0x920a;

#[test]
fn a_plain_picture_becomes_planes() {
    let photo = read(&png(grid())).unwrap();
    assert_eq!((photo.width, photo.height), (4, 3));
    assert_eq!(photo.values[3], 150.0 / 255.0);
    assert_eq!(photo.values[12 + 4], 50.0 / 255.0);
    assert_eq!(photo.values[24], 7.0 / 255.0);
}

#[test]
fn without_exif_thirty_millimetres_are_assumed_and_said() {
    let photo = read(&png(RgbImage::new(512, 512))).unwrap();
    assert_eq!(photo.focal_source, FocalSource::Default);
    assert!((photo.focal_px - 502.057_305_953_751_1).abs() < 1e-9);
    assert_eq!(photo.disparity_factor(), 0.980_580_7);
    assert!(photo.focal_warnings[0].contains("30 mm"));
}

#[test]
fn focal_length_rules() {
    let focal = |entries: &[Entry]| {
        let photo = read(&with_exif(1, entries)).unwrap();
        let mm = photo.focal_px / focal_px_from_35mm(1.0, photo.width, photo.height);
        ((mm * 1e6).round() / 1e6, photo.focal_source)
    };
    // The 35 mm equivalent takes precedence over the lens if it is at least 1 mm.
    let both = [(FOCAL_35MM, 3, 26), (FOCAL, 5, 42)];
    assert_eq!(focal(&both), (26.0, FocalSource::Equivalent35mm(26.0)));
    let unknown = [(FOCAL_35MM, 3, 0), (FOCAL, 5, 420)];
    assert_eq!(focal(&unknown), (42.0, FocalSource::Lens(42.0)));
    // Below 10 mm, the focal length is taken for a phone's.
    assert_eq!(focal(&[(FOCAL, 5, 42)]), (35.28, FocalSource::Lens(4.2)));
    assert_eq!(focal(&[(FOCAL, 5, 100)]), (10.0, FocalSource::Lens(10.0)));
    assert_eq!(focal(&[(FOCAL, 5, 0)]), (30.0, FocalSource::Default));
    assert_eq!(focal(&[]), (30.0, FocalSource::Default));
}

#[test]
fn focal_lengths_that_are_guesses_or_no_lens_has_are_warned_about() {
    let said = |entries: &[Entry]| {
        let picture = RgbImage::new(60, 40);
        let photo = read(&with_exif_of(&picture, 1, entries)).unwrap();
        photo.focal_warnings.join("; ")
    };
    assert_eq!(said(&[(FOCAL_35MM, 3, 26), (FOCAL, 5, 42)]), "");
    assert!(said(&[(FOCAL_35MM, 3, 4)]).contains("which no lens has"));
    assert!(said(&[(FOCAL, 5, 42)]).contains("8.4 times"));
    assert!(said(&[(FOCAL, 5, 420)]).contains("the size of 35 mm film"));
}

#[test]
fn shapes_that_no_camera_takes_are_taken_for_crops_where_the_file_says_no_size() {
    let said = |(width, height): (u32, u32), entries: &[Entry]| {
        let photo = read(&with_exif_of(&RgbImage::new(width, height), 1, entries)).unwrap();
        photo.focal_warnings.join("; ")
    };
    let focal = (FOCAL_35MM, 3, 26);
    for size in [
        (60, 40),
        (40, 60),
        (64, 48),
        (96, 54),
        (50, 50),
        (50, 40),
        (70, 60),
        (65, 24),
        // Rounded to whole pixels.
        (50, 33),
        (101, 76),
    ] {
        assert_eq!(said(size, &[focal]), "", "{size:?}");
    }
    for size in [(64, 32), (32, 64), (60, 43)] {
        let text = said(size, &[focal]);
        let parts = [
            "an aspect ratio that cameras do not produce",
            "px; set --focal-px",
        ];
        assert!(
            parts.iter().all(|part| text.contains(part)),
            "{size:?}: {text}"
        );
        assert!(text.contains(&format!("{}x{}", size.0, size.1)), "{text}");
    }
    // If a file states its size, that size is checked instead; without a focal length, another
    // warning is given.
    let stated = [focal, (0xa002, 4, 64), (0xa003, 4, 32)];
    assert_eq!(said((64, 32), &stated), "");
    assert!(!said((64, 32), &[]).contains("shape"));
}

#[test]
fn a_given_focal_length_wins_and_is_checked() {
    let with = |focal_px| {
        let options = PhotoOptions {
            focal_px: Some(focal_px),
            ..PhotoOptions::default()
        };
        photo_from_bytes(
            Path::new("photo"),
            &with_exif(1, &[(FOCAL_35MM, 3, 26)]),
            &options,
        )
    };
    let photo = with(500.0).unwrap();
    assert_eq!(
        (photo.focal_px, photo.focal_source),
        (500.0, FocalSource::Given)
    );
    assert!(photo.warnings.is_empty() && photo.focal_warnings.is_empty());
    assert!(with(0.0).is_err());
    assert!(with(f64::NAN).is_err());
    assert!(with(f64::INFINITY).is_err());
}

#[test]
fn millimetres_given_for_pixels_are_warned_about() {
    let said = |focal_px| {
        let options = PhotoOptions {
            focal_px: Some(focal_px),
            ..PhotoOptions::default()
        };
        let photo = photo_from_bytes(Path::new("p"), &png(RgbImage::new(360, 240)), &options);
        photo.unwrap().warnings.join("; ")
    };
    let text = said(26.0);
    assert!(
        text.contains("perhaps it is in millimetres") && text.contains("26 mm would be 260.00 px"),
        "{text}"
    );
    assert_eq!(said(75.0), "");
}

/// A picture that is smaller than its file states, from a sensor that is smaller than film.
#[test]
fn shrunk_photographs_are_warned_about_once() {
    const COLUMNS_PER_UNIT: u16 = 0xa20e;
    const UNIT: u16 = 0xa210;
    let said = |size: (u32, u32), entries: &[Entry]| {
        let photo = read(&with_exif_of(&RgbImage::new(size.0, size.1), 1, entries)).unwrap();
        photo.focal_warnings
    };
    // A 50 mm lens on 25 columns a millimetre: 600 columns are 24 mm wide.
    let pitch = [(FOCAL, 5, 500), (COLUMNS_PER_UNIT, 5, 250), (UNIT, 3, 4)];
    let size = [(0xa002, 4, 600), (0xa003, 4, 400)];
    let text = said((300, 200), &[&pitch[..], &size].concat());
    assert_eq!(text.len(), 1, "{text:?}");
    for part in [
        "625.00 px if it was resized",
        "1250.00 px if it was cropped",
        "24.0 mm wide",
    ] {
        assert!(text[0].contains(part), "{text:?}");
    }
    // The size is that of the small picture, or none.
    let equivalent = (FOCAL_35MM, 3, 75);
    for sizes in [&[(0xa002, 4, 300), (0xa003, 4, 200)][..], &[]] {
        let text = said((300, 200), &[&[equivalent][..], &pitch, sizes].concat());
        assert_eq!(text.len(), 1, "{text:?}");
        assert!(
            text[0].contains("which is right if it was cropped") && text[0].contains("1250.00 px"),
            "{text:?}"
        );
    }
    assert_eq!(
        said((600, 400), &[&[equivalent][..], &pitch, &size].concat()),
        [""; 0]
    );
}

#[test]
fn orientations() {
    // The first pixel of the upright picture, as (column, row) of the stored one.
    for (orientation, size, first) in [
        (1, (4, 3), (0, 0)),
        (3, (4, 3), (3, 2)),
        (6, (3, 4), (0, 2)),
        (8, (3, 4), (3, 0)),
        (2, (4, 3), (0, 0)),
        (5, (4, 3), (0, 0)),
        (9, (4, 3), (0, 0)),
    ] {
        let photo = read(&with_exif(orientation, &[(FOCAL_35MM, 3, 26)])).unwrap();
        assert_eq!((photo.width, photo.height), size, "{orientation}");
        let at = |plane: usize| (photo.values[plane * 12] * 255.0).round() as u8 / 50;
        assert_eq!((at(0), at(1)), first, "{orientation}");
        assert_eq!(
            photo.warnings.len(),
            usize::from([2, 5].contains(&orientation))
        );
    }
}

/// Files written by Pillow, and the four colours that each contains.
#[test]
fn every_kind_of_file() {
    const COLOURS: [[u8; 3]; 4] = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [128; 3]];
    const GREYS: [[u8; 3]; 4] = [[76; 3], [150; 3], [29; 3], [128; 3]];
    const TWO: [[u8; 3]; 4] = [[0; 3], [255; 3], [0; 3], [255; 3]];
    for (file, quadrants, tolerance) in [
        ("palette.png", COLOURS, 0.0),
        ("palette_transparent.png", COLOURS, 0.0),
        ("bilevel.png", TWO, 0.0),
        ("grey.png", GREYS, 0.0),
        ("grey_alpha.png", GREYS, 0.0),
        ("grey16.png", GREYS, 0.0),
        ("rgba.png", COLOURS, 0.0),
        ("grey.jpg", GREYS, 1.0),
        ("cmyk.jpg", COLOURS, 2.0),
    ] {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/golden/photographs");
        let photo = load_photo(&Path::new(folder).join(file), &PhotoOptions::default()).unwrap();
        assert_eq!((photo.width, photo.height), (32, 32), "{file}");
        for (k, quadrant) in quadrants.iter().enumerate() {
            let at = (8 + 16 * (k / 2)) * 32 + 8 + 16 * (k % 2);
            for (c, &expected) in quadrant.iter().enumerate() {
                let found = photo.values[c * 32 * 32 + at] * 255.0;
                assert!(
                    (found - f32::from(expected)).abs() <= tolerance + 1e-4,
                    "{file}, quadrant {k}, channel {c}: {found}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn unusable_files_are_refused() {
    let whole = png(grid());
    for bytes in [b"<html>404</html>".as_slice(), &whole[..whole.len() - 20]] {
        assert!(matches!(read(bytes), Err(ModelError::Photograph { .. })));
    }
    let refused = |photo: Result<Photo, ModelError>, expected: &str| match photo {
        Err(ModelError::File { reason, .. }) => assert!(reason.contains(expected), "{reason}"),
        other => panic!("{other:?}"),
    };
    refused(read(&png(RgbImage::new(1, 5))), "1x5");
    let small = PhotoOptions {
        max_pixels: 11,
        ..PhotoOptions::default()
    };
    refused(
        photo_from_bytes(Path::new("photo"), &whole, &small),
        "4x3 has more than 11 pixels",
    );
    let absent = load_photo(Path::new("absent.png"), &small);
    assert!(
        matches!(absent, Err(ModelError::File { path, .. }) if path == Path::new("absent.png"))
    );
}
