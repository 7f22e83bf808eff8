//! Rules for pictures with alpha, orientation or colour profiles.

use std::fmt;
use std::str::FromStr;

/// An enum of named values with `FromStr` and `Display`.
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
                    format!("'{text}' is none of {}", known.join(", "))
                })
            }
        }
    };
}

choices! {
    #[derive(Default)]
    /// What becomes of alpha. A picture that is opaque everywhere is read under each of them.
    AlphaRule {
        /// A picture that is not opaque is an error.
        #[default]
        Refuse = "refuse",
        /// Composited over black, in encoded values: `round(colour · alpha)`.
        Black = "black",
        /// Composited over white, in encoded values: `round(colour · alpha + 255 · (1 − alpha))`.
        White = "white",
        /// Colours are taken as they are stored.
        Drop = "drop",
    }
}

choices! {
    #[derive(Default)]
    /// What becomes of colours that a profile (ICC, cICP or the EXIF mark of Adobe RGB) says are not sRGB.
    ColorRule {
        /// Converted to sRGB by the profile's primaries and curves; colours outside sRGB are clipped. A profile of
        /// another kind is an error.
        #[default]
        Convert = "convert",
        /// Taken for sRGB.
        AsStored = "as-stored",
    }
}

choices! {
    #[derive(Default)]
    /// Whether a picture is turned as its EXIF orientation says.
    OrientationRule {
        /// As stored if that fits the camera; upright if only upright fits, or if there is no camera.
        #[default]
        Auto = "auto",
        Stored = "stored",
        Upright = "upright",
    }
}

choices! {
    /// What the values of an EXR are that does not say it.
    ExrTransfer {
        /// Light: clamped to 0..1 and encoded. What most programs write.
        Linear = "linear",
        /// sRGB-encoded.
        Srgb = "srgb",
    }
}

/// Rules for reading a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PictureRules {
    pub alpha: AlphaRule,
    pub color: ColorRule,
    pub orientation: OrientationRule,
}

impl PictureRules {
    /// For what is no photograph, as depth maps and masks: the levels as stored.
    pub const AS_STORED: Self = Self {
        alpha: AlphaRule::Drop,
        color: ColorRule::AsStored,
        orientation: OrientationRule::Stored,
    };

    /// Reads `alpha`, `color` and `orientation` where they are given; errors are the bare reason.
    pub fn parse<'a>(option: impl Fn(&str) -> Option<&'a str>) -> Result<Self, String> {
        Ok(Self {
            alpha: parsed("alpha", &option)?.unwrap_or_default(),
            color: parsed("color", &option)?.unwrap_or_default(),
            orientation: parsed("orientation", &option)?.unwrap_or_default(),
        })
    }

    /// The rules that are not the default, by the keys of [`Self::parse`].
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

    /// Whether a picture of a stored size is turned, where a camera of the size `fit` is to have it.
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

/// An option's value; the error is the bare reason.
///
/// # Errors
/// Names the option.
pub fn parsed<'a, T: FromStr<Err: fmt::Display>>(
    key: &str,
    option: impl Fn(&str) -> Option<&'a str>,
) -> Result<Option<T>, String> {
    let value = option(key).map(str::parse).transpose();
    value.map_err(|error| format!("{key}: {error}"))
}
