//! Size and colours of figures: for the screen by default, for print as set in a TOML file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::ink::{Ink, PAPER};
use super::palette::{COLOURS, Marker, Style, style_of};

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
    /// Colour behind the drawing.
    pub paper: Ink,
}

impl Medium {
    /// One unit is a CSS pixel; the PNG has two dots per CSS pixel along each axis.
    pub const SCREEN: Self = Self {
        zoom: 1.0,
        dpi: 192.0,
        paper: PAPER,
    };
}

/// Style of a printed figure, read from a TOML file whose keys are all optional.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FigureStyle {
    /// Width of the whole figure, millimetres; by default one column of a two-column paper.
    pub width_mm: f64,
    /// Font size of labels, points of 1/72 inch; ticks and captions are a little smaller.
    pub font_pt: f64,
    /// Resolution of PNG files, dots per inch.
    pub dpi: f64,
    /// Height of a panel divided by its width.
    pub panel_aspect: f64,
    /// Whether plots have an explanatory line below them.
    pub caption: bool,
    /// Colours of the methods in order, `#RRGGBB`.
    pub colours: Vec<Ink>,
    /// Ends of the horizontal axis of plots; data beyond them are cut off.
    pub xlim: Option<[f64; 2]>,
    /// Ends of the vertical axis of plots; data beyond them are cut off.
    pub ylim: Option<[f64; 2]>,
    /// Label of the horizontal axis of plots.
    pub xlabel: Option<String>,
    /// Label of the vertical axis of plots.
    pub ylabel: Option<String>,
    /// Number of panels side by side; by default as many as fit.
    pub columns: Option<usize>,
    /// A line above the plot.
    pub title: Option<String>,
    /// Colour behind a plot.
    pub background: Ink,
    /// Colours and markers of methods by their names.
    pub methods: BTreeMap<String, MethodStyle>,
}

/// Colour and marker of one method. By default, they are chosen by the method's position in the run.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MethodStyle {
    pub colour: Option<Ink>,
    pub marker: Option<Marker>,
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
            xlim: None,
            ylim: None,
            xlabel: None,
            ylabel: None,
            columns: None,
            title: None,
            background: PAPER,
            methods: BTreeMap::new(),
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
    /// The error names the file and the key that is unknown or out of range.
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
        for (key, limits) in [("xlim", style.xlim), ("ylim", style.ylim)] {
            if limits.is_some_and(|[low, high]| !(high - low).is_finite() || low >= high) {
                return Err(wrong(format!("{key}: expected [LOW, HIGH]")));
            }
        }
        if style.columns == Some(0) {
            return Err(wrong("columns: expected at least 1".to_owned()));
        }
        if style.colours.is_empty() {
            return Err(wrong("colours: expected at least one".to_owned()));
        }
        Ok(style)
    }

    pub fn of_method(&self, name: &str, index: usize) -> Style {
        let style = style_of(&self.colours, index);
        let own = self.methods.get(name).cloned().unwrap_or_default();
        Style {
            ink: own.colour.unwrap_or(style.ink),
            marker: own.marker.unwrap_or(style.marker),
            ..style
        }
    }

    pub(super) fn medium(&self) -> Medium {
        Medium {
            zoom: self.font_pt * 96.0 / 72.0 / LABEL_UNITS,
            dpi: self.dpi,
            paper: self.background,
        }
    }

    /// Width of the whole figure in units.
    pub(super) fn units(&self) -> f64 {
        self.width_mm / MM_PER_INCH * 96.0 / self.medium().zoom
    }

    /// Error message that asks for a figure `times` as wide.
    pub fn narrow(&self, times: f64) -> String {
        let Self {
            width_mm, font_pt, ..
        } = self;
        format!(
            "text of {font_pt} pt does not fit into a width of {width_mm} mm; use a width_mm of {:.0}, or a smaller \
             font_pt",
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
    fn a_method_has_its_colour_and_marker_by_name() {
        let style = read("[methods.ours]\ncolour = \"#ff0000\"\nmarker = \"up\"\n").unwrap();
        let ours = style.of_method("ours", 3);
        assert_eq!(
            (ours.ink, ours.marker),
            (Ink::opaque(255, 0, 0), Marker::Up)
        );
        assert_eq!(style.of_method("other", 3), style_of(&COLOURS, 3));
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
            ("xlim = [1, 1]", "xlim: expected [LOW, HIGH]"),
            ("columns = 0", "columns: expected at least 1"),
            ("[methods.a]\nmarker = \"star\"", "unknown variant `star`"),
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
