//! A drawing as one page of PDF, without a clock or a random number in it.
//!
//! Drawn here rather than converted from the SVG: a converter would bring a second font renderer and some forty crates.
//! Glyphs are filled outlines, which every publisher takes, where a font would have to be embedded.

use std::collections::BTreeSet;
use std::io::{self, Write as _};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::types::LineJoinStyle;
use pdf_writer::{Content, Filter, Finish as _, Name, Rect, Ref, TextStr};

use super::canvas::{Anchor, Ink, Lettering, Point, Surface};
use super::text::{self, Stroke};

/// A page in the making.
pub(super) struct Pdf {
    /// Operators of the page.
    content: Content,
    /// Opacities in thousandths.
    alphas: BTreeSet<u32>,
    /// Width and height, points of 1/72 inch.
    size: (f64, f64),
}

/// Control points of a quarter of a circle lie so far along its tangents, in radii.
const ARC: f64 = 0.552_284_75;

impl Pdf {
    /// A page of so many units, each of so many points.
    pub(super) fn new((width, height): (f64, f64), points: f64) -> Self {
        let size = (width * points, height * points);
        let scale = points as f32;
        let mut content = Content::new();
        // Units, y down.
        content.transform([scale, 0.0, 0.0, -scale, 0.0, size.1 as f32]);
        content.set_line_join(LineJoinStyle::RoundJoin);
        Self {
            content,
            alphas: BTreeSet::new(),
            size,
        }
    }

    /// Sets the opacity; the colour as red, green and blue.
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

    /// The whole file.
    pub(super) fn finish(self, title: &str) -> io::Result<Vec<u8>> {
        let [catalog, pages, page, info, drawing] = [1, 2, 3, 4, 5].map(Ref::new);
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::best());
        packed.write_all(&self.content.finish())?;
        let packed = packed.finish()?;
        let mut file = pdf_writer::Pdf::new();
        file.catalog(catalog).pages(pages);
        file.pages(pages).kids([page]).count(1);
        let mut sheet = file.page(page);
        let (width, height) = (self.size.0 as f32, self.size.1 as f32);
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
        resources.finish();
        sheet.finish();
        file.document_info(info)
            .title(TextStr(title))
            .producer(TextStr("sharp-bench"));
        file.stream(drawing, &packed).filter(Filter::FlateDecode);
        Ok(file.finish())
    }
}

/// The name of an opacity among the page's resources.
fn state(alpha: u32) -> String {
    format!("A{alpha}")
}

/// Coordinates rounded to a hundredth; values that are not finite or far outside stay far outside.
fn placed((x, y): Point) -> (f32, f32) {
    let number = |v: f64| {
        let v = if v.is_nan() { 0.0 } else { v.clamp(-1e5, 1e5) };
        ((v * 100.0).round() / 100.0) as f32
    };
    (number(x), number(y))
}

impl Surface for Pdf {
    fn line(&mut self, points: &[Point], width: f64, ink: Ink) {
        let [r, g, b] = self.ink(ink);
        self.content.set_stroke_rgb(r, g, b);
        self.content.set_line_width(placed((width, 0.0)).0);
        self.path(points);
        self.content.stroke();
    }

    fn polygon(&mut self, points: &[Point], ink: Ink) {
        self.fill(ink);
        self.path(points);
        self.content.fill_nonzero();
    }

    fn disc(&mut self, (x, y): Point, r: f64, ink: Ink) {
        self.fill(ink);
        let k = r * ARC;
        self.move_to((x + r, y));
        self.curve_to([(x + r, y + k), (x + k, y + r), (x, y + r)]);
        self.curve_to([(x - k, y + r), (x - r, y + k), (x - r, y)]);
        self.curve_to([(x - r, y - k), (x - k, y - r), (x, y - r)]);
        self.curve_to([(x + k, y - r), (x + r, y - k), (x + r, y)]);
        self.content.fill_nonzero();
    }

    fn text(&mut self, text: &str, (x, y): Point, lettering: Lettering) {
        let Lettering {
            size,
            weight,
            ink,
            anchor,
            upwards,
        } = lettering;
        self.fill(ink);
        let shift = match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -text::width(text, size, weight) / 2.0,
            Anchor::End => -text::width(text, size, weight),
        };
        let place = |(dx, dy): Point| match upwards {
            true => (x + dy, y - dx - shift),
            false => (x + dx + shift, y + dy),
        };
        let mut is_drawn = false;
        text::outlines(text, size, weight, |stroke| {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::plots::canvas::INK;

    #[test]
    fn another_library_finds_one_page_with_its_drawing_and_title() {
        use hayro_syntax::object::{Dict, Number};

        let mut pdf = Pdf::new((100.0, 50.0), 0.75);
        pdf.line(&[(0.0, 0.0), (f64::INFINITY, f64::NAN)], 1.0, INK);
        pdf.disc((5.0, 5.0), 2.0, INK.with_alpha(0.16));
        let file = hayro_syntax::Pdf::new(pdf.finish(") >> é").unwrap()).unwrap();
        // MuPDF goes by the count, others by the list.
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
