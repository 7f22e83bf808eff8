//! The three output files of a drawing: SVG, PNG and PDF.
//!
//! plotters draws on whole pixels. Therefore, the SVG is drawn at four times its size and scaled
//! back by its view box, and the PNG is drawn at twice its size and reduced, which also antialiases
//! it. The PDF is exact.

use std::fmt::{Display, Write as _};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::{RgbImage, imageops};
use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    Color as _, FontDesc, FontFamily, FontStyle, FontTransform, RGBAColor, RGBColor, ShapeStyle,
    TextStyle,
};

use super::canvas::{Anchor, Lettering, Point, Shape, Surface};
use super::ink::{Ink, PAPER};
use super::style::Medium;
use super::text::{self, FAMILY, Weight};
use super::{pdf, png};
use crate::PlotError;

/// Drawn pixels per unit of the SVG.
const SVG_SCALE: f64 = 4.0;
/// Drawn pixels per PNG pixel, along each axis.
const DRAWN_PER_PIXEL: f64 = 2.0;
/// Largest number of pixels drawn for a PNG, before reduction: 0.8 GB.
const MAX_DRAWN: f64 = 268_435_456.0;
/// The SVG backend divides font sizes by this factor.
const PLOTTERS_FONT_FACTOR: f64 = 1.24;

/// A drawing in all output formats.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// Title of the figure, used as alternative text.
    pub title: String,
    /// A complete SVG document.
    pub svg: String,
    pub png: Vec<u8>,
    /// A one-page PDF file; text is drawn as outlines and needs no font.
    pub pdf: Vec<u8>,
}

impl Figure {
    /// Renders, in all three formats, the shapes that `picture` draws; width and height are in
    /// units.
    ///
    /// # Errors
    /// If the drawing library or an encoder fails.
    pub fn draw(
        title: &str,
        (width, height): (u32, u32),
        medium: Medium,
        picture: impl Fn(&mut Surface),
    ) -> Result<Self, PlotError> {
        let drawing = Drawing::new(title, (width, height), medium, picture);
        Ok(Self {
            title: title.to_owned(),
            svg: drawing.svg()?,
            png: drawing.png()?,
            pdf: drawing.pdf()?,
        })
    }
}

/// Shapes with a size, to be written in one format or several.
pub struct Drawing<'a> {
    title: &'a str,
    size: Point,
    medium: Medium,
    shapes: Vec<Shape>,
}

impl<'a> Drawing<'a> {
    /// Collects the shapes that `picture` draws; width and height are in units.
    pub fn new(
        title: &'a str,
        (width, height): (u32, u32),
        medium: Medium,
        picture: impl FnOnce(&mut Surface),
    ) -> Self {
        let (w, h) = (f64::from(width), f64::from(height));
        let mut surface = Surface::default();
        surface.polygon(&[(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)], PAPER);
        picture(&mut surface);
        surface.lay_on(medium.paper);
        Self {
            title,
            size: (w, h),
            medium,
            shapes: surface.0,
        }
    }

    fn failed(&self, reason: impl ToString) -> PlotError {
        PlotError::new(self.title, reason)
    }

    /// Width and height at `scale` pixels per unit.
    fn pixels(&self, scale: f64) -> (u32, u32) {
        let (w, h) = self.size;
        ((w * scale).round() as u32, (h * scale).round() as u32)
    }

    /// A complete SVG document.
    ///
    /// # Errors
    /// If the drawing library or the encoder of pictures fails.
    pub fn svg(&self) -> Result<String, PlotError> {
        let mut svg = String::new();
        let backend = SVGBackend::with_string(&mut svg, self.pixels(SVG_SCALE));
        let later = |_: &mut SVGBackend<'_>, _: &RgbImage, _: (i32, i32), _: (u32, u32)| Ok(());
        let done = paint(backend, SVG_SCALE, &self.shapes, svg_letters, later);
        done.map_err(|e| self.failed(e))?;
        let mut pictures = String::new();
        for shape in &self.shapes {
            if let Shape::Picture(picture, at, size) = shape {
                let png = png::encode(picture, self.medium.dpi).map_err(|e| self.failed(e))?;
                let [x, y, w, h] = [at.0, at.1, size.0, size.1].map(|v| v * SVG_SCALE);
                let data = STANDARD.encode(png);
                let written = write!(
                    pictures,
                    "\n<image x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" preserveAspectRatio=\"none\" \
                     href=\"data:image/png;base64,{data}\"/>"
                );
                written.map_err(|e| self.failed(e))?;
            }
        }
        Ok(tidy(
            &svg,
            self.title,
            self.size,
            self.medium.zoom,
            &pictures,
        ))
    }

