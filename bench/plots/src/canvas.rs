//! A drawing: pictures, lines, polygons, discs and texts, before it is written in any format.

use image::RgbImage;

use super::ink::Ink;
use super::text::{self, Weight};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// Style of text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lettering {
    /// Font size, in units.
    pub size: f64,
    pub weight: Weight,
    pub ink: Ink,
    /// Horizontal anchor; the vertical anchor is the baseline.
    pub anchor: Anchor,
    /// Whether the text runs bottom to top.
    pub upwards: bool,
}

impl Lettering {
    /// Horizontal text of regular weight.
    pub const fn new(size: f64, ink: Ink, anchor: Anchor) -> Self {
        Self {
            size,
            weight: Weight::Regular,
            ink,
            anchor,
            upwards: false,
        }
    }

    /// Offset of a text's start from its anchor, in units.
    pub(super) fn shift(&self, text: &str) -> f64 {
        let width = || text::width(text, self.size, self.weight);
        match self.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -width() / 2.0,
            Anchor::End => -width(),
        }
    }
}

/// A point in units (CSS pixels at [`Medium::SCREEN`](crate::style::Medium::SCREEN)); y points down.
pub type Point = (f64, f64);

#[derive(Debug, Clone)]
pub(super) enum Shape {
    Line(Vec<Point>, f64, Ink),
    Polygon(Vec<Point>, Ink),
    Disc(Point, f64, Ink),
    Text(String, Point, Lettering),
    /// The picture, its upper left corner, and its width and height.
    Picture(RgbImage, Point, Point),
}

/// A drawing under construction.
#[derive(Debug, Default)]
pub struct Surface(pub(super) Vec<Shape>);

impl Surface {
    /// Adds an open line.
    pub fn line(&mut self, points: &[Point], width: f64, ink: Ink) {
        self.0.push(Shape::Line(points.to_vec(), width, ink));
    }

    /// Adds a filled polygon.
    pub fn polygon(&mut self, points: &[Point], ink: Ink) {
        self.0.push(Shape::Polygon(points.to_vec(), ink));
    }

    /// Adds a filled circle.
    pub fn disc(&mut self, centre: Point, radius: f64, ink: Ink) {
        self.0.push(Shape::Disc(centre, radius, ink));
    }

    /// Adapts the colours to a page of the colour `page`.
    pub(super) fn lay_on(&mut self, page: Ink) {
        for shape in &mut self.0 {
            match shape {
                Shape::Line(.., ink) | Shape::Polygon(_, ink) | Shape::Disc(.., ink) => {
                    *ink = ink.on(page);
                }
                Shape::Text(.., lettering) => lettering.ink = lettering.ink.on(page),
                Shape::Picture(..) => {}
            }
        }
    }

    pub(super) fn extend(&mut self, other: Self) {
        self.0.extend(other.0);
    }

    /// Clips lines and polygons to a rectangle, and drops discs and texts whose position is outside it.
    pub(super) fn clip(&mut self, low: Point, high: Point) {
        let is_inside =
            |(x, y): Point| (low.0..=high.0).contains(&x) && (low.1..=high.1).contains(&y);
        let shapes = std::mem::take(&mut self.0).into_iter();
        for shape in shapes {
            match shape {
                Shape::Line(points, width, ink) => {
                    let parts = points.windows(2);
                    let parts = parts.filter_map(|ends| clipped([ends[0], ends[1]], low, high));
                    self.0
                        .extend(parts.map(|ends| Shape::Line(ends.to_vec(), width, ink)));
                }
                Shape::Polygon(points, ink) => {
                    let points = clipped_polygon(points, low, high);
                    self.0
                        .extend((points.len() > 2).then_some(Shape::Polygon(points, ink)));
                }
                Shape::Disc(at, ..) | Shape::Text(_, at, _) | Shape::Picture(_, at, _) => {
                    self.0.extend(is_inside(at).then_some(shape));
                }
            }
        }
    }

    /// Adds a picture with its upper left corner at `at`, stretched to `size` units. SVG and PDF
    /// embed the picture at its own resolution; in SVG, pictures lie below everything else.
    pub fn picture(&mut self, picture: RgbImage, at: Point, size: Point) {
        self.0.push(Shape::Picture(picture, at, size));
    }

    /// Adds a line of text.
    pub fn text(&mut self, text: &str, at: Point, lettering: Lettering) {
        self.0.push(Shape::Text(text.to_owned(), at, lettering));
    }
}

/// The part of a segment inside a rectangle (Liang and Barsky, "A new concept and method for line clipping", ACM
/// Transactions on Graphics 3, 1984).
fn clipped([a, b]: [Point; 2], low: Point, high: Point) -> Option<[Point; 2]> {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for (step, room) in [
        (-dx, a.0 - low.0),
        (dx, high.0 - a.0),
        (-dy, a.1 - low.1),
        (dy, high.1 - a.1),
    ] {
        if step == 0.0 && room < 0.0 {
            return None;
        } else if step < 0.0 {
            from = from.max(room / step);
        } else if step > 0.0 {
            to = to.min(room / step);
        }
    }
    let at = |t: f64| (a.0 + t * dx, a.1 + t * dy);
    (from <= to).then(|| [at(from), at(to)])
}

/// The part of a polygon inside a rectangle (Sutherland and Hodgman, "Reentrant polygon clipping", Communications of the
/// ACM 17, 1974).
fn clipped_polygon(mut points: Vec<Point>, low: Point, high: Point) -> Vec<Point> {
    // Distance of a point from each side, positive inside.
    let sides: [&dyn Fn(Point) -> f64; 4] = [
        &|p| p.0 - low.0,
        &|p| high.0 - p.0,
        &|p| p.1 - low.1,
        &|p| high.1 - p.1,
    ];
    for depth in sides {
        let mut kept = Vec::new();
        for (i, &b) in points.iter().enumerate() {
            let a = points[(i + points.len() - 1) % points.len()];
            let (of_a, of_b) = (depth(a), depth(b));
            if (of_a < 0.0) != (of_b < 0.0) {
                let t = of_a / (of_a - of_b);
                kept.push((a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1)));
            }
            if of_b >= 0.0 {
                kept.push(b);
            }
        }
        points = kept;
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ink::INK;

    #[test]
    fn shapes_end_at_the_rectangle() {
        let mut surface = Surface::default();
        surface.line(&[(-10.0, 5.0), (5.0, 5.0), (5.0, 30.0)], 1.0, INK);
        surface.line(&[(20.0, 0.0), (20.0, 9.0)], 1.0, INK);
        surface.polygon(&[(-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0)], INK);
        surface.disc((11.0, 1.0), 3.0, INK);
        surface.disc((9.0, 1.0), 3.0, INK);
        surface.clip((0.0, 0.0), (10.0, 10.0));
        let [
            Shape::Line(first, ..),
            Shape::Line(second, ..),
            Shape::Polygon(square, _),
            Shape::Disc(disc, ..),
        ] = &surface.0[..]
        else {
            panic!("{:?}", surface.0);
        };
        assert_eq!(first, &[(0.0, 5.0), (5.0, 5.0)]);
        assert_eq!(second, &[(5.0, 5.0), (5.0, 10.0)]);
        assert_eq!(*disc, (9.0, 1.0));
        let area: f64 = (0..square.len())
            .map(|i| {
                let (a, b) = (square[i], square[(i + 1) % square.len()]);
                0.5 * (a.0 * b.1 - b.0 * a.1)
            })
            .sum();
        assert!((area.abs() - 25.0).abs() < 1e-9, "{square:?}");
    }
}
