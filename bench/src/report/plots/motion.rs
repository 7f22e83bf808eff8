//! Motion against a metric, in the form of the paper's motion-range figure: the mean of each bin as a line, the
//! sample standard deviation as a shade, bins with a single sample without one, bins without samples skipped.

use crate::evaluate::record::{Record, Status};
use crate::report::error::ReportError;
use crate::report::input::Metric;
use crate::report::records::{Board, DatasetBoard};

use super::bins::{Bin, bins};
use super::canvas::{Figure, Point, Surface};
use super::palette::{Style, stroke, style};
use super::panels::{Axis, Frame, Grid, Place, point};
use super::scale::Step;

/// What the camera moved by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Distance of the camera centres in metres, as in the paper.
    Metres,
    /// That distance in units of the target's median depth, which says how much the picture changes.
    MedianDepths,
}

impl Motion {
    /// Of one record; `None` where it is not known.
    pub fn of(self, record: &Record) -> Option<f64> {
        let motion = match self {
            Self::Metres => record.baseline_m,
            Self::MedianDepths => record.baseline_m / record.median_depth_m?,
        };
        motion.is_finite().then_some(motion)
    }

    /// Of an axis.
    pub fn label(self) -> &'static str {
        match self {
            Self::Metres => "camera baseline (m)",
            Self::MedianDepths => "camera baseline / median depth",
        }
    }
}

/// Bins of a dataset are at most this many unless a width is given.
const BINS: usize = 10;

/// One panel a dataset. `None` if no method has a number of this metric.
///
/// # Errors
/// When the drawing library refuses.
pub fn figure(
    board: &Board<'_>,
    metric: &Metric,
    motion: Motion,
    bin_width: Option<Step>,
) -> Result<Option<Figure>, ReportError> {
    let panels: Vec<Panel> = board
        .datasets
        .iter()
        .map(|dataset| Panel::new(dataset, board.methods.len(), metric, motion, bin_width))
        .collect();
    let entries: Vec<(usize, &str, Style)> = board
        .methods
        .iter()
        .enumerate()
        .filter(|(i, _)| panels.iter().any(|p| !p.curves[*i].is_empty()))
        .map(|(i, method)| (i, method.label.as_str(), style(i)))
        .collect();
    if entries.is_empty() {
        return Ok(None);
    }
    let y = vertical(&panels, metric);
    let infinity = panels.iter().any(|p| p.all().any(|b| b.mean.is_infinite()));
    let labels: Vec<&str> = entries.iter().map(|e| e.1).collect();
    let caption = format!(
        "{}: {}. Mean of each bin; shade: ± one sample standard deviation; hollow: a single sample.",
        metric.label,
        metric.better.words()
    );
    let grid = Grid::new(panels.len(), &labels, &caption);
    let title = format!("{} against {}", metric.label, motion.label());
    let draw = |surface: &mut dyn Surface| {
        let legend: Vec<(&str, Style)> = entries.iter().map(|e| (e.1, e.2)).collect();
        grid.surround(surface, &legend);
        for (i, panel) in panels.iter().enumerate() {
            let frame = Frame {
                title: panel.title.clone(),
                remark: panel.remark.clone(),
                x: Axis::over(motion.label(), 0.0, panel.end, 6),
                y: y.clone(),
                infinity,
            };
            let place = grid.panel(surface, i, &frame);
            if panel.all().next().is_none() {
                place.remark(surface, "no samples");
            }
            for (method, _, style) in &entries {
                shade(surface, &panel.curves[*method], &place, *style);
            }
            for (method, _, style) in &entries {
                curve(surface, &panel.curves[*method], &place, *style);
            }
        }
    };
    Figure::draw(&title, grid.size(), draw).map(Some)
}

/// The bins of each method on one dataset.
struct Panel {
    title: String,
    remark: String,
    /// By method.
    curves: Vec<Vec<Bin>>,
    /// Right end of the axis.
    end: f64,
}

