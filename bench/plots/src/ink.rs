//! Colours of drawings.

use image::Rgb;

/// An sRGB colour with opacity.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize)]
#[serde(try_from = "String")]
pub struct Ink {
    pub rgb: (u8, u8, u8),
    /// Opacity, 0..1.
    pub alpha: f64,
}

impl Ink {
    pub const fn opaque(r: u8, g: u8, b: u8) -> Self {
        Self {
            rgb: (r, g, b),
            alpha: 1.0,
        }
    }

    pub const fn with_alpha(self, alpha: f64) -> Self {
        Self {
            rgb: self.rgb,
            alpha,
        }
    }

    /// `#RRGGBB`.
    pub fn hex(self) -> String {
        let (r, g, b) = self.rgb;
        format!("#{r:02X}{g:02X}{b:02X}")
    }
}

impl TryFrom<String> for Ink {
    type Error = String;

    /// From `#RRGGBB`.
    fn try_from(text: String) -> Result<Self, String> {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6);
        let hex = digits.filter(|digits| digits.bytes().all(|c| c.is_ascii_hexdigit()));
        let value = hex.and_then(|digits| u32::from_str_radix(digits, 16).ok());
        match value.map(u32::to_be_bytes) {
            Some([_, r, g, b]) => Ok(Self::opaque(r, g, b)),
            None => Err(format!("'{text}' is not of the form #RRGGBB")),
        }
    }
}

impl From<Ink> for Rgb<u8> {
    /// Drops the opacity.
    fn from(ink: Ink) -> Self {
        let (r, g, b) = ink.rgb;
        Self([r, g, b])
    }
}

/// Text and axes.
pub const INK: Ink = Ink::opaque(0x1B, 0x1F, 0x24);
/// Secondary text.
pub const MUTED: Ink = Ink::opaque(0x57, 0x60, 0x6A);
/// Grid lines.
pub const GRID: Ink = Ink::opaque(0xE1, 0xE5, 0xEA);
/// Background.
pub const PAPER: Ink = Ink::opaque(0xFF, 0xFF, 0xFF);
