//! The baselines of the pairs: against a metric, in the form of the paper's motion-range figure, and their histogram.
//! One panel a dataset.

use crate::evaluate::record::Status;
use crate::io::counts::counted;
use crate::report::board::{Board, DatasetBoard};
use crate::report::error::ReportError;
use crate::report::input::Column;

use super::bins::{Bin, bins};
use super::canvas::{Figure, Ink, Point, Surface};
use super::palette::{Style, stroke, style};
use super::panels::{Panel, PanelFrame, PlotArea, PlotAxis, figure, point};
use super::scale::Step;

/// Bins of a dataset at most, against a metric and in the histogram.
const METRIC_BINS: usize = 10;
const HISTOGRAM_BINS: usize = 20;
const LABEL: &str = "camera baseline (m)";
const BAR: Ink = Ink::opaque(0x00, 0x72, 0xB2);

/// The known baselines of a dataset, ascending, and their bins.
struct Baselines {
    metres: Vec<f64>,
    step: Step,
    axis: PlotAxis,
}

impl Baselines {
    fn new(dataset: &DatasetBoard<'_>, bins: usize) -> Self {
        let metres = dataset.pairs.iter().map(|pair| pair.facts.baseline_m);
        let mut metres: Vec<f64> = metres.filter(|metres| metres.is_finite()).collect();
        metres.sort_by(f64::total_cmp);
        let farthest = metres.last().copied().unwrap_or(0.0);
        let step = Step::nice(farthest, bins);
        let end = step.at(step.index(farthest).saturating_add(1));
        let end = if end.is_finite() { end } else { 1.0 };
        Self {
            axis: PlotAxis::over(LABEL, 0.0, end, 6),
            metres,
            step,
        }
    }

    /// Of an even count the mean of the middle two.
    fn median(&self) -> Option<f64> {
        let n = self.metres.len();
        let low = self.metres.get(n.saturating_sub(1) / 2)?;
        Some((low + self.metres.get(n / 2)?) / 2.0)
    }
}

/// The histogram of baselines. `None` if no dataset has a pair.
///
/// # Errors
/// When the drawing library refuses.
pub fn histogram(board: &Board<'_>) -> Result<Option<Figure>, ReportError> {
    let panel = |dataset: &DatasetBoard<'_>| {
        let baselines = Baselines::new(dataset, HISTOGRAM_BINS);
        let samples: Vec<(f64, f64)> = baselines.metres.iter().map(|m| (*m, 1.0)).collect();
        let bars = bins(&samples, baselines.step);
        let most = bars.iter().map(|b| b.n).max().unwrap_or(1) as f64;
        let mut y = PlotAxis::over("pairs", 0.0, most * 1.06, 5);
        if y.step.at(1) < 1.0 {
            y.step = Step::nice(1.0, 1);
        }
        let median = baselines.median();
        let median = median.map_or_else(String::new, |m| format!(", median {m:.3} m"));
        let draw = Box::new(move |surface: &mut dyn Surface, area: &PlotArea| {
            for bar in &bars {
                let left = area.x.place(bar.low) + 0.75;
                let right = (area.x.place(bar.high) - 0.75).max(left + 0.5);
                let (foot, top) = (area.y.place(0.0), area.y.place(bar.n as f64));
                surface.polygon(
                    &[(left, top), (right, top), (right, foot), (left, foot)],
                    BAR,
                );
            }
        });
        Panel {
            frame: PanelFrame {
                title: dataset.dataset.title().to_owned(),
                remark: format!("{}{median}", counted(samples.len(), "pair")),
                x: baselines.axis,
                y,
                infinity: false,
            },
            content: if samples.is_empty() {
                Err("no samples")
            } else {
                Ok(draw)
            },
        }
    };
    let panels: Vec<Panel<'_>> = board.datasets.iter().map(panel).collect();
    if panels.iter().all(|panel| panel.content.is_err()) {
        return Ok(None);
    }
    let title = format!("Histogram of {LABEL}");
    let caption = "Bins include their left edge; each panel has its own scales.";
    figure(&title, caption, &[], &panels).map(Some)
}

