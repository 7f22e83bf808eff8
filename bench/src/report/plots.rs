//! Writes the figures of a report as files. Also makes plots with one panel per dataset: the histogram of the pairs'
//! baselines, a metric against the baseline as in the paper's motion-range figure, and a metric by scene.

use std::path::{Path, PathBuf};

use crate::evaluate::record::Status;
use crate::io::counts::counted;
use crate::io::text::visible;
use crate::pairs::valid_depth::median_of;
use crate::report::board::{Board, DatasetBoard};
use crate::report::column::Column;
use crate::report::statistics::{CellStatistics, Uncertainty, of_metric};
use sharp_plots::{Figure, PlotError};

use sharp_plots::axis::PlotAxis;
use sharp_plots::bins::{Binning, Cuts, bins};
use sharp_plots::canvas::{Anchor, Lettering, Surface};
use sharp_plots::curves::{Banded, curve, shade, vertical};
use sharp_plots::ink::{INK, Ink, MUTED};
use sharp_plots::palette::{Style, style};
use sharp_plots::panels::{Panel, PanelFrame, PlotArea, figure};
use sharp_plots::style::FigureStyle;
use sharp_plots::text::{Weight, width};

/// Marks a figure's files as written by this program, so that a later figure may overwrite them.
pub const MARK: &str = "sharp-bench";

/// Extensions of a figure's files.
pub const FORMS: [&str; 3] = ["svg", "png", "pdf"];

/// The files `STEM.svg`, `STEM.png` and `STEM.pdf` of a figure, each with its path, contents and [`MARK`].
pub fn files(figure: Figure, out: &Path, stem: &str) -> [(PathBuf, Vec<u8>, &'static str); 3] {
    let svg = format!("<!-- {MARK} -->\n{}", visible(&figure.svg)).into_bytes();
    let [svg_path, png_path, pdf_path] = FORMS.map(|form| out.join(format!("{stem}.{form}")));
    [
        (svg_path, svg, MARK),
        (png_path, figure.png, MARK),
        (pdf_path, figure.pdf, MARK),
    ]
}

/// Maximum number of bins per dataset in plots of a metric.
const METRIC_BINS: Binning = Binning::Round(10);
/// Maximum number of bins per dataset in histograms.
const HISTOGRAM_BINS: Binning = Binning::Round(20);
const LABEL: &str = "camera baseline (m)";
const BAR: Ink = Ink::opaque(0x00, 0x72, 0xB2);
/// Font size of the methods' names.
const NAME_SIZE: f64 = 11.5;
/// Lettering of the methods' names below columns of points.
const NAME: Lettering = Lettering::new(NAME_SIZE, MUTED, Anchor::Middle);

/// The baselines of a dataset's pairs, as far as known, in ascending order, and their bins.
struct Baselines {
    metres: Vec<f64>,
    cuts: Cuts,
    axis: PlotAxis,
}

impl Baselines {
    fn new(dataset: &DatasetBoard<'_>, binning: &Binning) -> Self {
        let metres = dataset.pairs.iter().map(|pair| pair.facts.baseline_m);
        let mut metres: Vec<f64> = metres.filter(|metres| metres.is_finite()).collect();
        metres.sort_by(f64::total_cmp);
        let cuts = binning.cuts(metres.iter().copied(), Some(0.0));
        // The upper edge of the last bin.
        let last: Vec<(f64, f64)> = metres.last().map(|m| (*m, 0.0)).into_iter().collect();
        let end = bins(&last, &cuts).first().map_or(1.0, |bin| bin.high);
        let end = if end.is_finite() { end } else { 1.0 };
        Self {
            axis: PlotAxis::over(LABEL, 0.0, end, 6),
            metres,
            cuts,
        }
    }
}

/// Plots the histogram of baselines, for print if a style is given. `None` if no dataset has a pair.
///
/// # Errors
/// If the drawing library fails.
pub fn histogram(
    board: &Board<'_>,
    print: Option<&FigureStyle>,
) -> Result<Option<Figure>, PlotError> {
    let panel = |dataset: &DatasetBoard<'_>| {
        let baselines = Baselines::new(dataset, &HISTOGRAM_BINS);
        let samples: Vec<(f64, f64)> = baselines.metres.iter().map(|m| (*m, 1.0)).collect();
        let found = bins(&samples, &baselines.cuts);
        let most = found.iter().map(|b| b.n()).max().unwrap_or(1) as f64;
        let y = PlotAxis::over("pairs", 0.0, most * 1.06, 5).counting();
        let median = median_of(baselines.metres);
        let median = median.map_or_else(String::new, |m| format!(", median {m:.3} m"));
        let bars = Box::new(move |surface: &mut Surface, area: &PlotArea| {
            for bar in &found {
                let left = area.x.place(bar.low) + 0.75;
                let right = (area.x.place(bar.high) - 0.75).max(left + 0.5);
                let (foot, top) = (area.y.place(0.0), area.y.place(bar.n() as f64));
                surface.polygon(
                    &[(left, top), (right, top), (right, foot), (left, foot)],
                    BAR,
                );
            }
        });
        Panel {
            frame: PanelFrame::new(
                dataset.dataset.title(),
                format!("{}{median}", counted(samples.len(), "pair")),
                baselines.axis,
                y,
            ),
            content: if samples.is_empty() {
                Err("no samples")
            } else {
                Ok(bars)
            },
        }
    };
    let panels: Vec<Panel<'_>> = board.datasets.iter().map(panel).collect();
    if panels.iter().all(|panel| panel.content.is_err()) {
        return Ok(None);
    }
    let title = format!("Histogram of {LABEL}");
    let caption = "Bins include their left edge; each panel has its own scales.";
    figure(&title, caption, &[], &panels, print).map(Some)
}

