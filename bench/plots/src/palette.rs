//! Colours and markers of methods: the palette of Okabe and Ito, which stays distinct under the common forms of colour
//! blindness, without its black (used for text) and its yellow (too pale on white).

use super::canvas::{Point, Surface};
use super::ink::{INK, Ink};

pub const COLOURS: [Ink; 6] = [
    Ink::opaque(0x00, 0x72, 0xB2),
    Ink::opaque(0xD5, 0x5E, 0x00),
    Ink::opaque(0x00, 0x9E, 0x73),
    Ink::opaque(0xCC, 0x79, 0xA7),
    Ink::opaque(0xE6, 0x9F, 0x00),
    Ink::opaque(0x56, 0xB4, 0xE9),
];

/// Colour and marker of a method in every plot of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Style {
    /// Colour of line and marker.
    pub ink: Ink,
    /// Marker shape; varies between methods, so that colour is never the only cue.
    pub marker: Marker,
    /// On and off lengths of a dashed line in CSS pixels; `None` is solid.
    pub dash: Option<(f64, f64)>,
}

/// Shape of a data point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Marker {
    Disc,
    Square,
    Diamond,
    Up,
    Down,
}

const MARKERS: [Marker; 5] = [
    Marker::Disc,
    Marker::Square,
    Marker::Diamond,
    Marker::Up,
    Marker::Down,
];
const DASHES: [Option<(f64, f64)>; 3] = [None, Some((7.0, 4.0)), Some((2.5, 3.0))];

/// The style of method number `index` of a run. Colour, marker and dash cycle at different rates: the first ninety
/// methods are distinct, the first thirty by colour and marker alone.
pub fn style(index: usize) -> Style {
    style_of(&COLOURS, index)
}

/// Like [`style`], but with the user's colours; uses the text colour if `colours` is empty.
pub fn style_of(colours: &[Ink], index: usize) -> Style {
    let turns = colours.len().max(1);
    Style {
        ink: colours.get(index % turns).copied().unwrap_or(INK),
        marker: MARKERS[index % MARKERS.len()],
        dash: DASHES[index / turns % DASHES.len()],
    }
}

impl Marker {
    /// Draws a filled marker.
    pub fn draw(self, surface: &mut Surface, centre: Point, radius: f64, ink: Ink) {
        let (x, y) = centre;
        let corners: &[Point] = match self {
            Self::Disc => return surface.disc(centre, radius, ink),
            Self::Square => &[(-0.89, -0.89), (0.89, -0.89), (0.89, 0.89), (-0.89, 0.89)],
            Self::Diamond => &[(0.0, -1.25), (1.25, 0.0), (0.0, 1.25), (-1.25, 0.0)],
            Self::Up => &[(0.0, -1.2), (1.16, 0.85), (-1.16, 0.85)],
            Self::Down => &[(0.0, 1.2), (1.16, -0.85), (-1.16, -0.85)],
        };
        let points: Vec<Point> = corners
            .iter()
            .map(|(dx, dy)| (x + dx * radius, y + dy * radius))
            .collect();
        surface.polygon(&points, ink);
    }
}

/// Draws a line, dashed if the style is dashed.
pub fn stroke(surface: &mut Surface, points: &[Point], width: f64, style: Style) {
    let Some((on, off)) = style.dash else {
        return surface.line(points, width, style.ink);
    };
    let (mut drawing, mut left) = (true, on);
    for ends in points.windows(2) {
        let ((x0, y0), (x1, y1)) = (ends[0], ends[1]);
        let length = (x1 - x0).hypot(y1 - y0);
        if !length.is_finite() || length > 1e5 {
            continue;
        }
        let mut at = 0.0;
        while at < length {
            let whole = at + left;
            let end = whole.min(length);
            if drawing && end > at {
                let point = |t: f64| (x0 + (x1 - x0) * t / length, y0 + (y1 - y0) * t / length);
                surface.line(&[point(at), point(end)], width, style.ink);
            }
            // Compares positions rather than the remaining length, because adding a tiny remainder
            // to `at` may leave `at` unchanged, and the loop would never end.
            if whole > length {
                left = whole - length;
            } else {
                drawing = !drawing;
                left = if drawing { on } else { off };
            }
            at = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canvas::Shape;

    fn length(points: &[Point]) -> f64 {
        let steps = points.windows(2);
        steps
            .map(|p| (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1))
            .sum()
    }

    /// Dashes follow one pattern along a whole line, of any length and direction, and drawing
    /// terminates.
    #[test]
    fn dashes_end_and_cover_their_share() {
        let dashed = (0..90).map(style).filter(|style| style.dash.is_some());
        for style in dashed.take(24) {
            let (on, off) = style.dash.unwrap();
            for i in 0..500 {
                let step = |k: i32| {
                    (
                        7.3 * f64::from(k) + 0.37 * f64::from(i),
                        (0.1 * f64::from(i * k)).sin() * 31.7,
                    )
                };
                let points: Vec<Point> = (0..4).map(step).collect();
                let all = length(&points);
                let mut surface = Surface::default();
                stroke(&mut surface, &points, 1.0, style);
                let pieces = surface.0.iter().map(|shape| match shape {
                    Shape::Line(points, ..) => length(points),
                    other => panic!("{other:?}"),
                });
                let pieces: Vec<f64> = pieces.collect();
                let drawn: f64 = pieces.iter().sum();
                // Whole periods plus the remainder of the last one.
                let periods = (all / (on + off)).floor();
                let expected = periods * on + (all - periods * (on + off)).min(on);
                assert!((drawn - expected).abs() < 1e-6, "{i}: {drawn} {expected}");
                assert!(pieces.len() as f64 <= periods + 4.0, "{i}: {pieces:?}");
            }
        }
    }

    #[test]
    fn ninety_methods_differ_in_colour_or_marker_or_line() {
        for i in 0..90 {
            for j in 0..i {
                assert_ne!(style(i), style(j), "{i} and {j}");
            }
        }
    }
}
