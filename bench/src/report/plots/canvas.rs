//! A drawing surface, and the three files that a drawing becomes: SVG, PNG and PDF.
//!
//! plotters draws on whole pixels, so that the SVG is drawn four times as large as its units, as its view box says, and
//! the PNG twice as large as it will be, which also smooths it. The [PDF](super::pdf) is exact.

use std::path::{Path, PathBuf};

use askama::filters::{Html, escape};
use image::{Rgb, RgbImage, imageops};
use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::style::FontTransform;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    Color as _, FontDesc, FontFamily, FontStyle, RGBColor, ShapeStyle, TextStyle,
};

use super::pdf::Pdf;
use super::png;
use super::style::Medium;
use super::text::{self, FAMILY, Weight};
use crate::io::atomic_files::{FileError, write_all_over_own};
use crate::io::text::visible;
use crate::report::error::ReportError;

/// Drawn pixels per unit of the SVG.
const SVG_SCALE: f64 = 4.0;
/// Drawn pixels per PNG pixel.
const REDUCE: f64 = 2.0;
/// Pixels of a PNG before it is reduced, at most: 0.8 GB.
const MAX_DRAWN: f64 = 268_435_456.0;
/// The SVG backend divides font sizes by this.
const PLOTTERS_FONT_FACTOR: f64 = 1.24;

/// sRGB and opacity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ink {
    pub rgb: (u8, u8, u8),
    /// 0..1.
    pub alpha: f64,
}

impl Ink {
    pub const fn opaque(r: u8, g: u8, b: u8) -> Self {
        Self {
            rgb: (r, g, b),
            alpha: 1.0,
        }
    }

    /// The same colour, thinner.
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

impl From<Ink> for Rgb<u8> {
    /// Without the opacity.
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

/// Anchor of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// Style of text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lettering {
    /// Font size, units.
    pub size: f64,
    pub weight: Weight,
    pub ink: Ink,
    /// Horizontal anchor; the point's y is the baseline.
    pub anchor: Anchor,
    /// Whether the text runs upwards.
    pub upwards: bool,
}

/// Points in units, CSS pixels at [`Medium::SCREEN`]; y down.
pub type Point = (f64, f64);

/// A drawing surface.
pub trait Surface {
    /// An open line.
    fn line(&mut self, points: &[Point], width: f64, ink: Ink);
    /// A filled polygon.
    fn polygon(&mut self, points: &[Point], ink: Ink);
    /// A filled circle.
    fn disc(&mut self, centre: Point, radius: f64, ink: Ink);
    /// A line of text.
    fn text(&mut self, text: &str, at: Point, lettering: Lettering);
}

/// A drawing in all its forms.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// What it shows, in words: its alternative text.
    pub title: String,
    /// A complete SVG document.
    pub svg: String,
    /// The same in pixels.
    pub png: Vec<u8>,
    /// The same as one page of PDF; text is drawn as outlines, so that it needs no font.
    pub pdf: Vec<u8>,
}

/// Stands in every file of a figure, so that the next one may take its place.
pub const MARK: &str = "sharp-bench";

/// The files of a figure, by the ends of their names.
pub const FORMS: [&str; 3] = ["svg", "png", "pdf"];

impl Figure {
    /// Writes `STEM.svg`, `STEM.png` and `STEM.pdf`.
    ///
    /// # Errors
    /// When one cannot be written, or a file of that name is none of ours; then none is written.
    pub fn write(self, out: &Path, stem: &str) -> Result<Vec<PathBuf>, FileError> {
        write_all_over_own(&self.files(out, stem))
    }

