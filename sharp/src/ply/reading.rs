//! Encodings of stored numbers, for programs whose encodings differ from 3D Gaussian Splatting's.

use super::SH_CONSTANT;
use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::gaussians::Gaussians;

/// The value given for a setting is not one of the setting's values.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{key}={value}: expected {}", known.join(" or "))]
pub struct UnknownReading {
    pub key: &'static str,
    pub value: String,
    pub known: &'static [&'static str],
}

/// Defines an enum whose variants are the values of a setting.
macro_rules! setting {
    ($(#[$about:meta])* $name:ident, $key:literal: $($(#[$of:meta])* $variant:ident = $text:literal),+ $(,)?) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name { $($(#[$of])* $variant),+ }

        impl $name {
            /// Name of the setting.
            pub const KEY: &'static str = $key;
            /// All values, the default first.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// The value as written in the setting.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $text),+ }
            }

        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.name())
            }
        }

        impl std::str::FromStr for $name {
            type Err = $crate::ply::UnknownReading;

            fn from_str(value: &str) -> Result<Self, $crate::ply::UnknownReading> {
                match value {
                    $($text => Ok(Self::$variant),)+
                    _ => Err($crate::ply::UnknownReading {
                        key: Self::KEY,
                        value: value.to_owned(),
                        known: &[$($text),+],
                    }),
                }
            }
        }
    };
}

#[cfg(feature = "render")]
pub(crate) use setting;

setting!(
    /// Encoding of colours, in a file or for blending.
    ColorSpace, "color_space":
    /// Linear light, code 1. The SHARP release assumes linear light for files that do not state their
    /// encoding.
    Linear = "linear",
    /// sRGB-encoded, code 0. The SHARP release writes sRGB for viewers that blend encoded values. 3D
    /// Gaussian Splatting optimises encoded colours but does not state this in its files.
    Srgb = "srgb",
);
impl Default for ColorSpace {
    /// The colour space in which SHARP blends.
    fn default() -> Self {
        Self::Linear
    }
}

setting!(
    /// Encoding of an opacity o in 0..1.
    StoredOpacity, "opacity":
    /// ln(o / (1 − o)).
    Logit = "logit",
    /// o itself, in 0..1.
    Linear = "linear",
    /// 255 o, in 0..255.
    Byte = "byte",
    /// ln o, the natural logarithm.
    Log = "log",
);
setting!(
    /// Encoding of standard deviations.
    StoredScales, "scales":
    /// Natural logarithms.
    Log = "log",
    /// Not encoded.
    Linear = "linear",
    /// Natural logarithms of variances.
    LogVariance = "log-variance",
    /// Variances.
    Variance = "variance",
    /// Logarithms to the base of 10.
    Log10 = "log10",
);
setting!(
    /// Component order and direction of quaternions.
    StoredQuaternions, "quaternions":
    Wxyz = "wxyz",
    Xyzw = "xyzw",
    /// The inverse rotation, as w, x, y, z.
    WxyzInverse = "wxyz-inverse",
    XyzwInverse = "xyzw-inverse",
);
setting!(
    /// Encoding of a colour channel c, nominally in 0..1.
    StoredColors, "colors":
    /// The constant coefficient of spherical harmonics, (c − ½) / √(1 / 4π).
    Dc = "dc",
    /// c / √(1 / 4π): like `Dc`, but ½ is not subtracted first.
    DcUncentered = "dc-uncentered",
    /// c itself, in 0..1.
    Rgb01 = "rgb01",
    /// 2 c − 1, in −1..1.
    RgbSigned = "rgb-signed",
    /// 255 c, in 0..255; read from `red green blue` in a PLY without `f_dc_*`.
    Rgb255 = "rgb255",
    /// ln(c / (1 − c)), as in nerfstudio's exports of models of degree 0.
    Logit = "logit",
);
setting!(
    /// Order of the colour channels.
    StoredChannels, "channels":
    Rgb = "rgb",
    Bgr = "bgr",
);
setting!(
    /// Treatment of coefficients of view-dependent colour.
    Harmonics, "harmonics":
    /// Files with non-zero coefficients are rejected.
    Refuse = "refuse",
    /// Only the constant term is drawn.
    Drop = "drop",
    /// Coefficients are drawn. They are stored coefficient by coefficient (each as red, green, blue) instead of channel
    /// by channel.
    Interleaved = "interleaved",
);
setting!(
    /// Treatment of files that state another rendering rule: antialiasing, flat Gaussians, or a filter that is not
    /// folded into the Gaussians.
    Marks, "marks":
    /// Files that state another rendering rule are rejected.
    Refuse = "refuse",
    /// The stated rule is ignored.
    Ignore = "ignore",
);

