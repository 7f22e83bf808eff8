//! Text in the bundled font: widths, line breaking, glyphs as coverage or outlines, and drawing on pictures.

use std::sync::OnceLock;

use ab_glyph::{Font, FontRef, OutlineCurve, ScaleFont, point};
use image::RgbImage;

use super::ink::Ink;

/// `font-family` of SVG text: the bundled font, then common system fonts.
pub const FAMILY: &str = "Inter, 'Helvetica Neue', Helvetica, Arial, sans-serif";

/// Height of a capital letter relative to the font size.
pub const CAP_HEIGHT: f64 = 0.727;

static REGULAR: &[u8] = include_bytes!("../assets/Inter-Regular.otf");
static SEMIBOLD: &[u8] = include_bytes!("../assets/Inter-SemiBold.otf");

/// Font weight: regular, or semibold for titles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    Regular,
    Bold,
}

fn font(weight: Weight) -> Option<&'static FontRef<'static>> {
    static FONTS: OnceLock<[Option<FontRef<'static>>; 2]> = OnceLock::new();
    let [regular, bold] =
        FONTS.get_or_init(|| [REGULAR, SEMIBOLD].map(|bytes| FontRef::try_from_slice(bytes).ok()));
    match weight {
        Weight::Regular => regular,
        Weight::Bold => bold,
    }
    .as_ref()
}

/// Width of `text` in pixels at a font size (em) in pixels.
pub fn width(text: &str, size: f64, weight: Weight) -> f64 {
    let mut end = 0.0;
    lay_out(text, size, weight, |_, _, advance_end| end = advance_end);
    end
}

/// Calls `paint(x, y, coverage)` for the pixels of `text`, whose baseline starts at the origin; y points down,
/// `coverage` is in 0..1.
pub fn raster(text: &str, size: f64, weight: Weight, mut paint: impl FnMut(i32, i32, f32)) {
    lay_out(text, size, weight, |font, mut glyph, _| {
        glyph.position.y = 0.0;
        if let Some(outline) = font.outline_glyph(glyph) {
            let bounds = outline.px_bounds();
            let (x0, y0) = (bounds.min.x as i32, bounds.min.y as i32);
            outline.draw(|x, y, coverage| {
                paint(x0 + x as i32, y0 + y as i32, coverage.clamp(0.0, 1.0));
            });
        }
    });
}

/// A piece of a glyph's outline; y points down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stroke {
    /// Closes the current contour and starts the next.
    Move((f64, f64)),
    Line((f64, f64)),
    /// A cubic curve: two control points and the end point.
    Curve((f64, f64), (f64, f64), (f64, f64)),
}

/// Calls `draw` for the outlines of `text`, whose baseline starts at the origin.
pub fn outlines(text: &str, size: f64, weight: Weight, mut draw: impl FnMut(Stroke)) {
    lay_out(text, size, weight, |font, glyph, _| {
        let Some(outline) = font.outline(glyph.id) else {
            return;
        };
        let unit = size / f64::from(font.units_per_em().unwrap_or(1000.0));
        let left = f64::from(glyph.position.x);
        let at = |p: ab_glyph::Point| (left + f64::from(p.x) * unit, -f64::from(p.y) * unit);
        let mut last = None;
        for curve in outline.curves {
            let (first, end, stroke) = match curve {
                OutlineCurve::Line(a, b) => (a, b, Stroke::Line(at(b))),
                OutlineCurve::Cubic(a, b, c, d) => (a, d, Stroke::Curve(at(b), at(c), at(d))),
                OutlineCurve::Quad(a, b, c) => {
                    // The equivalent cubic has its control points two thirds of the way to the quadratic's.
                    let towards = |from: ab_glyph::Point| {
                        let ((x, y), (u, v)) = (at(from), at(b));
                        (x + (u - x) * 2.0 / 3.0, y + (v - y) * 2.0 / 3.0)
                    };
                    (a, c, Stroke::Curve(towards(a), towards(c), at(c)))
                }
            };
            if last != Some(first) {
                draw(Stroke::Move(at(first)));
            }
            draw(stroke);
            last = Some(end);
        }
    });
}