    /// The files of [`Self::write`], for [`write_all_over_own`].
    pub fn files(self, out: &Path, stem: &str) -> [(PathBuf, Vec<u8>, &'static str); 3] {
        let svg = format!("<!-- {MARK} -->\n{}", visible(&self.svg));
        let path = |form: &str| out.join(format!("{stem}.{form}"));
        let [svg_form, png_form, pdf_form] = FORMS.map(path);
        [
            (svg_form, svg.into_bytes(), MARK),
            (png_form, self.png, MARK),
            (pdf_form, self.pdf, MARK),
        ]
    }

    /// Draws once for each form; the size is in units.
    ///
    /// # Errors
    /// When the drawing library or the encoder refuses.
    pub fn draw(
        title: &str,
        (width, height): (u32, u32),
        medium: Medium,
        picture: impl Fn(&mut dyn Surface),
    ) -> Result<Self, ReportError> {
        let (w, h) = (f64::from(width), f64::from(height));
        let background = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)];
        let failed = |reason: String| ReportError::Plot {
            plot: title.to_owned(),
            reason,
        };
        let drawn = |scale: f64| ((w * scale).round() as u32, (h * scale).round() as u32);
        let mut svg = String::new();
        let backend = SVGBackend::with_string(&mut svg, drawn(SVG_SCALE));
        let mut pen = Pen::new(backend, SVG_SCALE);
        pen.polygon(&background, PAPER);
        picture(&mut pen);
        pen.finish().map_err(failed)?;
        drop(pen);

        let density = medium.zoom * medium.dpi / 96.0;
        let size = drawn(density * REDUCE);
        if f64::from(size.0) * f64::from(size.1) > MAX_DRAWN {
            return Err(failed(format!(
                "{} × {} pixels are too many to draw; a smaller width or fewer dpi",
                size.0, size.1
            )));
        }
        let mut pixels = vec![0_u8; size.0 as usize * size.1 as usize * 3];
        let backend = BitMapBackend::with_buffer(&mut pixels, size);
        let mut pen = Pen::new(backend, density * REDUCE);
        pen.polygon(&background, PAPER);
        picture(&mut pen);
        pen.finish().map_err(failed)?;
        drop(pen);
        let large = RgbImage::from_raw(size.0, size.1, pixels)
            .ok_or_else(|| failed("the picture has not the size asked for".into()))?;
        let half = |side: u32| (f64::from(side) / REDUCE) as u32;
        let small = imageops::thumbnail(&large, half(size.0), half(size.1));

        let mut pdf = Pdf::new((w, h), medium.zoom * 0.75);
        pdf.polygon(&background, PAPER);
        picture(&mut pdf);
        Ok(Self {
            title: title.to_owned(),
            svg: tidy(&svg, title, (w, h), medium.zoom),
            png: png::encode(&small, medium.dpi).map_err(|e| failed(e.to_string()))?,
            pdf: pdf.finish(title).map_err(|e| failed(e.to_string()))?,
        })
    }
}

/// Size in CSS pixels, a title for readers, exact baselines.
fn tidy(svg: &str, title: &str, (width, height): (f64, f64), zoom: f64) -> String {
    let body = svg.split_once('>').map_or("", |(_, body)| body);
    let title = xml_text(title);
    let shown = |side: f64| (side * zoom * 100.0).round() / 100.0;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 0 {} {}\" \
         role=\"img\" aria-label=\"{title}\">\n<title>{title}</title>{}",
        shown(width),
        shown(height),
        width * SVG_SCALE,
        height * SVG_SCALE,
        body.replace(" dy=\"-0.5ex\"", "")
    )
}

/// Text that stays text, in elements and in attributes, without the control characters that XML has no place for.
fn xml_text(text: &str) -> String {
    let readable = |c: char| match c {
        c if c.is_control() && c != '\n' && c != '\t' => '\u{FFFD}',
        c => c,
    };
    let text: String = text.chars().map(readable).collect();
    let Ok(escaped) = escape(text, Html);
    escaped.to_string()
}

/// A backend and the first error it met; drawing after that does nothing.
struct Pen<B: DrawingBackend> {
    backend: B,
    /// Drawn pixels per unit.
    scale: f64,
    error: Option<String>,
}

impl<B: DrawingBackend> Pen<B> {
    fn new(backend: B, scale: f64) -> Self {
        Self {
            backend,
            scale,
            error: None,
        }
    }

    fn draw<E: std::fmt::Display>(&mut self, action: impl FnOnce(&mut B) -> Result<(), E>) {
        if self.error.is_none() {
            self.error = action(&mut self.backend).err().map(|e| e.to_string());
        }
    }

    /// Units to drawn pixels; far outside stays far outside.
    fn drawn(&self, length: f64) -> i32 {
        (length * self.scale).round().clamp(-1e6, 1e6) as i32
    }

