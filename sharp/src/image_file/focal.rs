//! The focal length stated in a file, and consistency checks with the file's other metadata.

use std::io::Cursor;
use std::ops::RangeInclusive;

use exif::{Context, Exif, In, Tag, Value};

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FocalSource {
    Given,
    /// The 35 mm equivalent stated in the file, in millimetres.
    Equivalent35mm(f64),
    /// The physical focal length stated in the file, in millimetres. A value below 10 is assumed to be a phone's and
    /// multiplied by 8.4, as in the SHARP release.
    Lens(f64),
    /// No focal length is stated: assumes 30 mm (35 mm equivalent), which silently determines the
    /// metric scale.
    Default,
}

/// Default focal length: millimetres, 35 mm equivalent.
const DEFAULT_FOCAL_MM: f64 = 30.0;
/// Focal length in millimetres below which a lens is assumed to be a phone's, as in the SHARP release.
const PHONE_MM: f64 = 10.0;
/// Plausible 35 mm equivalents in millimetres, from fisheyes and action cameras to telescopes.
const LENSES_MM: RangeInclusive<f64> = 7.0..=3000.0;
/// Two values stated in a file contradict each other if they differ by more than this fraction. Smaller differences
/// occur because converters crop a few rows and millimetres are rounded.
const TOLERANCE: f64 = 0.1;
/// A picture counts as resized or cropped if a side stated in its file is larger by more than this fraction.
const SIDE_TOLERANCE: f64 = 0.02;

/// Aspect ratios (long side over short side) of cameras: 1:1, 7:6, 5:4, 4:3, 3:2, 16:9, 65:24.
const SHAPES: [f64; 7] = [
    1.0,
    7.0 / 6.0,
    1.25,
    4.0 / 3.0,
    1.5,
    16.0 / 9.0,
    65.0 / 24.0,
];

/// Converts a 35 mm equivalent focal length to pixels, by the diagonal, for an image of `width × height`.
pub fn focal_px_from_35mm(focal_mm: f64, width: usize, height: usize) -> f64 {
    px_from_35mm(focal_mm, (width as f64, height as f64))
}

fn px_from_35mm(focal_mm: f64, (width, height): (f64, f64)) -> f64 {
    focal_mm * width.hypot(height) / 36.0_f64.hypot(24.0)
}

/// Focal length of a photograph according to its file.
#[derive(Debug)]
pub struct Focal {
    pub px: f64,
    pub source: FocalSource,
    /// Reasons why the focal length may be wrong, each with the likely value.
    pub warnings: Vec<String>,
}

impl Focal {
    /// Determines the focal length from a file's bytes; `size` is the picture's size after orientation.
    pub fn of_file(bytes: &[u8], size: (usize, usize)) -> Self {
        let exif = exif::Reader::new()
            .read_from_container(&mut Cursor::new(bytes))
            .ok();
        let source = exif.as_ref().map_or(FocalSource::Default, source);
        let mm = match source {
            FocalSource::Equivalent35mm(mm) => mm,
            FocalSource::Lens(mm) if mm < PHONE_MM => mm * 8.4,
            FocalSource::Lens(mm) => mm,
            FocalSource::Given | FocalSource::Default => DEFAULT_FOCAL_MM,
        };
        let size = (size.0 as f64, size.1 as f64);
        let px = px_from_35mm(mm, size);
        let warnings = match (&exif, source) {
            (_, FocalSource::Default) | (None, _) => vec![format!(
                "no focal length in the file: assuming {DEFAULT_FOCAL_MM} mm on 35 mm film, which sets the metric \
                 scale; set the focal length in pixels if you know it (--focal-px)"
            )],
            (Some(exif), _) => {
                let stated = stated_size(exif, size);
                let sensor = Sensor::of(exif, stated.unwrap_or(size), size);
                let other = sensor.filter(|sensor| (sensor.px / px - 1.0).abs() > TOLERANCE);
                let crop = match stated {
                    Some(stated) => {
                        let factor = other.map_or(1.0, |sensor| sensor.px / px);
                        crop(stated, size, mm * factor, px)
                    }
                    None => shape(size, px),
                };
                let doubts = match (crop, other) {
                    (Some(crop), Some(sensor)) => [Some(crop + &sensor.note()), None],
                    (crop, Some(sensor)) => [crop, Some(sensor.text(source, px))],
                    (crop, None) if sensor.is_none() => [crop, unknown_sensor(source, px)],
                    (crop, None) => [crop, None],
                };
                let doubts = doubts.into_iter().chain([unlikely(source, px)]);
                doubts.flatten().collect()
            }
        };
        Self {
            px,
            source,
            warnings,
        }
    }
}