/// Plots a metric against the baseline: a line through the means of the bins, shaded by the sample standard deviation
/// where a bin has at least two samples. Line and shade are interrupted at empty bins. `None` if no method has a score
/// of this metric.
///
/// # Errors
/// If the drawing library fails.
pub fn against_metric(board: &Board<'_>, metric: &Column) -> Result<Option<Figure>, PlotError> {
    let methods = 0..board.methods.len();
    let datasets = board.datasets.iter().map(|dataset| {
        let baselines = Baselines::new(dataset, &METRIC_BINS);
        let curves = methods.clone().map(|method| {
            if !board.methods[method].is_plotted {
                return Vec::new();
            }
            let records = dataset.records_of(method);
            let scored = records.filter(|r| r.status == Status::Ok);
            let samples: Vec<(f64, f64)> = scored
                .filter_map(|r| Some((r.baseline_m, r.scores.get(&metric.key)?.value()?)))
                .collect();
            let found = bins(&samples, &baselines.cuts).into_iter();
            let banded = found.map(|bin| Banded::deviation(bin).from(metric.least()));
            banded.collect()
        });
        (curves.collect::<Vec<_>>(), baselines)
    });
    let datasets: Vec<(Vec<Vec<Banded>>, Baselines)> = datasets.collect();
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
    let y = vertical(all(), &[], &metric.axis_label());
    let infinity = all().any(|banded| banded.bin.mean.is_infinite());
    let panels = datasets.iter().zip(&board.datasets);
    let panels = panels.map(|((curves, baselines), dataset)| Panel {
        frame: PanelFrame {
            infinity,
            ..PanelFrame::new(
                dataset.dataset.title(),
                counted(baselines.metres.len(), "pair"),
                baselines.axis.clone(),
                y.clone(),
            )
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
    figure(&title, &caption, &legend, &panels, None).map(Some)
}

/// Plots a metric's means over scenes: per method, a column of points and a cross for the mean over all scenes with its
/// 95 % interval. `None` if no method has scores of two scenes of a dataset.
///
/// # Errors
/// If the drawing library fails.
pub fn by_scene(board: &Board<'_>, metric: &Column) -> Result<Option<Figure>, PlotError> {
    let methods: Vec<usize> = board.plotted().collect();
    let columns = board.datasets.iter().map(|dataset| {
        let column = |method: &usize| (of_metric(dataset, *method, &metric.key), *method);
        let columns = methods.iter().map(column);
        let columns = columns.filter(|(cell, _)| cell.spread.is_some());
        columns.collect::<Vec<(CellStatistics, usize)>>()
    });
    let columns: Vec<Vec<(CellStatistics, usize)>> = columns.collect();
    if columns.iter().all(Vec::is_empty) {
        return Ok(None);
    }
    let values = columns.iter().flatten().flat_map(|(cell, _)| &cell.scenes);
    let y = PlotAxis::around(&metric.axis_label(), values.copied(), 0.06);
    let panels = columns
        .iter()
        .zip(&board.datasets)
        .map(|(columns, dataset)| {
            let all = methods.iter().map(|m| of_metric(dataset, *m, &metric.key));
            let scenes = all.map(|cell| cell.scenes.len()).max();
            let x = PlotAxis {
                ticks: Vec::new(),
                ..PlotAxis::over("methods", -0.5, methods.len() as f64 - 0.5, 1)
            };
            let (methods, y) = (&methods, &y);
            let draw = move |surface: &mut Surface, area: &PlotArea| {
                let labels = || methods.iter().map(|m| board.methods[*m].label.as_str());
                let room = 0.8 * (area.x.place(1.0) - area.x.place(0.0));
                // If a name does not fit below its column, only the legend names the methods.
                if labels().all(|label| width(label, NAME_SIZE, Weight::Regular) < room) {
                    for (place, label) in labels().enumerate() {
                        let at = (area.x.place(place as f64), area.y.from + 17.0);
                        surface.text(label, at, NAME);
                    }
                }
                for (cell, method) in columns {
                    let place = methods.iter().position(|other| other == method);
                    let place = place.unwrap_or_default() as f64;
                    let style = style(*method);
                    for (i, value) in cell.scenes.iter().enumerate() {
                        // Multiples of the golden ratio spread the points sideways, so that neighbours do not hide each
                        // other.
                        let aside = (0.618 * i as f64).fract() - 0.5;
                        let at = (area.x.place(place + 0.5 * aside), area.y.place(*value));
                        surface.disc(at, 2.2, style.ink);
                    }
                    let (Some(mean), Some(spread)) = (cell.mean, cell.spread) else {
                        continue;
                    };
                    let reach = spread.of(Uncertainty::Ci95);
                    // Clamp to the axis. Intervals over few scenes are so long that an axis with room for them would
                    // flatten the points.
                    let ends = [mean - reach, mean + reach].map(|end| end.clamp(y.low, y.high));
                    let line = |from: (f64, f64), to: (f64, f64)| {
                        [from, to].map(|(x, value)| (area.x.place(x), area.y.place(value)))
                    };
                    surface.line(&line((place - 0.35, mean), (place + 0.35, mean)), 2.0, INK);
                    surface.line(&line((place, ends[0]), (place, ends[1])), 1.5, INK);
                }
            };
            Panel {
                frame: PanelFrame::new(
                    dataset.dataset.title(),
                    counted(scenes.unwrap_or_default(), "scene"),
                    x,
                    y.clone(),
                ),
                content: if columns.is_empty() {
                    Err("fewer than two scenes")
                } else {
                    Ok(Box::new(draw))
                },
            }
        });
    let panels: Vec<Panel<'_>> = panels.collect();
    let shown = |method: &&usize| columns.iter().flatten().any(|(_, drawn)| drawn == *method);
    let shown = methods.iter().filter(shown);
    let legend = shown.map(|&m| (board.methods[m].label.as_str(), style(m)));
    let legend: Vec<(&str, Style)> = legend.collect();
    let caption = format!(
        "{}: {}. A point is the mean of a scene; the cross is the mean over the dataset with its 95 % interval, \
         cut off at the ends of the axis.",
        metric.label,
        metric.direction_words()
    );
    let title = format!("{} by scene", metric.label);
    figure(&title, &caption, &legend, &panels, None).map(Some)
}