/// Encodings of a file's numbers; `None` means the format's own. No doubt is reported about an encoding that is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StoredForm {
    pub color_space: Option<ColorSpace>,
    pub opacity: Option<StoredOpacity>,
    pub scales: Option<StoredScales>,
    pub quaternions: Option<StoredQuaternions>,
    pub colors: Option<StoredColors>,
    pub channels: Option<StoredChannels>,
    pub harmonics: Option<Harmonics>,
    pub marks: Option<Marks>,
    /// Encoding of the decoded colours. The rendering rule determines it, so it is not one of the
    /// settings. If it is linear light, view-dependent colours cannot be read. If it is sRGB, they
    /// can, and files without a stated colour encoding are assumed to use 3D Gaussian Splatting's.
    pub blending: ColorSpace,
    /// True if a rendering rule was chosen explicitly; a file that states another rule is then not
    /// rejected. Like `blending`, this is not one of the settings.
    pub is_ruled: bool,
}

impl From<Option<ColorSpace>> for StoredForm {
    fn from(color_space: Option<ColorSpace>) -> Self {
        Self {
            color_space,
            ..Self::default()
        }
    }
}

impl StoredForm {
    /// True if a file is accepted although its marks show that it was made for another rendering rule than SHARP's.
    pub(crate) fn takes_other_rules(&self) -> bool {
        self.is_ruled || self.blending == ColorSpace::Srgb
    }

    /// Names of all settings.
    pub const KEYS: [&'static str; 8] = [
        ColorSpace::KEY,
        StoredOpacity::KEY,
        StoredScales::KEY,
        StoredQuaternions::KEY,
        StoredColors::KEY,
        StoredChannels::KEY,
        Harmonics::KEY,
        Marks::KEY,
    ];