/// Draws a line of text whose baseline starts at `at`. Anything outside the picture is clipped.
pub fn write(
    picture: &mut RgbImage,
    text: &str,
    at: (u32, u32),
    size: f64,
    weight: Weight,
    ink: Ink,
) {
    raster(text, size, weight, |x, y, coverage| {
        let place = (
            u32::try_from(i64::from(at.0) + i64::from(x)),
            u32::try_from(i64::from(at.1) + i64::from(y)),
        );
        let (Ok(x), Ok(y)) = place else { return };
        let Some(pixel) = picture.get_pixel_mut_checked(x, y) else {
            return;
        };
        for (below, above) in pixel.0.iter_mut().zip(<[u8; 3]>::from(ink.rgb)) {
            let mixed = f32::from(*below) * (1.0 - coverage) + f32::from(above) * coverage;
            *below = mixed.round() as u8;
        }
    });
}

/// The text, shortened with an ellipsis if it is wider than `room`.
pub fn fitted(text: &str, size: f64, weight: Weight, room: f64) -> String {
    if width(text, size, weight) <= room {
        return text.to_owned();
    }
    let mut short: String = text.to_owned();
    while short.pop().is_some() {
        let candidate = format!("{}…", short.trim_end());
        if width(&candidate, size, weight) <= room {
            return candidate;
        }
    }
    String::new()
}

/// Wraps a text into lines no wider than `room`. Words, and words joined by no-break spaces, are
/// broken only if they do not fit on a line of their own. If not even one character fits on a line,
/// words stay whole.
pub fn wrapped(text: &str, size: f64, weight: Weight, room: f64) -> Vec<String> {
    let fits = |text: &str| width(text, size, weight) <= room;
    let one_fits = |word: &str| word.chars().any(|c| fits(c.encode_utf8(&mut [0; 4])));
    let mut lines: Vec<String> = Vec::new();
    let breaks = |c: char| c.is_whitespace() && c != '\u{a0}';
    for word in text.split(breaks).filter(|word| !word.is_empty()) {
        let parts = !fits(word) && one_fits(word);
        let joint = |c: char| parts && c == '\u{a0}';
        for part in word.split(joint).filter(|part| !part.is_empty()) {
            match lines.last_mut() {
                Some(line) if fits(&format!("{line} {part}")) => {
                    line.push(' ');
                    line.push_str(part);
                }
                _ => lines.push(part.to_owned()),
            }
            while let Some(line) = lines.last_mut().filter(|line| parts && !fits(line)) {
                let mut ends = line.char_indices().map(|(at, _)| at).skip(1);
                let Some(first) = ends.next() else { break };
                let end = ends.take_while(|at| fits(&line[..*at])).last();
                let rest = line.split_off(end.unwrap_or(first));
                lines.push(rest);
            }
        }
    }
    lines
}

/// Wraps a text into at most `most` lines. A longer text gets an ellipsis in its middle, because labels differ at their
/// ends.
pub fn wrapped_to(most: usize, text: &str, size: f64, weight: Weight, room: f64) -> Vec<String> {
    let lines = wrapped(text, size, weight, room);
    if lines.len() <= most {
        return lines;
    }
    let chars: Vec<char> = text.chars().collect();
    let keeping = |kept: usize| {
        let (head, tail) = (kept.div_ceil(2), chars.len() - kept / 2);
        let parts = chars.iter().take(head).chain(&['…']);
        let short: String = parts.chain(chars.iter().skip(tail)).collect();
        wrapped(&short, size, weight, room)
    };
    let (mut fits, mut too_long) = (0, chars.len());
    while fits + 1 < too_long {
        let middle = usize::midpoint(fits, too_long);
        if keeping(middle).len() <= most {
            fits = middle
        } else {
            too_long = middle
        }
    }
    keeping(fits)
}