fn source(exif: &Exif) -> FocalSource {
    match number(exif, Tag::FocalLengthIn35mmFilm) {
        Some(mm) if mm >= 1.0 => FocalSource::Equivalent35mm(mm),
        _ => match number(exif, Tag::FocalLength) {
            // 0 is treated as missing; the SHARP release would use it.
            Some(mm) if mm.is_finite() && mm > 0.0 => FocalSource::Lens(mm),
            _ => FocalSource::Default,
        },
    }
}

/// Size of the photograph as taken, in the picture's orientation. A missing height is derived from the picture's aspect
/// ratio.
fn stated_size(exif: &Exif, (width, height): (f64, f64)) -> Option<(f64, f64)> {
    let side = |tag| number(exif, tag).filter(|v| *v >= 1.0);
    let (x, y) = match (side(Tag::PixelXDimension), side(Tag::PixelYDimension)) {
        (Some(x), Some(y)) => (x, y),
        (Some(x), None) => (x, x * width.min(height) / width.max(height)),
        _ => return None,
    };
    Some(if (x >= y) == (width >= height) {
        (x, y)
    } else {
        (y, x)
    })
}

/// Warns if no camera produces the picture's aspect ratio and the file does not state the original
/// size.
fn shape((width, height): (f64, f64), px: f64) -> Option<String> {
    let (long, short) = (width.max(height), width.min(height));
    let fits = |shape: f64| (long - short * shape).abs() <= (0.01 * long).max(1.0);
    (!SHAPES.into_iter().any(fits)).then(|| {
        format!(
            "the picture is {width:.0}x{height:.0}, an aspect ratio that cameras do not produce, and the file does \
             not state the size of the photograph; if it was cropped, its focal length is longer than {px:.2} px; set --focal-px"
        )
    })
}

/// Warns if the picture was cropped, or may have been. A picture that is smaller than its file
/// states was either resized or cropped. `mm` is the 35 mm equivalent; `px` is the focal length
/// derived without the sensor's pixel pitch.
fn crop(stated: (f64, f64), size: (f64, f64), mm: f64, px: f64) -> Option<String> {
    let is_larger = |a: f64, b: f64| a > b * (1.0 + SIDE_TOLERANCE);
    let factors = (stated.0 / size.0, stated.1 / size.1);
    let is_other_shape = is_larger(factors.0, factors.1) || is_larger(factors.1, factors.0);
    let is_smaller = is_larger(stated.0, size.0) && is_larger(stated.1, size.1);
    if !(is_other_shape || is_smaller) {
        return None;
    }
    // If only one side was cut, the other side shows that the picture was not resized.
    let whole = px_from_35mm(mm, stated) / factors.0.min(factors.1).max(1.0);
    let cropped = px_from_35mm(mm, stated);
    let sizes = format!(
        "the file states {:.0}x{:.0}, the picture is {:.0}x{:.0}",
        stated.0, stated.1, size.0, size.1
    );
    Some(if is_other_shape && (whole - cropped).abs() < 0.005 {
        format!(
            "{sizes}: it was cropped, so its focal length is {cropped:.2} px, not {px:.2} px; set --focal-px \
             {cropped:.2}"
        )
    } else if is_other_shape {
        format!(
            "{sizes}: it was cropped, so its focal length is not {px:.2} px but {cropped:.2} px, or {whole:.2} px if \
             it was also resized; set --focal-px"
        )
    } else {
        format!(
            "{sizes}: the focal length is {:.2} px if it was resized, {cropped:.2} px if it was cropped; set \
             --focal-px",
            px_from_35mm(mm, size)
        )
    })
}