    /// Sets one of [`Self::KEYS`]; returns false for any other key.
    ///
    /// # Errors
    /// [`UnknownReading`] if the setting does not have this value.
    pub fn set(&mut self, key: &str, value: &str) -> Result<bool, UnknownReading> {
        match key {
            ColorSpace::KEY => self.color_space = Some(value.parse()?),
            StoredOpacity::KEY => self.opacity = Some(value.parse()?),
            StoredScales::KEY => self.scales = Some(value.parse()?),
            StoredQuaternions::KEY => self.quaternions = Some(value.parse()?),
            StoredColors::KEY => self.colors = Some(value.parse()?),
            StoredChannels::KEY => self.channels = Some(value.parse()?),
            Harmonics::KEY => self.harmonics = Some(value.parse()?),
            Marks::KEY => self.marks = Some(value.parse()?),
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// The settings that were given: key and value.
    pub fn settings(&self) -> Vec<(&'static str, &'static str)> {
        let all = [
            self.color_space.map(ColorSpace::name),
            self.opacity.map(StoredOpacity::name),
            self.scales.map(StoredScales::name),
            self.quaternions.map(StoredQuaternions::name),
            self.colors.map(StoredColors::name),
            self.channels.map(StoredChannels::name),
            self.harmonics.map(Harmonics::name),
            self.marks.map(Marks::name),
        ];
        let named = Self::KEYS.into_iter().zip(all);
        named
            .filter_map(|(key, value)| Some((key, value?)))
            .collect()
    }

    /// The encodings that 3D Gaussian Splatting uses in PLY files.
    pub fn ply() -> Self {
        Self {
            opacity: Some(StoredOpacity::Logit),
            scales: Some(StoredScales::Log),
            colors: Some(StoredColors::Dc),
            ..Self::default()
        }
    }

    /// Returns these settings, with unset ones taken from `format`.
    pub fn or_of(self, format: &Self) -> Self {
        Self {
            opacity: self.opacity.or(format.opacity),
            scales: self.scales.or(format.scales),
            colors: self.colors.or(format.colors),
            ..self.common()
        }
    }

    /// Fills unset settings with the encodings of decoded arrays (standard deviations, opacities in
    /// 0..1, linear colours).
    pub fn of_arrays(self) -> Self {
        Self {
            opacity: self.opacity.or(Some(StoredOpacity::Linear)),
            scales: self.scales.or(Some(StoredScales::Linear)),
            colors: self.colors.or(Some(StoredColors::Rgb01)),
            color_space: self.color_space.or(Some(ColorSpace::Linear)),
            ..self.common()
        }
    }

    fn common(self) -> Self {
        Self {
            quaternions: self.quaternions.or(Some(StoredQuaternions::Wxyz)),
            channels: self.channels.or(Some(StoredChannels::Rgb)),
            ..self
        }
    }

    /// Decodes stored numbers; numbers whose setting is `None` are left unchanged.
    pub fn decode(&self, gaussians: &mut Gaussians) {
        self.convert(gaussians, false);
    }

    /// Inverse of [`Self::decode`], up to rounding.
    pub fn encode(&self, gaussians: &mut Gaussians) {
        self.convert(gaussians, true);
    }

    fn convert(&self, gaussians: &mut Gaussians, to_stored: bool) {
        let byte = |v: f32| if to_stored { v * 255.0 } else { v / 255.0 };
        let sigmoid = if to_stored { logit } else { logistic };
        for opacity in &mut gaussians.opacities {
            *opacity = match self.opacity {
                Some(StoredOpacity::Logit) => sigmoid(*opacity),
                Some(StoredOpacity::Byte) => byte(*opacity),
                Some(StoredOpacity::Log) if to_stored => opacity.ln(),
                Some(StoredOpacity::Log) => opacity.exp(),
                Some(StoredOpacity::Linear) | None => *opacity,
            };
        }
        let power = match self.scales {
            Some(StoredScales::Log) => 1.0,
            Some(StoredScales::LogVariance) => 2.0,
            Some(StoredScales::Log10) => std::f64::consts::LOG10_E,
            Some(StoredScales::Linear | StoredScales::Variance) | None => 0.0,
        };
        for scale in gaussians.scales.as_flattened_mut() {
            if self.scales == Some(StoredScales::Variance) {
                *scale = if to_stored {
                    *scale * *scale
                } else {
                    scale.clamp(0.0, f32::INFINITY).sqrt()
                };
            } else if power > 0.0 {
                *scale = if to_stored {
                    scale.ln() * power as f32
                } else {
                    (f64::from(*scale) / power).exp() as f32
                };
            }
        }
        use StoredQuaternions::{WxyzInverse, Xyzw, XyzwInverse};
        let is_xyzw = matches!(self.quaternions, Some(Xyzw | XyzwInverse));
        let is_inverse = matches!(self.quaternions, Some(WxyzInverse | XyzwInverse));
        for quaternion in &mut gaussians.quaternions {
            if is_xyzw && !to_stored {
                quaternion.rotate_right(1);
            }
            if is_inverse {
                quaternion[1..].iter_mut().for_each(|v| *v = -*v);
            }
            if is_xyzw && to_stored {
                quaternion.rotate_left(1);
            }
        }
        let form = |value: f32| match self.colors {
            Some(StoredColors::Dc) if to_stored => (value - 0.5) / SH_CONSTANT,
            Some(StoredColors::Dc) => value * SH_CONSTANT + 0.5,
            Some(StoredColors::DcUncentered) if to_stored => value / SH_CONSTANT,
            Some(StoredColors::DcUncentered) => value * SH_CONSTANT,
            Some(StoredColors::Rgb255) => byte(value),
            Some(StoredColors::RgbSigned) if to_stored => 2.0 * value - 1.0,
            Some(StoredColors::RgbSigned) => (value + 1.0) / 2.0,
            Some(StoredColors::Logit) => sigmoid(value),
            Some(StoredColors::Rgb01) | None => value,
        };
        let space = |value: f32| match (self.color_space.unwrap_or(self.blending), self.blending) {
            (ColorSpace::Srgb, ColorSpace::Linear) if to_stored => srgb_from_linear(value),
            (ColorSpace::Srgb, ColorSpace::Linear) => linear_from_srgb(value),
            (ColorSpace::Linear, ColorSpace::Srgb) if to_stored => linear_from_srgb(value),
            (ColorSpace::Linear, ColorSpace::Srgb) => srgb_from_linear(value),
            _ => value,
        };
        for color in &mut gaussians.colors {
            if self.channels == Some(StoredChannels::Bgr) {
                color.reverse();
            }
            *color = color.map(|value| {
                if to_stored {
                    form(space(value))
                } else {
                    space(form(value))
                }
            });
        }
        if self.harmonics == Some(Harmonics::Interleaved) {
            let each = gaussians.harmonics.per_gaussian().max(1);
            for own in gaussians.harmonics.coefficients.chunks_mut(each) {
                // `place` is a position in the file. There, `place / each` is the channel according to the format,
                // `place % 3` the channel that the program actually wrote.
                let as_read = own.to_vec();
                for place in 0..3 * own.len() {
                    let (one, other) = ((place % each, place / each), (place / 3, place % 3));
                    let (from, to) = if to_stored {
                        (other, one)
                    } else {
                        (one, other)
                    };
                    own[to.0][to.1] = as_read[from.0][from.1];
                }
            }
        }
        if self.channels == Some(StoredChannels::Bgr) {
            for coefficient in &mut gaussians.harmonics.coefficients {
                coefficient.reverse();
            }
        }
    }
}

fn logit(value: f32) -> f32 {
    (value / (1.0 - value)).ln()
}

pub(super) fn logistic(logit: f32) -> f32 {
    (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32
}
