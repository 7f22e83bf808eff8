//! A drawing: lines, polygons, discs and texts, before it is written in any format.

use super::ink::Ink;
use super::text::{self, Weight};

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
    /// Horizontal anchor; the vertical anchor is the baseline.
    pub anchor: Anchor,
    /// Whether the text runs bottom to top.
    pub upwards: bool,
}

impl Lettering {
    /// Offset of a text's start from its anchor, units.
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

    /// Adds a line of text.
    pub fn text(&mut self, text: &str, at: Point, lettering: Lettering) {
        self.0.push(Shape::Text(text.to_owned(), at, lettering));
    }
}