impl Panel {
    fn new(
        dataset: &DatasetBoard<'_>,
        methods: usize,
        metric: &Metric,
        motion: Motion,
        bin_width: Option<Step>,
    ) -> Self {
        let pairs: Vec<f64> = dataset
            .pairs
            .iter()
            .filter_map(|p| motion.of(p.facts))
            .collect();
        let farthest = pairs.iter().copied().fold(0.0, f64::max);
        let step = bin_width.unwrap_or_else(|| Step::nice(farthest, BINS));
        let curves: Vec<Vec<Bin>> = (0..methods)
            .map(|method| {
                let samples: Vec<(f64, f64)> = dataset
                    .pairs
                    .iter()
                    .filter_map(|pair| pair.by_method[method])
                    .filter(|record| record.status == Status::Ok)
                    .filter_map(|record| {
                        Some((motion.of(record)?, record.scores.get(&metric.key)?.value()?))
                    })
                    .collect();
                bins(&samples, step)
            })
            .collect();
        let end = step.at(step.index(farthest).saturating_add(1));
        Self {
            title: dataset.dataset.name.clone(),
            remark: match pairs.len() {
                1 => "1 pair".into(),
                n => format!("{n} pairs"),
            },
            curves,
            end: if end.is_finite() { end } else { 1.0 },
        }
    }

    fn all(&self) -> impl Iterator<Item = &Bin> {
        self.curves.iter().flatten()
    }
}

/// One vertical axis for all panels, so that datasets can be compared.
fn vertical(panels: &[Panel], metric: &Metric) -> Axis {
    let mut range = (f64::INFINITY, f64::NEG_INFINITY);
    for bin in panels.iter().flat_map(Panel::all) {
        if bin.mean.is_finite() {
            let std = bin.std.unwrap_or(0.0);
            range = (range.0.min(bin.mean - std), range.1.max(bin.mean + std));
        }
    }
    if range.0 > range.1 {
        range = (0.0, 1.0);
    }
    let room = (range.1 - range.0) * 0.06;
    Axis::over(&metric.axis_label(), range.0 - room, range.1 + room, 6)
}

/// The shade over each run of neighbouring bins that have a deviation; a lone one becomes a bar.
fn shade(surface: &mut dyn Surface, bins: &[Bin], place: &Place, style: Style) {
    let ink = style.ink.with_alpha(0.16);
    for run in bins.split(|bin| bin.std.is_none()) {
        let edge = |bin: &Bin, sign: f64| -> Point {
            let value = bin.mean + sign * bin.std.unwrap_or(0.0);
            (place.x.place(bin.centre()), place.y.place(value))
        };
        match run {
            [] => {}
            [bin] => {
                let ((x, high), (_, low)) = (edge(bin, 1.0), edge(bin, -1.0));
                let half = 5.0;
                let corners = [
                    (x - half, high),
                    (x + half, high),
                    (x + half, low),
                    (x - half, low),
                ];
                surface.polygon(&corners, ink);
            }
            _ => {
                let upper = run.iter().map(|bin| edge(bin, 1.0));
                let lower = run.iter().rev().map(|bin| edge(bin, -1.0));
                let outline: Vec<Point> = upper.chain(lower).collect();
                surface.polygon(&outline, ink);
            }
        }
    }
}

/// The line through neighbouring finite means, and a marker a bin.
fn curve(surface: &mut dyn Surface, bins: &[Bin], place: &Place, style: Style) {
    let at = |bin: &Bin| -> Point {
        let y = if bin.mean.is_infinite() {
            place.infinity
        } else {
            place.y.place(bin.mean)
        };
        (place.x.place(bin.centre()), y)
    };
    for run in bins.split(|bin| bin.mean.is_infinite()) {
        let points: Vec<Point> = run.iter().map(at).collect();
        if points.len() > 1 {
            stroke(surface, &points, 2.0, style);
        }
    }
    for bin in bins {
        point(surface, at(bin), style, bin.n == 1);
    }
}