/// Warns about a 35 mm equivalent that no lens has. Some programs write the lens's own focal length
/// in its place.
fn unlikely(source: FocalSource, px: f64) -> Option<String> {
    match source {
        FocalSource::Equivalent35mm(mm) if !LENSES_MM.contains(&mm) => Some(format!(
            "the file states a focal length of {mm} mm on 35 mm film, which no lens has, so {px:.2} px is probably \
             wrong; set --focal-px"
        )),
        _ => None,
    }
}

/// Warns if the file states the lens's own focal length, but not the size of the sensor.
fn unknown_sensor(source: FocalSource, px: f64) -> Option<String> {
    let FocalSource::Lens(mm) = source else {
        return None;
    };
    let assumed = if mm < PHONE_MM {
        "a phone's sensor, whose 35 mm equivalent is 8.4 times as long"
    } else {
        "a sensor of the size of 35 mm film"
    };
    Some(format!(
        "the file states a {mm} mm lens, but not the size of the sensor; the focal length of {px:.2} px assumes \
         {assumed}; set the focal length in pixels if you know it (--focal-px)"
    ))
}

fn positive(exif: &Exif, tag: Tag) -> Option<f64> {
    number(exif, tag).filter(|v| v.is_finite() && *v > 0.0)
}

/// A focal length from the file's pixel pitch on the sensor.
#[derive(Debug, Clone, Copy)]
struct Sensor {
    lens_mm: f64,
    width_mm: f64,
    px: f64,
}

impl Sensor {
    /// Computes the focal length from the pixel pitch that the file states; `None` if the file
    /// states no pixel pitch.
    fn of(exif: &Exif, stated: (f64, f64), size: (f64, f64)) -> Option<Self> {
        let per_unit = positive(exif, Tag::FocalPlaneXResolution)?;
        let lens_mm = positive(exif, Tag::FocalLength)?;
        let unit_mm = match number(exif, Tag::FocalPlaneResolutionUnit).map(|unit| unit as i64) {
            Some(3) => 10.0,
            Some(4) => 1.0,
            Some(5) => 0.001,
            _ => 25.4,
        };
        let zoom = positive(exif, Tag::DigitalZoomRatio).unwrap_or(1.0);
        let width_mm = stated.0.max(stated.1) / per_unit * unit_mm;
        Some(Self {
            lens_mm,
            width_mm,
            px: lens_mm * zoom * size.0.max(size.1) / width_mm,
        })
    }

    /// Text appended to a warning about a crop.
    fn note(self) -> String {
        let Self { width_mm, .. } = self;
        format!(" (by the file's FocalPlaneXResolution, the sensor is {width_mm:.1} mm wide)")
    }

    /// Warns that the pixel pitch gives a focal length other than `px`. After a picture is resized, only the stated
    /// 35 mm equivalent is still valid; after it is cropped, only the stated pixel pitch.
    fn text(self, source: FocalSource, px: f64) -> String {
        let Self {
            lens_mm,
            width_mm,
            px: by_sensor,
        } = self;
        match source {
            FocalSource::Equivalent35mm(_) if by_sensor > px => format!(
                "the file's 35 mm equivalent gives {px:.2} px, which is right if the picture was resized; its \
                 FocalPlaneXResolution gives {by_sensor:.2} px, which is right if it was cropped; set --focal-px"
            ),
            _ => format!(
                "according to the file's FocalPlaneXResolution the sensor is {width_mm:.1} mm wide, so the focal \
                 length of its {lens_mm} mm lens is {by_sensor:.2} px, not {px:.2} px; set --focal-px"
            ),
        }
    }
}

/// First number of a tag; the main directory takes precedence over the Exif one.
fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let field = [Context::Tiff, Context::Exif]
        .iter()
        .find_map(|context| exif.get_field(Tag(*context, tag.number()), In::PRIMARY))?;
    match &field.value {
        Value::Rational(v) => v.first().map(exif::Rational::to_f64),
        Value::SRational(v) => v.first().map(exif::SRational::to_f64),
        Value::Float(v) => v.first().map(|&v| f64::from(v)),
        Value::Double(v) => v.first().copied(),
        other => other.get_uint(0).map(f64::from),
    }
}
