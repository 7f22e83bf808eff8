//! Colours of drawings.

use image::Rgb;

/// An sRGB colour with opacity.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize)]
#[serde(try_from = "String")]
pub struct Ink {
    pub rgb: (u8, u8, u8),
    /// Opacity, 0 to 1.
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

    /// The colour as `#RRGGBB`, without the opacity.
    pub fn hex(self) -> String {
        let (r, g, b) = self.rgb;
        format!("#{r:02X}{g:02X}{b:02X}")
    }
}

impl Ink {
    /// Relative brightness, 0..1, from the sRGB levels weighted as luma (BT.601).
    fn brightness(self) -> f64 {
        let (r, g, b) = self.rgb;
        (0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)) / 255.0
    }

    /// Adapts a colour that was chosen for a white page to `page`. [`PAPER`] becomes the page's colour. On a dark page,
    /// neutral texts, lines and bars become lighter than the page, in proportion to how much darker than white they
    /// were. Other colours stay the same.
    pub(super) fn on(self, page: Self) -> Self {
        let is_neutral = [INK, MUTED, GRID, BARS]
            .iter()
            .any(|one| one.rgb == self.rgb);
        if self.rgb == PAPER.rgb {
            return page.with_alpha(self.alpha);
        } else if page.brightness() >= 0.5 || !is_neutral {
            return self;
        }
        let contrast = 1.0 - self.brightness();
        let lighter = |level: u8| {
            let level = f64::from(level);
            (level + contrast * (255.0 - level)).round() as u8
        };
        let (r, g, b) = page.rgb;
        Self {
            rgb: (lighter(r), lighter(g), lighter(b)),
            alpha: self.alpha,
        }
    }
}

impl TryFrom<String> for Ink {
    type Error = String;

    /// Parses a colour `#RRGGBB`.
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
    /// Converts to a colour without opacity.
    fn from(ink: Ink) -> Self {
        let (r, g, b) = ink.rgb;
        Self([r, g, b])
    }
}

/// Colour of text and axes.
pub const INK: Ink = Ink::opaque(0x1B, 0x1F, 0x24);
/// Colour of secondary text.
pub const MUTED: Ink = Ink::opaque(0x57, 0x60, 0x6A);
/// Colour of grid lines.
pub const GRID: Ink = Ink::opaque(0xE1, 0xE5, 0xEA);
/// Colour of the bars that show counts.
pub const BARS: Ink = Ink::opaque(0xC9, 0xCF, 0xD6);
/// Colour of the background.
pub const PAPER: Ink = Ink::opaque(0xFF, 0xFF, 0xFF);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawing_can_be_read_on_pages_of_any_colour() {
        let dark = Ink::opaque(0x10, 0x20, 0x30);
        let contrast = |ink: Ink, page: Ink| (ink.brightness() - page.brightness()).abs();
        for page in [
            dark,
            Ink::opaque(0, 0, 0),
            PAPER,
            Ink::opaque(0xFF, 0xFA, 0xF0),
        ] {
            let [text, small, grid] = [INK, MUTED, GRID].map(|ink| contrast(ink.on(page), page));
            assert!(
                text > small && small > grid && grid > 0.03 && text > 0.6,
                "{page:?}"
            );
        }
        assert_eq!(PAPER.on(dark), dark);
        assert_eq!(INK.on(PAPER), INK);
        let of_a_method = Ink::opaque(0x00, 0x72, 0xB2);
        assert_eq!(of_a_method.on(dark), of_a_method);
    }
}
