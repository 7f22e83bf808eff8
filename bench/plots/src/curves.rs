//! Bin means as lines, with a shaded band for their spread. Lines and bands do not span empty bins.

use super::axis::PlotAxis;
use super::bins::{Bin, neighbours};
use super::canvas::{Point, Surface};
use super::palette::{Style, stroke};
use super::panels::{PlotArea, point};

/// A bin with the optional range (low, high) of its band.
#[derive(Debug, Clone, PartialEq)]
pub struct Banded {
    pub bin: Bin,
    pub band: Option<(f64, f64)>,
}

impl Banded {
    /// A band of one standard deviation on either side of the mean.
    pub fn deviation(bin: Bin) -> Self {
        let band = bin.std.map(|std| (bin.mean - std, bin.mean + std));
        Self { bin, band }
    }

    /// Clamps the band to the metric's smallest possible value `least`, if the metric has one.
    #[must_use]
    pub fn from(mut self, least: Option<f64>) -> Self {
        if let (Some((low, _)), Some(least)) = (&mut self.band, least) {
            *low = low.max(least);
        }
        self
    }
}

/// A vertical axis that fits all finite means, bands and `others`.
pub fn vertical<'a>(
    bins: impl Iterator<Item = &'a Banded>,
    others: &[f64],
    label: &str,
) -> PlotAxis {
    let ends = bins.flat_map(|Banded { bin, band }| {
        let (low, high) = band.unwrap_or((bin.mean, bin.mean));
        [low, high, bin.mean]
    });
    let values = ends.chain(others.iter().copied());
    PlotAxis::around(label, values, 0.06)
}

/// Shades the band over each run of adjacent bins; a lone bin becomes a bar.
pub fn shade(surface: &mut Surface, bins: &[Banded], area: &PlotArea, style: Style) {
    let runs = neighbours(bins, |banded| &banded.bin);
    for run in runs.flat_map(|run| run.split(|banded| banded.band.is_none())) {
        let half = if run.len() == 1 { 5.0 } else { 0.0 };
        let edge = |banded: &Banded, side: f64, upper: bool| -> Point {
            let (low, high) = banded.band.unwrap_or_default();
            let value = if upper { high } else { low };
            (
                area.x.place(banded.bin.x) + side * half,
                area.y.place(value),
            )
        };
        let upper = run
            .iter()
            .flat_map(|b| [edge(b, -1.0, true), edge(b, 1.0, true)]);
        let lower = run.iter().rev();
        let lower = lower.flat_map(|b| [edge(b, 1.0, false), edge(b, -1.0, false)]);
        let mut outline: Vec<Point> = upper.chain(lower).collect();
        outline.dedup();
        if !outline.is_empty() {
            surface.polygon(&outline, style.ink.with_alpha(0.16));
        }
    }
}

/// Draws a line through the finite means of adjacent bins, and one marker per bin, hollow for a single sample.
pub fn curve(surface: &mut Surface, bins: &[Banded], area: &PlotArea, style: Style) {
    let at = |banded: &Banded| -> Point {
        let bin = &banded.bin;
        (area.x.place(bin.x), area.height(bin.mean))
    };
    let runs = neighbours(bins, |banded| &banded.bin);
    for run in runs.flat_map(|run| run.split(|banded| banded.bin.mean.is_infinite())) {
        let points: Vec<Point> = run.iter().map(at).collect();
        if points.len() > 1 {
            stroke(surface, &points, 2.0, style);
        }
    }
    for banded in bins {
        point(surface, at(banded), style, banded.bin.n() == 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::{Binning, bins};
    use crate::canvas::Shape;
    use crate::palette::style;
    use crate::scale::{Scale, finite_range};

    /// Horizontal range of each line or polygon.
    fn ends(surface: &Surface) -> Vec<(f64, f64)> {
        let shapes = surface.0.iter().filter_map(|shape| match shape {
            Shape::Line(points, ..) | Shape::Polygon(points, _) => Some(points),
            _ => None,
        });
        let ends = shapes.map(|points| finite_range(points.iter().map(|p| p.0)).unwrap());
        ends.collect()
    }

    #[test]
    fn neither_line_nor_shade_bridges_an_empty_bin_an_infinite_one_or_a_single_sample() {
        let mut samples = Vec::new();
        for bin in [0.0, 1.0, 3.0, 4.0, 5.0, 6.0] {
            samples.extend([(bin, 1.0), (bin, 3.0)]);
        }
        // A single sample has no deviation: the line passes through it, but the shade does not.
        samples.push((7.0, 2.0));
        samples.extend([(8.0, 1.0), (8.0, f64::INFINITY), (9.0, 1.0), (9.0, 3.0)]);
        let cuts = "1".parse::<Binning>().unwrap().cuts([], None);
        let found = bins(&samples, &cuts).into_iter().map(Banded::deviation);
        let found: Vec<Banded> = found.collect();
        let same = |low, high, from, to| Scale {
            low,
            high,
            from,
            to,
        };
        let area = PlotArea {
            x: same(0.0, 10.0, 0.0, 10.0),
            y: same(0.0, 10.0, 0.0, 10.0),
            infinity: 11.0,
        };
        let mut lines = Surface::default();
        curve(&mut lines, &found, &area, style(0));
        lines.0.retain(|shape| matches!(shape, Shape::Line(..)));
        assert_eq!(ends(&lines), [(0.0, 1.0), (3.0, 7.0)]);
        let mut shades = Surface::default();
        shade(&mut shades, &found, &area, style(0));
        assert_eq!(ends(&shades), [(0.0, 1.0), (3.0, 6.0), (4.0, 14.0)]);
    }

    #[test]
    fn bands_end_at_the_least_value_of_the_metric() {
        let bin = bins(
            &[(0.5, 0.1), (0.5, 0.9)],
            &"1".parse::<Binning>().unwrap().cuts([], None),
        )
        .remove(0);
        let below = Banded {
            band: Some((-0.2, 1.2)),
            ..Banded::deviation(bin)
        };
        assert_eq!(below.clone().from(Some(0.0)).band, Some((0.0, 1.2)));
        assert_eq!(below.from(None).band, Some((-0.2, 1.2)));
    }
}
