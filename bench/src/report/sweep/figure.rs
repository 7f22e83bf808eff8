//! Plots of a sweep: one per metric, with one panel per [`SweepPanel`].

use super::study::{CrossingRule, Sweep, SweepPanel};
use super::{Band, Motion};
use crate::io::counts::counted;
use crate::report::column::Column;
use sharp_plots::axis::PlotAxis;
use sharp_plots::canvas::Surface;
use sharp_plots::curves::{Banded, curve, shade, vertical};
use sharp_plots::ink::Ink;
use sharp_plots::palette::{Marker, Style, stroke};
use sharp_plots::panels::{self, Panel, PanelFrame, PlotArea};
use sharp_plots::scale::finite_range;
use sharp_plots::style::FigureStyle;
use sharp_plots::{Figure, PlotError};

const LIMIT: Ink = Ink::opaque(0x57, 0x60, 0x6A);
const MARK: f64 = 5.0;

/// One plot per metric that has scores.
///
/// # Errors
/// If the drawing library fails.
pub fn figures(sweep: &Sweep, style: &FigureStyle) -> Result<Vec<(Column, Figure)>, PlotError> {
    let mut figures = Vec::new();
    for (k, metric) in sweep.metrics.iter().enumerate() {
        if all(sweep, k).next().is_some() {
            figures.push((metric.clone(), figure(sweep, k, metric, style)?));
        }
    }
    Ok(figures)
}

fn all(sweep: &Sweep, metric: usize) -> impl Iterator<Item = &Banded> {
    let bins = sweep
        .lines_with(metric)
        .flat_map(move |line| &line.bins[metric]);
    bins.map(|bin| &bin.banded)
}

fn figure(
    sweep: &Sweep,
    k: usize,
    metric: &Column,
    style: &FigureStyle,
) -> Result<Figure, PlotError> {
    let limits = sweep.spec.thresholds.iter();
    let limits: Vec<f64> = limits
        .filter(|limit| limit.metric.to_string() == metric.key)
        .map(|limit| limit.value)
        .collect();
    let y = vertical(all(sweep, k), &limits, &metric.axis_label());
    let infinity = all(sweep, k).any(|banded| banded.bin.mean.is_infinite());
    let lines = sweep.lines_with(k);
    let legend = lines.map(|line| {
        (
            line.label.as_str(),
            style.of_method(&line.label, line.style),
        )
    });
    let legend: Vec<(&str, Style)> = legend.collect();
    let panels = sweep.panels.iter();
    let shown = panels.filter(|panel| !panel.counts(k).is_empty());
    let drawn = shown.map(|panel| {
        let limits = &limits;
        Panel {
            frame: PanelFrame {
                infinity,
                counts: panel.counts(k).into_values().collect(),
                ..PanelFrame::new(
                    &panel.split,
                    remark(panel),
                    horizontal(sweep.spec.x, panel, k),
                    y.clone(),
                )
            },
            content: Ok(Box::new(move |surface: &mut Surface, area: &PlotArea| {
                let lines = panel.lines.iter().map(|line| {
                    let banded = line.bins[k].iter().map(|bin| bin.banded.clone());
                    (
                        banded.collect::<Vec<_>>(),
                        style.of_method(&line.label, line.style),
                    )
                });
                let lines: Vec<(Vec<Banded>, Style)> = lines.collect();
                for (bins, style) in &lines {
                    shade(surface, bins, area, *style);
                }
                for limit in limits {
                    let dashed = Style {
                        ink: LIMIT,
                        marker: Marker::Disc,
                        dash: Some((4.0, 3.0)),
                    };
                    let height = area.y.place(*limit);
                    let ends = [(area.x.from, height), (area.x.to, height)];
                    stroke(surface, &ends, 1.0, dashed);
                }
                for (bins, style) in &lines {
                    curve(surface, bins, area, *style);
                }
                for crossing in &sweep.crossings {
                    let here = crossing.metric == k && crossing.split == panel.split;
                    let line = panel.lines.iter().find(|line| {
                        (&line.dataset, &line.method) == (&crossing.dataset, &crossing.method)
                    });
                    if let (true, Some(line)) = (here && crossing.found.x.is_finite(), line) {
                        let at = (area.x.place(crossing.found.x), area.y.from - MARK);
                        let ink = style.of_method(&line.label, line.style).ink;
                        Marker::Down.draw(surface, at, MARK, ink);
                    }
                }
            })),
        }
    });
    let drawn: Vec<Panel<'_>> = drawn.collect();
    let title = format!("{} against {}", metric.label, sweep.spec.x.label());
    panels::figure(
        &title,
        &caption(sweep, k, metric),
        &legend,
        &drawn,
        Some(style),
    )
}

fn remark(panel: &SweepPanel) -> String {
    match panel.unplaced + panel.outside {
        0 => counted(panel.pairs, "pair"),
        left_out => format!(
            "{} of {}",
            panel.pairs - left_out,
            counted(panel.pairs, "pair")
        ),
    }
}

fn horizontal(x: Motion, panel: &SweepPanel, metric: usize) -> PlotAxis {
    let bins = panel.counts(metric).into_values();
    let (low, high) = finite_range(bins.flat_map(|bin| [bin.low, bin.high])).unwrap_or_default();
    // Start the axis at zero if the data begin near it.
    let low = match x.start() {
        Some(start) if low >= start && low - start < 0.5 * (high - start) => start,
        _ => low,
    };
    PlotAxis::over(x.label(), low, high, 6)
}

fn caption(sweep: &Sweep, metric: usize, column: &Column) -> String {
    let spec = &sweep.spec;
    let band = match spec.band {
        Band::Sd => "shade: ± one sample standard deviation",
        Band::Ci95 => "shade: 95 % interval of the mean over scenes, point by point",
        Band::None => "no shade",
    };
    let mut sentences = vec![
        format!("{}: {}.", column.label, column.direction_words()),
        format!(
            "Mean of each bin at the mean position of its pairs, {}; {band}; hollow: a single \
             pair; nothing is drawn over empty bins.",
            spec.binning
        ),
        spec.x.definition().to_owned(),
        "n: number of pairs in a bin.".to_owned(),
    ];
    let rules: Vec<&CrossingRule> = sweep
        .crossings
        .iter()
        .filter(|c| c.metric == metric && c.found.x.is_finite())
        .map(|c| &c.rule)
        .collect();
    let behind = rules.iter().find_map(|rule| match rule {
        CrossingRule::Behind(name) => Some(format!("is behind {name}")),
        CrossingRule::Beyond(_) => None,
    });
    let beyond = rules
        .iter()
        .any(|rule| matches!(rule, CrossingRule::Beyond(_)));
    let beyond = beyond.then(|| "is beyond the dashed line".to_owned());
    let what: Vec<String> = behind.into_iter().chain(beyond).collect();
    if !what.is_empty() {
        let what = what.join(" or ");
        sentences.push(format!(
            "Triangles mark the motion from which a method {what}."
        ));
    }
    // Keep a number and its unit on one line.
    sentences.join(" ").replace(" %", "\u{a0}%")
}