/// A metric against the baseline: the mean of each bin as a line, the sample standard deviation as a shade, bins with
/// a single sample without one, bins without samples skipped. `None` if no method has a number of this metric.
///
/// # Errors
/// When the drawing library refuses.
pub fn against_metric(board: &Board<'_>, metric: &Column) -> Result<Option<Figure>, ReportError> {
    let methods = 0..board.methods.len();
    let datasets = board.datasets.iter().map(|dataset| {
        let baselines = Baselines::new(dataset, METRIC_BINS);
        let curves = methods.clone().map(|method| {
            let records = dataset.records_of(method);
            let scored = records.filter(|r| r.status == Status::Ok);
            let samples: Vec<(f64, f64)> = scored
                .filter_map(|r| Some((r.baseline_m, r.scores.get(&metric.key)?.value()?)))
                .collect();
            bins(&samples, baselines.step)
        });
        (curves.collect::<Vec<_>>(), baselines)
    });
    let datasets: Vec<(Vec<Vec<Bin>>, Baselines)> = datasets.collect();
    let drawn = |method: usize| {
        datasets
            .iter()
            .any(|(curves, _)| !curves[method].is_empty())
    };
    let shown: Vec<usize> = methods.filter(|method| drawn(*method)).collect();
    if shown.is_empty() {
        return Ok(None);
    }
    let all = || datasets.iter().flat_map(|(curves, _)| curves).flatten();
    let y = vertical(all(), metric);
    let infinity = all().any(|bin| bin.mean.is_infinite());
    let panels = datasets.iter().zip(&board.datasets);
    let panels = panels.map(|((curves, baselines), dataset)| Panel {
        frame: PanelFrame {
            title: dataset.dataset.title().to_owned(),
            remark: counted(baselines.metres.len(), "pair"),
            x: baselines.axis.clone(),
            y: y.clone(),
            infinity,
        },
        content: if curves.iter().all(Vec::is_empty) {
            Err("no samples")
        } else {
            Ok(Box::new(|surface, area| {
                for (method, bins) in curves.iter().enumerate() {
                    shade(surface, bins, area, style(method));
                }
                for (method, bins) in curves.iter().enumerate() {
                    curve(surface, bins, area, style(method));
                }
            }))
        },
    });
    let panels: Vec<Panel<'_>> = panels.collect();
    let legend = shown
        .iter()
        .map(|&m| (board.methods[m].label.as_str(), style(m)));
    let legend: Vec<(&str, Style)> = legend.collect();
    let caption = format!(
        "{}: {}. Mean of each bin; shade: ± one sample standard deviation; hollow: a single sample.",
        metric.label,
        metric.direction_words()
    );
    let title = format!("{} against {LABEL}", metric.label);
    figure(&title, &caption, &legend, &panels).map(Some)
}

/// One vertical axis for all panels, so that datasets can be compared.
fn vertical<'a>(bins: impl Iterator<Item = &'a Bin>, metric: &Column) -> PlotAxis {
    let mut range = (f64::INFINITY, f64::NEG_INFINITY);
    for bin in bins.filter(|bin| bin.mean.is_finite()) {
        let std = bin.std.unwrap_or(0.0);
        range = (range.0.min(bin.mean - std), range.1.max(bin.mean + std));
    }
    if range.0 > range.1 {
        range = (0.0, 1.0);
    }
    let room = (range.1 - range.0) * 0.06;
    PlotAxis::over(&metric.axis_label(), range.0 - room, range.1 + room, 6)
}

/// The shade over each run of neighbouring bins that have a deviation; a lone one becomes a bar.
fn shade(surface: &mut dyn Surface, bins: &[Bin], area: &PlotArea, style: Style) {
    for run in bins.split(|bin| bin.std.is_none()) {
        let half = if run.len() == 1 { 5.0 } else { 0.0 };
        let edge = |bin: &Bin, side: f64, sign: f64| -> Point {
            let value = bin.mean + sign * bin.std.unwrap_or(0.0);
            (
                area.x.place(bin.centre()) + side * half,
                area.y.place(value),
            )
        };
        let upper = run
            .iter()
            .flat_map(|b| [edge(b, -1.0, 1.0), edge(b, 1.0, 1.0)]);
        let lower = run.iter().rev();
        let lower = lower.flat_map(|b| [edge(b, 1.0, -1.0), edge(b, -1.0, -1.0)]);
        let mut outline: Vec<Point> = upper.chain(lower).collect();
        outline.dedup();
        if !outline.is_empty() {
            surface.polygon(&outline, style.ink.with_alpha(0.16));
        }
    }
}

/// The line through neighbouring finite means, and a marker a bin.
fn curve(surface: &mut dyn Surface, bins: &[Bin], area: &PlotArea, style: Style) {
    let at = |bin: &Bin| -> Point { (area.x.place(bin.centre()), area.height(bin.mean)) };
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
