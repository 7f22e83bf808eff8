//! Size and colours of figures: for the screen by default, for print as set in a TOML file.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer, de};

use super::ink::Ink;
use super::palette::{COLOURS, Style, style_of};

/// Font size of axis labels in units; all lengths in a plot scale with it.
const LABEL_UNITS: f64 = 12.5;
const MM_PER_INCH: f64 = 25.4;

/// Scale from a drawing's units to printed sizes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// CSS pixels (1/96 inch) per unit.
    pub zoom: f64,
    /// Resolution of the PNG, dots per inch.
    pub dpi: f64,
}

impl Medium {
    /// One unit is a CSS pixel; the PNG has two dots per CSS pixel along each axis.
    pub const SCREEN: Self = Self {
        zoom: 1.0,
        dpi: 192.0,
    };
}

/// Style of a printed figure. Every key of its file is optional.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FigureStyle {
    /// Width of the whole figure, millimetres; by default one column of a two-column paper.
    pub width_mm: f64,
    /// Font size of labels, points of 1/72 inch; ticks and captions are a little smaller.
    pub font_pt: f64,
    /// Resolution of PNG files, dots per inch.
    pub dpi: f64,
    /// Height of a panel over its width.
    pub panel_aspect: f64,
    /// Whether plots have an explanatory line below.
    pub caption: bool,
    /// Colours of the methods in order, `#RRGGBB`.
    #[serde(deserialize_with = "inks")]
    pub colours: Vec<Ink>,
}

impl Default for FigureStyle {
    fn default() -> Self {
        Self {
            width_mm: 84.0,
            font_pt: 8.0,
            dpi: 300.0,
            panel_aspect: 0.62,
            caption: true,
            colours: COLOURS.into(),
        }
    }
}

/// Why a style cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct StyleError {
    path: PathBuf,
    reason: String,
}

impl FigureStyle {
    /// Reads a TOML file.
    ///
    /// # Errors
    /// Names the file and the key that is unknown or out of range.
    pub fn read(path: &Path) -> Result<Self, StyleError> {
        let wrong = |reason: String| StyleError {
            path: path.to_owned(),
            reason,
        };
        let text = sharp::files::read_text(path).map_err(|error| wrong(error.to_string()))?;
        let style: Self = toml::from_str(&text).map_err(|error| {
            let line = error.span().map_or(1, |span| {
                1 + text[..span.start.min(text.len())].matches('\n').count()
            });
            wrong(format!(
                "line {line}: {}",
                error.message().replace('\n', " ")
            ))
        })?;
        let ranges = [
            ("width_mm", style.width_mm, 20.0, 1000.0),
            ("font_pt", style.font_pt, 3.0, 40.0),
            ("dpi", style.dpi, 50.0, 1200.0),
            ("panel_aspect", style.panel_aspect, 0.1, 5.0),
        ];
        for (key, value, least, most) in ranges {
            if !(least..=most).contains(&value) {
                return Err(wrong(format!(
                    "{key} = {value}: expected a number between {least} and {most}"
                )));
            }
        }
        if style.colours.is_empty() {
            return Err(wrong("colours: at least one is needed".to_owned()));
        }
        Ok(style)
    }

    /// The style of method number `index`.
    pub fn of_method(&self, index: usize) -> Style {
        style_of(&self.colours, index)
    }

    pub(super) fn medium(&self) -> Medium {
        Medium {
            zoom: self.font_pt * 96.0 / 72.0 / LABEL_UNITS,
            dpi: self.dpi,
        }
    }

    /// Width of the whole figure in units.
    pub(super) fn units(&self) -> f64 {
        self.width_mm / MM_PER_INCH * 96.0 / self.medium().zoom
    }

    /// Error message that the figure must be `times` times as wide.
    pub fn narrow(&self, times: f64) -> String {
        let Self {
            width_mm, font_pt, ..
        } = self;
        format!(
            "a width of {width_mm} mm has no room for text of {font_pt} pt: use a width_mm of \
             {:.0}, or a smaller font_pt",
            (width_mm * times).ceil()
        )
    }

    /// Width of the whole figure in pixels.
    pub fn pixels(&self) -> u32 {
        (self.width_mm / MM_PER_INCH * self.dpi).round() as u32
    }

    /// Font size in pixels.
    pub fn font_pixels(&self) -> f64 {
        self.font_pt / 72.0 * self.dpi
    }
}

fn inks<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Ink>, D::Error> {
    let texts = Vec::<String>::deserialize(deserializer)?;
    let ink = |text: &String| {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6);
        let hex = digits.filter(|digits| digits.bytes().all(|c| c.is_ascii_hexdigit()));
        let value = hex.and_then(|digits| u32::from_str_radix(digits, 16).ok());
        let [_, r, g, b] = value.map(u32::to_be_bytes).ok_or_else(|| {
            de::Error::custom(format!("colours: '{text}' is not of the form #RRGGBB"))
        })?;
        Ok(Ink::opaque(r, g, b))
    };
    texts.iter().map(ink).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<FigureStyle, String> {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("s.toml");
        std::fs::write(&file, text).unwrap();
        FigureStyle::read(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn a_file_changes_what_it_names() {
        let style = read("width_mm = 174\ncolours = [\"#0000ff\"]\n").unwrap();
        let expected = FigureStyle {
            width_mm: 174.0,
            colours: vec![Ink::opaque(0, 0, 255)],
            ..FigureStyle::default()
        };
        assert_eq!(style, expected);
        assert_eq!(read("").unwrap(), FigureStyle::default());
        // 174 mm at 300 dpi, 8 pt at 300 dpi.
        assert_eq!(style.pixels(), 2055);
        assert!((style.font_pixels() - 100.0 / 3.0).abs() < 1e-12);
        // Labels of 12.5 units are 8 pt of 96/72 CSS pixels.
        assert!((style.medium().zoom * 12.5 - 32.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_file() {
        for (text, part) in [
            ("widht_mm = 3", "line 1: unknown field `widht_mm`"),
            (
                "\ndpi = 1",
                "dpi = 1: expected a number between 50 and 1200",
            ),
            ("font_pt = nan", "font_pt"),
            ("colours = [\"red\"]", "'red' is not of the form #RRGGBB"),
            ("colours = [\"#+12345\"]", "#RRGGBB"),
            ("colours = []", "at least one"),
            ("dpi = ", "line 1"),
        ] {
            let error = read(text).unwrap_err();
            assert!(
                error.contains("s.toml: ") && error.contains(part),
                "{error}"
            );
            assert!(!error.contains('\n'), "{error}");
        }
    }
}
