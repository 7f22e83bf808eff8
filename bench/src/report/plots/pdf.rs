//! A drawing as one page of PDF, without a clock or a random number in it.
//!
//! Written here rather than converted from the SVG: a converter would bring a second font renderer and some forty crates.
//! Glyphs are filled outlines, which every publisher takes, where a font would have to be embedded.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::{self, Write as _};

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::canvas::{Anchor, Ink, Lettering, Point, Surface};
use super::text::{self, Stroke};

/// A page in the making.
pub(super) struct Pdf {
    /// Operators of the page.
    content: String,
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
        Self {
            // Units, y down; joins are round.
            content: format!("{points:.6} 0 0 {:.6} 0 {:.3} cm 1 j\n", -points, size.1),
            alphas: BTreeSet::new(),
            size,
        }
    }

    fn ink(&mut self, ink: Ink, operator: &str) {
        let alpha = (ink.alpha.clamp(0.0, 1.0) * 1000.0).round() as u32;
        self.alphas.insert(alpha);
        let (r, g, b) = ink.rgb;
        let level = |v: u8| f64::from(v) / 255.0;
        let _ = writeln!(
            self.content,
            "/A{alpha} gs {:.4} {:.4} {:.4} {operator}",
            level(r),
            level(g),
            level(b)
        );
    }

    /// Coordinates and an operator; what is not finite or far outside stays far outside.
    fn op(&mut self, points: &[Point], operator: &str) {
        let number = |v: f64| if v.is_nan() { 0.0 } else { v.clamp(-1e5, 1e5) };
        for (x, y) in points {
            let _ = write!(self.content, "{:.2} {:.2} ", number(*x), number(*y));
        }
        self.content.push_str(operator);
        self.content.push('\n');
    }

    fn path(&mut self, points: &[Point]) {
        for (i, point) in points.iter().enumerate() {
            self.op(&[*point], if i == 0 { "m" } else { "l" });
        }
    }

    /// The whole file.
    pub(super) fn finish(self, title: &str) -> io::Result<Vec<u8>> {
        let states = self.alphas.iter().map(|alpha| {
            let share = f64::from(*alpha) / 1000.0;
            format!("/A{alpha} << /ca {share} /CA {share} >>")
        });
        let states: Vec<String> = states.collect();
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::best());
        packed.write_all(self.content.as_bytes())?;
        let packed = packed.finish()?;
        // UTF-16 after its mark: any title, and nothing in it that could end the string.
        let title: String = title
            .encode_utf16()
            .map(|unit| format!("{unit:04X}"))
            .collect();
        let objects = [
            "<< /Type /Catalog /Pages 2 0 R >>".to_owned(),
            "<< /Type /Pages /Kids [3 0 R] /BinCount 1 >>".to_owned(),
            format!(
                "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {:.3} {:.3}] /Contents 5 0 R /Resources << /ExtGState << {} >> >> >>",
                self.size.0,
                self.size.1,
                states.join(" ")
            ),
            format!("<< /Title <FEFF{title}> /Producer (sharp-bench) >>"),
            format!(
                "<< /Length {} /Filter /FlateDecode >>\nstream\n",
                packed.len()
            ),
        ];
        let mut file = b"%PDF-1.4\n%\xE2\xE3\xCF\xD3\n".to_vec();
        let mut places = Vec::new();
        for (i, object) in objects.iter().enumerate() {
            places.push(file.len());
            write!(file, "{} 0 obj\n{object}", i + 1)?;
            if i + 1 == objects.len() {
                file.extend(&packed);
                file.extend(b"\nendstream");
            }
            file.extend(b"\nendobj\n");
        }
        let table = file.len();
        let count = places.len() + 1;
        write!(file, "xref\n0 {count}\n0000000000 65535 f \n")?;
        for place in places {
            writeln!(file, "{place:010} 00000 n ")?;
        }
        write!(
            file,
            "trailer\n<< /Size {count} /Root 1 0 R /Info 4 0 R >>\nstartxref\n{table}\n%%EOF\n"
        )?;
        Ok(file)
    }
}

impl Surface for Pdf {
    fn line(&mut self, points: &[Point], width: f64, ink: Ink) {
        self.ink(ink, "RG");
        let _ = writeln!(self.content, "{width:.2} w");
        self.path(points);
        self.content.push_str("S\n");
    }

    fn polygon(&mut self, points: &[Point], ink: Ink) {
        self.ink(ink, "rg");
        self.path(points);
        self.content.push_str("f\n");
    }

    fn disc(&mut self, (x, y): Point, r: f64, ink: Ink) {
        self.ink(ink, "rg");
        let k = r * ARC;
        self.op(&[(x + r, y)], "m");
        self.op(&[(x + r, y + k), (x + k, y + r), (x, y + r)], "c");
        self.op(&[(x - k, y + r), (x - r, y + k), (x - r, y)], "c");
        self.op(&[(x - r, y - k), (x - k, y - r), (x, y - r)], "c");
        self.op(&[(x + k, y - r), (x + r, y - k), (x + r, y)], "c");
        self.content.push_str("f\n");
    }

    fn text(&mut self, text: &str, (x, y): Point, lettering: Lettering) {
        let Lettering {
            size,
            weight,
            ink,
            anchor,
            upwards,
        } = lettering;
        self.ink(ink, "rg");
        let shift = match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -text::width(text, size, weight) / 2.0,
            Anchor::End => -text::width(text, size, weight),
        };
        let place = |(dx, dy): Point| match upwards {
            true => (x + dy, y - dx - shift),
            false => (x + dx + shift, y + dy),
        };
        let before = self.content.len();
        text::outlines(text, size, weight, |stroke| match stroke {
            Stroke::Move(to) => self.op(&[place(to)], "m"),
            Stroke::Line(to) => self.op(&[place(to)], "l"),
            Stroke::Curve(a, b, to) => self.op(&[place(a), place(b), place(to)], "c"),
        });
        if self.content.len() > before {
            self.content.push_str("f\n");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::plots::canvas::INK;

    #[test]
    fn objects_lie_where_the_table_says_and_titles_stay_strings() {
        let mut pdf = Pdf::new((100.0, 50.0), 0.75);
        pdf.line(&[(0.0, 0.0), (f64::INFINITY, f64::NAN)], 1.0, INK);
        pdf.disc((5.0, 5.0), 2.0, INK.with_alpha(0.16));
        assert!(pdf.content.contains("100000.00 0.00 l"));
        let file = pdf.finish(") >> é").unwrap();
        let text = String::from_utf8_lossy(&file);
        assert!(text.contains("/MediaBox [0 0 75.000 37.500]"));
        assert!(text.contains("/A160 << /ca 0.16 /CA 0.16 >>"));
        assert!(text.contains("<FEFF00290020003E003E002000E9>"));
        let table = text.rsplit("startxref\n").next().unwrap();
        let table: usize = table.lines().next().unwrap().parse().unwrap();
        let rows = std::str::from_utf8(&file[table..]).unwrap().lines().skip(3);
        for (number, row) in (1..).zip(rows.take(5)) {
            let at: usize = row[..10].parse().unwrap();
            assert!(file[at..].starts_with(format!("{number} 0 obj").as_bytes()));
        }
    }
}