/// Visits each glyph with its position and the pen's position after it.
fn lay_out(
    text: &str,
    size: f64,
    weight: Weight,
    mut visit: impl FnMut(&FontRef<'static>, ab_glyph::Glyph, f64),
) {
    let Some(font) = font(weight) else { return };
    // ab_glyph scales by ascent + descent, CSS by the em.
    let per_em = f64::from(font.height_unscaled() / font.units_per_em().unwrap_or(1000.0));
    let scaled = font.as_scaled((size * per_em) as f32);
    let mut pen = 0.0_f32;
    let mut last = None;
    for c in text.chars() {
        let id = font.glyph_id(c);
        if let Some(last) = last {
            pen += scaled.kern(last, id);
        }
        let mut glyph = id.with_scale(scaled.scale());
        glyph.position = point(pen, 0.0);
        pen += scaled.h_advance(id);
        last = Some(id);
        visit(font, glyph, f64::from(pen));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ink::INK;
    use image::Rgb;

    #[test]
    fn the_bundled_fonts_have_every_sign_that_plots_use() {
        for weight in [Weight::Regular, Weight::Bold] {
            let font = font(weight).unwrap();
            for c in "azAZ09.,:;()[]/%@=+-−–±×÷→↑↓∞≥≤·σ…".chars() {
                assert_ne!(font.glyph_id(c).0, 0, "{c}");
            }
        }
    }

    #[test]
    fn widths_scale_with_size_and_length() {
        let w = |t: &str, s| width(t, s, Weight::Regular);
        assert_eq!(w("", 10.0), 0.0);
        assert!((w("baseline", 20.0) - 2.0 * w("baseline", 10.0)).abs() < 0.01);
        assert!(w("baseline (m)", 10.0) > w("baseline", 10.0));
        // Inter's digit zero is 0.62 to 0.63 em wide.
        assert!((w("0", 100.0) - 62.0).abs() < 3.0, "{}", w("0", 100.0));
    }

    #[test]
    fn long_names_are_shortened_to_fit() {
        let bold = |text: &str, room| fitted(text, 14.0, Weight::Bold, room);
        assert_eq!(bold("eth3d", 200.0), "eth3d");
        let long = bold(&"tanks".repeat(50), 200.0);
        assert!(long.ends_with('…') && width(&long, 14.0, Weight::Bold) <= 200.0);
        assert_eq!(bold("eth3d", 1.0), "");
    }

    #[test]
    fn lines_break_between_words() {
        let whole = width("one two", 10.0, Weight::Regular);
        let lines = |room| wrapped("one two  three", 10.0, Weight::Regular, room);
        assert_eq!(lines(whole), ["one two", "three"]);
        assert_eq!(lines(1.0), ["one", "two", "three"]);
        assert_eq!(lines(1e4), ["one two three"]);
        let kept = wrapped("one\u{a0}two three", 10.0, Weight::Regular, 1.0);
        assert_eq!(kept, ["one\u{a0}two", "three"]);
    }

    #[test]
    fn words_wider_than_a_line_part_where_they_must() {
        let lines = |text, room| wrapped(text, 10.0, Weight::Regular, room);
        let room = width("number", 10.0, Weight::Regular);
        assert_eq!(lines("a\u{a0}number b", room), ["a", "number", "b"]);
        assert_eq!(
            lines("x numbernumberb", room),
            ["x", "number", "number", "b"]
        );
        // An M does not fit, but still gets a line of its own.
        let narrow = width("i", 10.0, Weight::Regular);
        assert_eq!(lines("iMMi", narrow), ["i", "M", "M", "i"]);
        let long = "no_space_at_all/".repeat(20);
        let parts = lines(&long, 40.0);
        assert_eq!(parts.concat(), long);
        assert!(
            parts
                .iter()
                .all(|line| width(line, 10.0, Weight::Regular) <= 40.0)
        );

        let first = |text: &str, most| wrapped_to(most, text, 10.0, Weight::Regular, 40.0);
        let two = first(&long, 2);
        assert_eq!(two.len(), 2, "{two:?}");
        assert!(
            two[0].starts_with("no_") && two.concat().contains('…') && two[1].ends_with("all/")
        );
        assert!(
            two.iter()
                .all(|line| width(line, 10.0, Weight::Regular) <= 40.0)
        );
        // The texts differ at one end only.
        assert_ne!(first(&format!("{long}1"), 2), first(&format!("{long}2"), 2));
        assert_ne!(first(&format!("1{long}"), 2), first(&format!("2{long}"), 2));
        assert_eq!(first("short", 2), ["short"]);
    }

    #[test]
    fn text_darkens_paper_and_may_run_out_of_it() {
        let mut paper = RgbImage::from_pixel(20, 20, Rgb([255; 3]));
        write(&mut paper, "MMMM", (5, 18), 16.0, Weight::Bold, INK);
        assert!(paper.pixels().any(|p| p.0[0] < 100));
        assert_eq!(paper.get_pixel(0, 0), &Rgb([255; 3]));
    }
}
