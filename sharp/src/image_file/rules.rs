//! Rules for pictures with alpha, orientation or colour profiles.

use std::fmt;
use std::str::FromStr;

/// Defines an enum of named values with `FromStr` and `Display`.
macro_rules! choices {
    ($(#[$doc:meta])* $name:ident { $($(#[$value_doc:meta])* $value:ident = $text:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name { $($(#[$value_doc])* $value,)+ }

        impl $name {
            pub const ALL: &[Self] = &[$(Self::$value,)+];

            pub fn name(self) -> &'static str {
                match self { $(Self::$value => $text,)+ }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.name())
            }
        }

        impl FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                let found = Self::ALL.iter().find(|value| value.name() == text);
                found.copied().ok_or_else(|| {
                    let known: Vec<&str> = Self::ALL.iter().map(|value| value.name()).collect();
                    format!("'{text}' is not one of {}", known.join(", "))
                })
            }
        }
    };
}

choices! {
    #[derive(Default)]
    /// Treatment of alpha. Has no effect on pictures that are opaque everywhere.
    AlphaRule {
        /// A picture that is not fully opaque is an error.
        #[default]
        Refuse = "refuse",
        /// Composited over black, in encoded values: `round(colour · alpha)`.
        Black = "black",
        /// Composited over white, in encoded values: `round(colour · alpha + 255 · (1 − alpha))`.
        White = "white",
        /// Alpha is ignored; colours are used as stored.
        Drop = "drop",
    }
}

choices! {
    #[derive(Default)]
    /// Treatment of colours that a profile (ICC, cICP or the EXIF mark of Adobe RGB) declares not to be sRGB.
    ColorRule {
        /// Converted to sRGB using the profile's primaries and curves; colours outside sRGB are clipped. Other kinds of
        /// profiles are an error.
        #[default]
        Convert = "convert",
        /// Colours are interpreted as sRGB, whatever the profile.
        AsStored = "as-stored",
    }
}

choices! {
    #[derive(Default)]
    /// Treatment of the EXIF orientation.
    OrientationRule {
        /// Without a camera, the picture is turned upright. With a camera, the picture is turned
        /// only if it has the camera's size when upright, but not as stored.
        #[default]
        Auto = "auto",
        Stored = "stored",
        Upright = "upright",
    }
}

choices! {
    /// Interpretation of EXR values if the file does not state it.
    ExrTransfer {
        /// Linear light: clamped to 0..1 and encoded. Written by most programs.
        Linear = "linear",
        /// Values are sRGB-encoded.
        Srgb = "srgb",
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PictureRules {
    pub alpha: AlphaRule,
    pub color: ColorRule,
    pub orientation: OrientationRule,
}

impl PictureRules {
    /// Rules for data that are not photographs, such as depth maps and masks: levels are used as
    /// stored.
    pub const AS_STORED: Self = Self {
        alpha: AlphaRule::Drop,
        color: ColorRule::AsStored,
        orientation: OrientationRule::Stored,
    };

    /// Parses `alpha`, `color` and `orientation` if given. Errors contain the reason only.
    pub fn parse<'a>(option: impl Fn(&str) -> Option<&'a str>) -> Result<Self, String> {
        Ok(Self {
            alpha: parsed("alpha", &option)?.unwrap_or_default(),
            color: parsed("color", &option)?.unwrap_or_default(),
            orientation: parsed("orientation", &option)?.unwrap_or_default(),
        })
    }

    /// The rules that differ from the default, by the keys of [`Self::parse`].
    pub fn given(&self) -> impl Iterator<Item = (&'static str, &'static str)> + use<> {
        let named = |rules: &Self| {
            [
                ("alpha", rules.alpha.name()),
                ("color", rules.color.name()),
                ("orientation", rules.orientation.name()),
            ]
        };
        let asked = named(&Self::default());
        named(self)
            .into_iter()
            .filter(move |rule| !asked.contains(rule))
    }

    /// True if a picture is to be turned by its EXIF orientation. `fit` is the size that the picture's camera states,
    /// if known.
    pub fn turns(&self, header: &super::Header, fit: Option<(u32, u32)>) -> bool {
        let upright = header.orientation != 1;
        match (self.orientation, fit) {
            (OrientationRule::Stored, _) => false,
            (OrientationRule::Upright, _) | (OrientationRule::Auto, None) => upright,
            (OrientationRule::Auto, Some(fit)) => {
                upright && header.size != fit && header.upright_size() == fit
            }
        }
    }
}

/// Parses an option's value.
///
/// # Errors
/// The reason, which names the option.
pub fn parsed<'a, T: FromStr<Err: fmt::Display>>(
    key: &str,
    option: impl Fn(&str) -> Option<&'a str>,
) -> Result<Option<T>, String> {
    let value = option(key).map(str::parse).transpose();
    value.map_err(|error| format!("{key}: {error}"))
}
