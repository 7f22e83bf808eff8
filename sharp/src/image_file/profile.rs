//! Colour profiles: detection, and conversion of colours to sRGB.
//!
//! Profiles are parsed by `moxcms`. The conversion is implemented here, so that it gives the same bytes on every
//! processor: curves and matrix in f64, colorimetric, clipped to sRGB.

use std::sync::LazyLock;

use glam::{DMat3, DVec3};
use image::{DynamicImage, ImageBuffer, Pixel};
use moxcms::{ColorProfile, DataColorSpace, ProfileText, ToneReprCurve};

/// The colour space that a file states for its picture.
#[derive(Debug, Clone, PartialEq)]
pub enum Profile {
    /// sRGB, or no colour information.
    Srgb,
    /// A profile defined by primaries and curves.
    Matrix {
        name: String,
        to_srgb: MatrixProfile,
    },
    /// PNG chunks that contradict sRGB but are ignored by most programs.
    Ignored { chunks: String },
    /// A profile that cannot be converted, with the reason.
    Other { name: String, reason: &'static str },
}

/// Conversion from encoded values to linear sRGB.
#[derive(Debug, Clone, PartialEq)]
pub struct MatrixProfile {
    curves: [Vec<f64>; 3],
    matrix: DMat3,
}

/// Number of samples of a curve: enough to be exact for 8 bit; 16-bit values are interpolated.
const SAMPLES: usize = 255 * 16 + 1;
/// A profile counts as sRGB if it changes no channel by more than this, in levels of 255: files round the curves and
/// primaries of sRGB.
const SRGB_LEVELS: f64 = 2.0;

impl Profile {
    /// Name of a profile other than sRGB.
    pub fn name(&self) -> Option<&str> {
        match self {
            Self::Srgb | Self::Ignored { .. } => None,
            Self::Matrix { name, .. } | Self::Other { name, .. } => Some(name),
        }
    }

    /// Description of ignored information that contradicts sRGB; continues a sentence after "it has".
    pub fn ignored(&self) -> Option<String> {
        match self {
            Self::Ignored { chunks } => Some(format!(
                "PNG chunks ({chunks}) that contradict sRGB and are ignored, as in most programs: its values are read \
                 as sRGB (color=as-stored confirms this and removes the note)"
            )),
            _ => None,
        }
    }

    /// Parses an embedded ICC profile.
    pub(super) fn of_icc(bytes: &[u8]) -> Self {
        let other = |name: &str, reason| Self::Other {
            name: name.to_owned(),
            reason,
        };
        let Ok(profile) = ColorProfile::new_from_slice(bytes) else {
            return other("ICC", "the profile is damaged");
        };
        let name = description(&profile).unwrap_or_else(|| "ICC without a name".to_owned());
        let curves = match profile.color_space {
            DataColorSpace::Rgb => [&profile.red_trc, &profile.green_trc, &profile.blue_trc],
            DataColorSpace::Gray => [&profile.gray_trc; 3],
            DataColorSpace::Cmyk => return other(&name, "it is a CMYK profile"),
            _ => return other(&name, "it is neither RGB nor grey"),
        };
        let [Some(r), Some(g), Some(b)] = curves.map(|curve| curve.as_ref()) else {
            return if name.starts_with("sRGB") {
                Self::Srgb
            } else {
                other(&name, "it is a table of colours")
            };
        };
        let matrix = match profile.color_space {
            DataColorSpace::Gray => DMat3::IDENTITY,
            _ => srgb_from(&profile),
        };
        Self::of_parts(name, [r, g, b], matrix)
    }

    /// Parses the four bytes of a PNG's cICP chunk: primaries, transfer, matrix, range.
    pub(super) fn of_cicp([primaries, transfer, _, full_range]: [u8; 4]) -> Self {
        // Code of the sRGB transfer curve.
        const SRGB: u8 = 13;
        let (name, profile) = match (primaries, transfer, full_range) {
            (1, SRGB, 1) => return Self::Srgb,
            (12, SRGB, 1) => ("Display P3", ColorProfile::new_display_p3()),
            (9, SRGB, 1) => (
                "BT.2020 with the curves of sRGB",
                ColorProfile::new_bt2020(),
            ),
            _ => {
                let name = format!("cICP {primaries}/{transfer}, range {full_range}");
                let reason =
                    "of cICP, only primaries 1, 9 and 12 with transfer 13 can be converted";
                return Self::Other { name, reason };
            }
        };
        Self::of_standard(name, &profile, &ColorProfile::new_srgb())
    }

    pub(super) fn adobe_rgb() -> Self {
        let profile = ColorProfile::new_adobe_rgb();
        Self::of_standard("Adobe RGB (by EXIF)", &profile, &profile)
    }

