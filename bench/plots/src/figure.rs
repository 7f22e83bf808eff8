//! The three output files of a drawing: SVG, PNG and PDF.
//!
//! plotters draws on whole pixels. Therefore the SVG is drawn at four times its size, which its
//! view box reverses, and the PNG at twice its size, which also antialiases it. The PDF is exact.

use std::fmt::Display;

use image::{RgbImage, imageops};
use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    Color as _, FontDesc, FontFamily, FontStyle, FontTransform, RGBAColor, RGBColor, ShapeStyle,
    TextStyle,
};

use super::canvas::{Anchor, Lettering, Point, Shape, Surface};
use super::ink::Ink;
use super::style::Medium;
use super::text::{self, FAMILY, Weight};
use super::{pdf, png};
use crate::PlotError;

/// Drawn pixels per unit of the SVG.
const SVG_SCALE: f64 = 4.0;
/// Drawn pixels per PNG pixel.
const REDUCE: f64 = 2.0;
/// Largest number of PNG pixels before reduction: 0.8 GB.
const MAX_DRAWN: f64 = 268_435_456.0;
/// The SVG backend divides font sizes by this.
const PLOTTERS_FONT_FACTOR: f64 = 1.24;

/// A drawing in all output formats.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// Alternative text.
    pub title: String,
    /// A complete SVG document.
    pub svg: String,
    /// A PNG file.
    pub png: Vec<u8>,
    /// A one-page PDF file; text is drawn as outlines and needs no font.
    pub pdf: Vec<u8>,
}

impl Figure {
    /// Renders the shapes that `picture` draws in each format; the size is in units.
    ///
    /// # Errors
    /// If the drawing library or an encoder fails.
    pub fn draw(
        title: &str,
        (width, height): (u32, u32),
        medium: Medium,
        picture: impl Fn(&mut Surface),
    ) -> Result<Self, PlotError> {
        let (w, h) = (f64::from(width), f64::from(height));
        let mut surface = Surface::default();
        surface.polygon(&[(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)], medium.paper);
        picture(&mut surface);
        let shapes = surface.0;
        let failed = |reason: String| PlotError::new(title, reason);
        let drawn = |scale: f64| ((w * scale).round() as u32, (h * scale).round() as u32);

        let mut svg = String::new();
        let backend = SVGBackend::with_string(&mut svg, drawn(SVG_SCALE));
        paint(backend, SVG_SCALE, &shapes, svg_letters).map_err(failed)?;

        let density = medium.zoom * medium.dpi / 96.0;
        let size = drawn(density * REDUCE);
        if f64::from(size.0) * f64::from(size.1) > MAX_DRAWN {
            return Err(failed(format!(
                "{} × {} pixels are too many to draw; use a smaller width or fewer dpi",
                size.0, size.1
            )));
        }
        let mut large = RgbImage::new(size.0, size.1);
        let backend = BitMapBackend::with_buffer(&mut large, size);
        paint(backend, density * REDUCE, &shapes, bitmap_letters).map_err(failed)?;
        let half = |side: u32| (f64::from(side) / REDUCE) as u32;
        let small = imageops::thumbnail(&large, half(size.0), half(size.1));

        let pdf = pdf::render(title, &shapes, (w, h), medium.zoom * 0.75);
        Ok(Self {
            title: title.to_owned(),
            svg: tidy(&svg, title, (w, h), medium.zoom),
            png: png::encode(&small, medium.dpi).map_err(|e| failed(e.to_string()))?,
            pdf: pdf.map_err(|e| failed(e.to_string()))?,
        })
    }
}

/// Sets the SVG's size in CSS pixels and its title for screen readers, and corrects the positions
/// of baselines.
fn tidy(svg: &str, title: &str, (width, height): (f64, f64), zoom: f64) -> String {
    let body = svg.split_once('>').map_or("", |(_, body)| body);
    let title: String = title.chars().map(escaped).collect();
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

/// Escapes a character for XML; control characters, which XML forbids, become U+FFFD.
fn escaped(c: char) -> String {
    match c {
        '<' | '>' | '&' | '"' | '\'' => format!("&#{};", u32::from(c)),
        c if c.is_control() && c != '\n' && c != '\t' => '\u{FFFD}'.to_string(),
        c => c.to_string(),
    }
}

/// Draws on a plotters backend at `scale` pixels per unit. `letters` draws a text on its baseline;
/// its sizes are in pixels.
fn paint<B: DrawingBackend>(
    mut backend: B,
    scale: f64,
    shapes: &[Shape],
    letters: impl Fn(&mut B, &str, (i32, i32), Lettering) -> Result<(), String>,
) -> Result<(), String> {
    // Clamp, so that points far outside stay outside.
    let drawn = |length: f64| (length * scale).round().clamp(-1e6, 1e6) as i32;
    let place = |(x, y): &Point| (drawn(*x), drawn(*y));
    let filled = |ink: &Ink| ShapeStyle::from(color(*ink)).filled();
    for shape in shapes {
        let done = match shape {
            Shape::Line(points, width, ink) => {
                let style = ShapeStyle {
                    color: color(*ink),
                    filled: false,
                    stroke_width: drawn(*width).max(1) as u32,
                };
                backend.draw_path(points.iter().map(place), &style)
            }
            Shape::Polygon(points, ink) => {
                backend.fill_polygon(points.iter().map(place), &filled(ink))
            }
            Shape::Disc(centre, radius, ink) => {
                backend.draw_circle(place(centre), drawn(*radius) as u32, &filled(ink), true)
            }
            Shape::Text(text, at, lettering) => {
                let lettering = Lettering {
                    size: lettering.size * scale,
                    ..*lettering
                };
                letters(&mut backend, text, place(at), lettering)?;
                Ok(())
            }
        };
        done.map_err(reason)?;
    }
    backend.present().map_err(reason)
}

fn reason(error: impl Display) -> String {
    error.to_string()
}

fn color(ink: Ink) -> RGBAColor {
    let (r, g, b) = ink.rgb;
    RGBColor(r, g, b).mix(ink.alpha)
}

fn svg_letters(
    backend: &mut SVGBackend<'_>,
    text: &str,
    at: (i32, i32),
    lettering: Lettering,
) -> Result<(), String> {
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
    let style = TextStyle::from(font)
        .color(&ink)
        .pos(Pos::new(h_pos, VPos::Bottom));
    backend.draw_text(text, &style, at).map_err(reason)
}

/// Sets text glyph by glyph, because plotters ignores the side bearings of glyphs.
fn bitmap_letters(
    backend: &mut BitMapBackend<'_>,
    text: &str,
    (x0, y0): (i32, i32),
    lettering: Lettering,
) -> Result<(), String> {
    let shift = lettering.shift(text).round() as i32;
    let (w, h) = backend.get_size();
    let mut result = Ok(());
    text::raster(text, lettering.size, lettering.weight, |x, y, coverage| {
        let (x, y) = if lettering.upwards {
            (x0 + y, y0 - (x + shift))
        } else {
            (x0 + x + shift, y0 + y)
        };
        let inside = (0..w as i32).contains(&x) && (0..h as i32).contains(&y);
        if inside && coverage > 0.0 && result.is_ok() {
            let alpha = lettering.ink.alpha * f64::from(coverage);
            let color = color(lettering.ink.with_alpha(alpha)).to_backend_color();
            result = backend.draw_pixel((x, y), color).map_err(reason);
        }
    });
    result
}