    fn place(&self, (x, y): Point) -> (i32, i32) {
        (self.drawn(x), self.drawn(y))
    }

    fn finish(&mut self) -> Result<(), String> {
        self.draw(|b| b.present());
        self.error.take().map_or(Ok(()), Err)
    }
}

impl<B: TextBackend> Surface for Pen<B> {
    fn line(&mut self, points: &[Point], width: f64, ink: Ink) {
        let style = ShapeStyle {
            color: color(ink),
            filled: false,
            stroke_width: self.drawn(width).max(1) as u32,
        };
        let points: Vec<_> = points.iter().map(|p| self.place(*p)).collect();
        self.draw(|b| b.draw_path(points, &style));
    }

    fn polygon(&mut self, points: &[Point], ink: Ink) {
        let points: Vec<_> = points.iter().map(|p| self.place(*p)).collect();
        let style = ShapeStyle::from(color(ink)).filled();
        self.draw(|b| b.fill_polygon(points, &style));
    }

    fn disc(&mut self, centre: Point, radius: f64, ink: Ink) {
        let style = ShapeStyle::from(color(ink)).filled();
        let (centre, radius) = (self.place(centre), self.drawn(radius) as u32);
        self.draw(|b| b.draw_circle(centre, radius, &style, true));
    }

    fn text(&mut self, text: &str, at: Point, lettering: Lettering) {
        let at = self.place(at);
        let lettering = Lettering {
            size: lettering.size * self.scale,
            ..lettering
        };
        self.draw(|b| b.letters(text, at, lettering));
    }
}

fn color(ink: Ink) -> plotters::style::RGBAColor {
    let (r, g, b) = ink.rgb;
    RGBColor(r, g, b).mix(ink.alpha)
}

/// A backend that can set text on a baseline; its font size is in drawn pixels.
trait TextBackend: DrawingBackend {
    fn letters(&mut self, text: &str, at: (i32, i32), lettering: Lettering) -> Result<(), String>;
}

impl TextBackend for SVGBackend<'_> {
    fn letters(&mut self, text: &str, at: (i32, i32), lettering: Lettering) -> Result<(), String> {
        let style = match lettering.weight {
            Weight::Regular => FontStyle::Normal,
            Weight::Bold => FontStyle::Bold,
        };
        let size = lettering.size * PLOTTERS_FONT_FACTOR;
        let mut font = FontDesc::new(FontFamily::Name(FAMILY), size, style);
        if lettering.upwards {
            font = font.transform(FontTransform::Rotate270);
        }
        let h_pos = match lettering.anchor {
            Anchor::Start => HPos::Left,
            Anchor::Middle => HPos::Center,
            Anchor::End => HPos::Right,
        };
        let ink = color(lettering.ink);
        let style = TextStyle::from(font).color(&ink);
        let style = style.pos(Pos::new(h_pos, VPos::Bottom));
        self.draw_text(text, &style, at).map_err(|e| e.to_string())
    }
}

impl TextBackend for BitMapBackend<'_> {
    /// Laid out here and not by plotters, which ignores the side bearings of glyphs.
    fn letters(
        &mut self,
        text: &str,
        (x0, y0): (i32, i32),
        lettering: Lettering,
    ) -> Result<(), String> {
        let size = lettering.size;
        let width = text::width(text, size, lettering.weight);
        let shift = match lettering.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -width / 2.0,
            Anchor::End => -width,
        }
        .round() as i32;
        let (w, h) = self.get_size();
        let mut result = Ok(());
        text::raster(text, size, lettering.weight, |x, y, coverage| {
            let (x, y) = if lettering.upwards {
                (x0 + y, y0 - (x + shift))
            } else {
                (x0 + x + shift, y0 + y)
            };
            let inside = (0..w as i32).contains(&x) && (0..h as i32).contains(&y);
            if inside && coverage > 0.0 && result.is_ok() {
                let alpha = lettering.ink.alpha * f64::from(coverage);
                let color = color(lettering.ink.with_alpha(alpha)).to_backend_color();
                result = self.draw_pixel((x, y), color).map_err(|e| e.to_string());
            }
        });
        result
    }
}