    fn of_standard(name: &str, primaries: &ColorProfile, curves: &ColorProfile) -> Self {
        match &curves.red_trc {
            Some(curve) => Self::of_parts(name.to_owned(), [curve; 3], srgb_from(primaries)),
            None => Self::Srgb,
        }
    }

    fn of_parts(name: String, curves: [&ToneReprCurve; 3], matrix: DMat3) -> Self {
        let sampled = |curve: &ToneReprCurve| -> Option<Vec<f64>> {
            let at = (0..SAMPLES).map(|i| i as f64 / (SAMPLES - 1) as f64);
            at.map(|x| value(curve, x)).collect()
        };
        let (Some(r), Some(g), Some(b)) =
            (sampled(curves[0]), sampled(curves[1]), sampled(curves[2]))
        else {
            let reason = "its transfer curves are not supported";
            return Self::Other { name, reason };
        };
        let to_srgb = MatrixProfile {
            curves: [r, g, b],
            matrix,
        };
        if !matrix.is_finite() {
            let reason = "its primaries do not define a colour space";
            return Self::Other { name, reason };
        }
        if to_srgb.difference() <= SRGB_LEVELS {
            Self::Srgb
        } else {
            Self::Matrix { name, to_srgb }
        }
    }
}

/// Matrix from a profile's linear RGB to linear sRGB, both adapted to D50.
fn srgb_from(profile: &ColorProfile) -> DMat3 {
    let xyz_from_rgb = |profile: &ColorProfile| {
        let column = |c: moxcms::Xyzd| DVec3::new(c.x, c.y, c.z);
        DMat3::from_cols(
            column(profile.red_colorant),
            column(profile.green_colorant),
            column(profile.blue_colorant),
        )
    };
    xyz_from_rgb(&ColorProfile::new_srgb()).inverse() * xyz_from_rgb(profile)
}

/// Linear light of an encoded value in 0..1; `None` if the form of the curve is unknown.
fn value(curve: &ToneReprCurve, x: f64) -> Option<f64> {
    let linear = match curve {
        ToneReprCurve::Lut(table) => match table.as_slice() {
            [] => x,
            [gamma] => x.powf(f64::from(*gamma) / 256.0),
            table => {
                let at = x * (table.len() - 1) as f64;
                let low = (at as usize).min(table.len() - 2);
                let [a, b] = [low, low + 1].map(|i| f64::from(table[i]) / 65535.0);
                a + (b - a) * (at - low as f64)
            }
        },
        ToneReprCurve::Parametric(p) => {
            let p: Vec<f64> = p.iter().map(|p| f64::from(*p)).collect();
            // General form: (a x + b)^g + e, and c x + f below d.
            let [g, a, b, c, d, e, f] = match *p.as_slice() {
                [g] => [g, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                [g, a, b] => [g, a, b, 0.0, -b / a, 0.0, 0.0],
                [g, a, b, c] => [g, a, b, 0.0, -b / a, c, c],
                [g, a, b, c, d] => [g, a, b, c, d, 0.0, 0.0],
                [g, a, b, c, d, e, f] => [g, a, b, c, d, e, f],
                _ => return None,
            };
            if x < d {
                c * x + f
            } else {
                (a * x + b).max(0.0).powf(g) + e
            }
        }
    };
    linear.is_finite().then_some(linear)
}

fn description(profile: &ColorProfile) -> Option<String> {
    let text = match profile.description.as_ref()? {
        ProfileText::PlainString(text) => text.clone(),
        ProfileText::Localizable(texts) => texts.first()?.value.clone(),
        ProfileText::Description(text) if text.ascii_string.is_empty() => {
            text.unicode_string.clone()
        }
        ProfileText::Description(text) => text.ascii_string.clone(),
    };
    let text: String = text.chars().filter(|c| !c.is_control()).take(80).collect();
    (!text.trim().is_empty()).then(|| text.trim().to_owned())
}

/// sRGB-encoded value of linear light, clipped to 0..1.
fn encoded(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

impl MatrixProfile {
    /// Linear sRGB values for encoded values in 0..1.
    fn linear(&self, rgb: [f64; 3]) -> [f64; 3] {
        let linear = [0, 1, 2].map(|c| {
            let at = rgb[c] * (SAMPLES - 1) as f64;
            let low = (at as usize).min(SAMPLES - 2);
            let (a, b) = (self.curves[c][low], self.curves[c][low + 1]);
            a + (b - a) * (at - low as f64)
        });
        (self.matrix * DVec3::from_array(linear)).to_array()
    }

    /// Maximum change of a channel over a lattice of colours, in levels of 255.
    fn difference(&self) -> f64 {
        const SIDE: u32 = 9;
        let lattice = (0..SIDE.pow(3)).map(|i| [i / SIDE / SIDE, i / SIDE % SIDE, i % SIDE]);
        let changes = lattice.flat_map(|at| {
            let rgb = at.map(|v| f64::from(v) / f64::from(SIDE - 1));
            let found = self.linear(rgb).map(encoded);
            [0, 1, 2].map(|c| (found[c] - rgb[c]).abs() * 255.0)
        });
        changes.fold(0.0, f64::max)
    }

    /// Converts colours to sRGB; alpha and bit depth are preserved, grey becomes RGB.
    pub(super) fn convert(&self, image: DynamicImage) -> DynamicImage {
        let is_deep = image.color().bytes_per_pixel() / image.color().channel_count() > 1;
        let deep = |linear: f64| (encoded(linear) * 65535.0).round() as u16;
        match (is_deep, image.color().has_alpha()) {
            (false, false) => self.each(image.into_rgb8(), 255.0, level_of).into(),
            (false, true) => self.each(image.into_rgba8(), 255.0, level_of).into(),
            (true, false) => self.each(image.into_rgb16(), 65535.0, deep).into(),
            (true, true) => self.each(image.into_rgba16(), 65535.0, deep).into(),
        }
    }

    fn each<P>(
        &self,
        mut image: ImageBuffer<P, Vec<P::Subpixel>>,
        highest: f64,
        stored_from_linear: impl Fn(f64) -> P::Subpixel,
    ) -> ImageBuffer<P, Vec<P::Subpixel>>
    where
        P: Pixel,
        P::Subpixel: Into<f64>,
    {
        for pixel in image.pixels_mut() {
            let rgb = &mut pixel.channels_mut()[..3];
            let linear = self.linear([rgb[0], rgb[1], rgb[2]].map(|v| v.into() / highest));
            rgb.copy_from_slice(&linear.map(&stored_from_linear));
        }
        image
    }
}

/// Encodes linear light as the nearest 8-bit level, like rounding `encoded`, but without a power per pixel.
fn level_of(linear: f64) -> u8 {
    /// Upper bound of each level, in linear light.
    static ENDS: LazyLock<[f64; 255]> = LazyLock::new(|| {
        std::array::from_fn(|level| match (level as f64 + 0.5) / 255.0 {
            edge if edge <= 0.040_45 => edge / 12.92,
            edge => ((edge + 0.055) / 1.055).powf(2.4),
        })
    });
    let linear = linear.clamp(0.0, 1.0);
    ENDS.partition_point(|end| *end <= linear) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_those_of_the_formula() {
        for i in 0..=100_000 {
            let linear = f64::from(i) / 100_000.0;
            assert_eq!(level_of(linear), (encoded(linear) * 255.0).round() as u8);
        }
        assert_eq!(
            [level_of(-1.0), level_of(2.0), level_of(f64::NAN)],
            [0, 255, 0]
        );
    }

    #[test]
    fn profiles_of_srgb_change_nothing_and_others_are_converted() {
        let icc = |profile: ColorProfile| Profile::of_icc(&profile.encode().unwrap());
        assert_eq!(icc(ColorProfile::new_srgb()), Profile::Srgb);
        assert_eq!(Profile::of_cicp([1, 13, 0, 1]), Profile::Srgb);
        // Published values: this green of Display P3 and this red of Adobe RGB.
        let image = |rgb| image::RgbImage::from_pixel(1, 1, image::Rgb(rgb)).into();
        let converted = |profile: &Profile, rgb| match profile {
            Profile::Matrix { to_srgb, .. } => to_srgb.convert(image(rgb)).into_rgb8()[(0, 0)].0,
            other => panic!("{other:?}"),
        };
        let p3 = icc(ColorProfile::new_display_p3());
        assert_eq!(p3.name(), Some("Display P3"));
        for profile in [&p3, &Profile::of_cicp([12, 13, 0, 1])] {
            assert_eq!(converted(profile, [234, 51, 35]), [255, 0, 0]);
            assert_eq!(converted(profile, [128; 3]), [128; 3]);
        }
        let adobe = icc(ColorProfile::new_adobe_rgb());
        assert_eq!(converted(&adobe, [219, 0, 0]), [255, 0, 0]);
        assert_eq!(
            converted(&Profile::adobe_rgb(), [144, 255, 60]),
            [0, 255, 1]
        );
        let gamma = icc(ColorProfile::new_gray_with_gamma(1.0));
        assert_eq!(converted(&gamma, [55; 3]), [128; 3]);
    }

    #[test]
    fn what_cannot_be_converted_is_named() {
        for (profile, part) in [
            (Profile::of_icc(b"no profile"), "damaged"),
            (Profile::of_cicp([9, 16, 0, 1]), "9/16"),
        ] {
            assert!(matches!(&profile, Profile::Other { .. }), "{part}");
            assert!(format!("{profile:?}").contains(part), "{profile:?}");
        }
    }
}
