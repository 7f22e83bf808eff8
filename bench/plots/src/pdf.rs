//! Writes a drawing as a one-page PDF, deterministically (no clock, no random numbers).
//!
//! The drawing is not converted from the SVG: a converter would add a second font renderer and some
//! forty crates. Glyphs are filled outlines, which every publisher accepts; a font would have to be
//! embedded.

use std::collections::BTreeSet;
use std::io::{self, Write as _};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use image::RgbImage;
use pdf_writer::types::LineJoinStyle;
use pdf_writer::{Content, Filter, Finish as _, Name, Rect, Ref, TextStr};

use super::canvas::{Lettering, Point, Shape};
use super::ink::Ink;
use super::text::{self, Stroke};

/// Distance of a quarter circle's control points along its tangents, in radii.
const ARC: f64 = 0.552_284_75;

/// Renders a page of `width` × `height` units as PDF; a unit is `points` points (1/72 inch) long.
pub(super) fn render(
    title: &str,
    shapes: &[Shape],
    (width, height): (f64, f64),
    points: f64,
) -> io::Result<Vec<u8>> {
    let size = [width * points, height * points].map(|side| side as f32);
    let scale = points as f32;
    let mut page = Page {
        content: Content::new(),
        alphas: BTreeSet::new(),
        pictures: Vec::new(),
    };
    // Coordinates below are in units, with y pointing down.
    page.content
        .transform([scale, 0.0, 0.0, -scale, 0.0, size[1]]);
    page.content.set_line_join(LineJoinStyle::RoundJoin);
    for shape in shapes {
        page.draw(shape);
    }
    page.finish(title, size)
}

struct Page {
    /// Operators of the page.
    content: Content,
    /// Opacities in use, in thousandths.
    alphas: BTreeSet<u32>,
    pictures: Vec<RgbImage>,
}

impl Page {
    fn draw(&mut self, shape: &Shape) {
        match shape {
            Shape::Line(points, width, ink) => {
                let [r, g, b] = self.ink(*ink);
                self.content.set_stroke_rgb(r, g, b);
                self.content.set_line_width(placed((*width, 0.0)).0);
                self.path(points);
                self.content.stroke();
            }
            Shape::Polygon(points, ink) => {
                self.fill(*ink);
                self.path(points);
                self.content.fill_nonzero();
            }
            Shape::Disc((x, y), r, ink) => {
                self.fill(*ink);
                let k = r * ARC;
                self.move_to((x + r, *y));
                self.curve_to([(x + r, y + k), (x + k, y + r), (*x, y + r)]);
                self.curve_to([(x - k, y + r), (x - r, y + k), (x - r, *y)]);
                self.curve_to([(x - r, y - k), (x - k, y - r), (*x, y - r)]);
                self.curve_to([(x + k, y - r), (x + r, y - k), (x + r, *y)]);
                self.content.fill_nonzero();
            }
            Shape::Text(text, at, lettering) => self.letters(text, *at, *lettering),
            Shape::Picture(picture, at, size) => {
                let ((x, y), (w, h)) = (placed(*at), placed(*size));
                self.content.save_state();
                // A picture fills the unit square upwards.
                self.content.transform([w, 0.0, 0.0, -h, x, y + h]);
                self.content
                    .x_object(Name(picture_name(self.pictures.len()).as_bytes()));
                self.content.restore_state();
                self.pictures.push(picture.clone());
            }
        }
    }

    fn letters(&mut self, text: &str, (x, y): Point, lettering: Lettering) {
        self.fill(lettering.ink);
        let shift = lettering.shift(text);
        let place = |(dx, dy): Point| {
            if lettering.upwards {
                (x + dy, y - dx - shift)
            } else {
                (x + dx + shift, y + dy)
            }
        };
        let mut is_drawn = false;
        text::outlines(text, lettering.size, lettering.weight, |stroke| {
            is_drawn = true;
            match stroke {
                Stroke::Move(to) => self.move_to(place(to)),
                Stroke::Line(to) => self.line_to(place(to)),
                Stroke::Curve(a, b, to) => self.curve_to([a, b, to].map(place)),
            }
        });
        if is_drawn {
            self.content.fill_nonzero();
        }
    }

    /// Sets the opacity and returns the colour as red, green and blue in 0..1.
    fn ink(&mut self, ink: Ink) -> [f32; 3] {
        let alpha = (ink.alpha.clamp(0.0, 1.0) * 1000.0).round() as u32;
        self.alphas.insert(alpha);
        self.content.set_parameters(Name(state(alpha).as_bytes()));
        let (r, g, b) = ink.rgb;
        [r, g, b].map(|level| f32::from(level) / 255.0)
    }

    fn fill(&mut self, ink: Ink) {
        let [r, g, b] = self.ink(ink);
        self.content.set_fill_rgb(r, g, b);
    }

    fn move_to(&mut self, to: Point) {
        let (x, y) = placed(to);
        self.content.move_to(x, y);
    }

    fn line_to(&mut self, to: Point) {
        let (x, y) = placed(to);
        self.content.line_to(x, y);
    }

    fn curve_to(&mut self, [a, b, to]: [Point; 3]) {
        let ((ax, ay), (bx, by), (x, y)) = (placed(a), placed(b), placed(to));
        self.content.cubic_to(ax, ay, bx, by, x, y);
    }

    fn path(&mut self, points: &[Point]) {
        for (i, point) in points.iter().enumerate() {
            match i {
                0 => self.move_to(*point),
                _ => self.line_to(*point),
            }
        }
    }