    /// A PNG file.
    ///
    /// # Errors
    /// If the picture would be too large, or the drawing library or the encoder fails.
    pub fn png(&self) -> Result<Vec<u8>, PlotError> {
        let density = self.medium.zoom * self.medium.dpi / 96.0;
        let size = self.pixels(density * DRAWN_PER_PIXEL);
        if f64::from(size.0) * f64::from(size.1) > MAX_DRAWN {
            return Err(self.failed(format!(
                "{} × {} pixels are too many to draw; use a smaller width or a lower dpi",
                size.0, size.1
            )));
        }
        let mut large = RgbImage::new(size.0, size.1);
        let backend = BitMapBackend::with_buffer(&mut large, size);
        let scale = density * DRAWN_PER_PIXEL;
        let done = paint(backend, scale, &self.shapes, bitmap_letters, bitmap_picture);
        done.map_err(|e| self.failed(e))?;
        let half = |side: u32| (f64::from(side) / DRAWN_PER_PIXEL) as u32;
        let small = imageops::thumbnail(&large, half(size.0), half(size.1));
        png::encode(&small, self.medium.dpi).map_err(|e| self.failed(e))
    }

    /// A one-page PDF file.
    ///
    /// # Errors
    /// If the encoder fails.
    pub fn pdf(&self) -> Result<Vec<u8>, PlotError> {
        let points = self.medium.zoom * 0.75;
        pdf::render(self.title, &self.shapes, self.size, points).map_err(|e| self.failed(e))
    }
}

/// Sets the SVG's size in CSS pixels and its title for screen readers, corrects the positions of baselines, and inserts
/// pictures after the background.
fn tidy(svg: &str, title: &str, (width, height): Point, zoom: f64, pictures: &str) -> String {
    let body = svg.split_once('>').map_or("", |(_, body)| body);
    let (paper, rest) = body.split_once("/>").unwrap_or((body, ""));
    let title: String = title.chars().map(escaped).collect();
    let shown = |side: f64| (side * zoom * 100.0).round() / 100.0;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 0 {} {}\" \
         role=\"img\" aria-label=\"{title}\">\n<title>{title}</title>{paper}/>{pictures}{}",
        shown(width),
        shown(height),
        width * SVG_SCALE,
        height * SVG_SCALE,
        rest.replace(" dy=\"-0.5ex\"", "")
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

/// Draws on a plotters backend at `scale` pixels per unit. `letters` draws a text at its baseline;
/// `pictures` draws a picture at its upper left corner. Sizes passed to both functions are in
/// pixels.
fn paint<B: DrawingBackend>(
    mut backend: B,
    scale: f64,
    shapes: &[Shape],
    letters: impl Fn(&mut B, &str, (i32, i32), Lettering) -> Result<(), String>,
    pictures: impl Fn(&mut B, &RgbImage, (i32, i32), (u32, u32)) -> Result<(), String>,
) -> Result<(), String> {
    // Clamp the values, so that points far outside the picture stay outside.
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
            Shape::Picture(picture, at, size) => {
                let size = place(size);
                let size = (size.0.max(1) as u32, size.1.max(1) as u32);
                pictures(&mut backend, picture, place(at), size)?;
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

/// Draws a picture enlarged without smoothing.
fn bitmap_picture(
    backend: &mut BitMapBackend<'_>,
    picture: &RgbImage,
    at: (i32, i32),
    (width, height): (u32, u32),
) -> Result<(), String> {
    let filter = if width > picture.width() {
        imageops::FilterType::Nearest
    } else {
        imageops::FilterType::Triangle
    };
    let shown = imageops::resize(picture, width, height, filter);
    backend
        .blit_bitmap(at, (width, height), shown.as_raw())
        .map_err(reason)
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