    /// Assembles the PDF file.
    fn finish(self, title: &str, [width, height]: [f32; 2]) -> io::Result<Vec<u8>> {
        let [catalog, pages, page, info, drawing] = [1, 2, 3, 4, 5].map(Ref::new);
        let packed = packed(&self.content.finish())?;
        let mut file = pdf_writer::Pdf::new();
        file.catalog(catalog).pages(pages);
        file.pages(pages).kids([page]).count(1);
        let mut sheet = file.page(page);
        sheet
            .parent(pages)
            .media_box(Rect::new(0.0, 0.0, width, height))
            .contents(drawing);
        let mut resources = sheet.resources();
        let mut states = resources.ext_g_states();
        for alpha in self.alphas {
            let share = alpha as f32 / 1000.0;
            states
                .insert(Name(state(alpha).as_bytes()))
                .start::<pdf_writer::writers::ExtGraphicsState>()
                .non_stroking_alpha(share)
                .stroking_alpha(share);
        }
        states.finish();
        let reference = |i: usize| Ref::new(drawing.get() + 1 + i as i32);
        let mut objects = resources.x_objects();
        for i in 0..self.pictures.len() {
            objects.pair(Name(picture_name(i).as_bytes()), reference(i));
        }
        objects.finish();
        resources.finish();
        sheet.finish();
        file.document_info(info)
            .title(TextStr(title))
            .producer(TextStr("sharp-bench"));
        file.stream(drawing, &packed).filter(Filter::FlateDecode);
        for (i, picture) in self.pictures.iter().enumerate() {
            let pixels = self::packed(picture.as_raw())?;
            let mut object = file.image_xobject(reference(i), &pixels);
            object.filter(Filter::FlateDecode);
            object
                .width(picture.width() as i32)
                .height(picture.height() as i32)
                .bits_per_component(8)
                .color_space()
                .device_rgb();
        }
        Ok(file.finish())
    }
}

fn packed(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::best());
    packed.write_all(bytes)?;
    packed.finish()
}

fn picture_name(index: usize) -> String {
    format!("P{index}")
}

/// Resource name of an opacity.
fn state(alpha: u32) -> String {
    format!("A{alpha}")
}

/// Rounds coordinates to a hundredth. NaN becomes 0; infinite or very large values are clamped but stay outside the
/// page.
fn placed((x, y): Point) -> (f32, f32) {
    let number = |v: f64| {
        let v = if v.is_nan() { 0.0 } else { v.clamp(-1e5, 1e5) };
        ((v * 100.0).round() / 100.0) as f32
    };
    (number(x), number(y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ink::INK;

    #[test]
    fn another_library_finds_one_page_with_its_drawing_and_title() {
        use hayro_syntax::object::{Dict, Number};

        let shapes = [
            Shape::Line(vec![(0.0, 0.0), (f64::INFINITY, f64::NAN)], 1.0, INK),
            Shape::Disc((5.0, 5.0), 2.0, INK.with_alpha(0.16)),
            Shape::Picture(
                RgbImage::from_pixel(3, 2, image::Rgb([1, 2, 3])),
                (10.0, 5.0),
                (30.0, 20.0),
            ),
        ];
        let bytes = render(") >> é", &shapes, (100.0, 50.0), 0.75).unwrap();
        let file = hayro_syntax::Pdf::new(bytes).unwrap();
        // MuPDF reads the count, other programs read the list.
        let catalog: Dict<'_> = file.xref().get(file.xref().root_id()).unwrap();
        let pages: Dict<'_> = catalog.get("Pages").unwrap();
        assert_eq!((pages.get("Count"), file.pages().len()), (Some(1), 1));
        let page = &file.pages()[0];
        assert_eq!(page.base_dimensions(), (75.0, 37.5));
        let mut drawn = Vec::new();
        let mut operations = page.operations();
        while let Some(operation) = operations.next() {
            let operands = operation.operands();
            let numbers = operands
                .filter_map(|operand| operand.clone().into_number().as_ref().map(Number::as_f64));
            drawn.push((
                String::from_utf8_lossy(operation.operator).into_owned(),
                numbers.collect::<Vec<_>>(),
            ));
        }
        let of = |name: &str| {
            drawn
                .iter()
                .filter(|(operator, _)| operator == name)
                .collect::<Vec<_>>()
        };
        assert_eq!(of("l")[0].1, [1e5, 0.0]);
        assert_eq!((of("c").len(), of("f").len(), of("S").len()), (4, 1, 1));
        let faint = page
            .resources()
            .ext_g_states
            .get::<Dict<'_>>("A160")
            .unwrap();
        assert_eq!(faint.get::<Number>("ca").unwrap().as_f64(), 0.16);
        // Maps the upright unit square: width, height, and the lower left corner.
        assert_eq!(of("cm")[1].1, [30.0, 0.0, 0.0, -20.0, 10.0, 25.0]);
        let picture = page
            .resources()
            .x_objects
            .get::<hayro_syntax::object::Stream<'_>>("P0")
            .unwrap();
        assert_eq!(picture.decoded().unwrap().as_ref(), [1, 2, 3].repeat(6));
        let title = file.metadata().title.clone().unwrap();
        let units: Vec<u16> = title
            .as_chunks()
            .0
            .iter()
            .map(|unit| u16::from_be_bytes(*unit))
            .collect();
        assert_eq!(String::from_utf16(&units).unwrap(), "\u{feff}) >> é");
    }
}
