//! A history as a single page that opens from disk, loads nothing and runs no script.

use askama::Template;

use super::{History, Point, Series};
use crate::evaluate::Occasion;
use crate::io::text::visible;
use crate::report::ReportError;
use crate::report::html::{STYLE, VERSION, themed};
use sharp_plots::axis::PlotAxis;
use sharp_plots::canvas::{Anchor, Lettering, Surface};
use sharp_plots::ink::{INK, MUTED, PAPER};
use sharp_plots::palette::{Marker, Style, stroke, style};
use sharp_plots::panels::{MARKER, Panel, PanelFrame, PlotArea, figure, point as marker};
use sharp_plots::text::{Weight, fitted};
use sharp_plots::{Figure, PlotError};
use sharp_statistics::Verdict;

/// Font size of the labels below the axis, CSS pixels.
const LABEL_SIZE: f64 = 11.5;
/// Maximum number of entries whose labels fit below the axis.
const MAX_LABELLED: f64 = 9.0;
/// Distance between the points of two methods at one entry, CSS pixels.
const POINT_DISTANCE: f64 = 7.0;

#[derive(Template)]
#[template(path = "history.html")]
struct HistoryPage<'a> {
    title: &'a str,
    history: &'a History,
    figures: &'a [Figure],
    /// Points with events, each with its series.
    events: &'a [(&'a Series, &'a Point)],
    changes: usize,
    /// Whether plots have several panels.
    wide: bool,
}

impl HistoryPage<'_> {
    fn plot(&self, figure: &Figure) -> String {
        themed(&figure.svg)
    }

    fn commit<'o>(&self, occasion: &'o Occasion) -> &'o str {
        occasion.commit.as_deref().unwrap_or("-")
    }
}

/// Renders the page with a title.
///
/// # Errors
/// If the drawing library or the template fails.
pub fn html(history: &History, title: &str) -> Result<String, ReportError> {
    let of_metric = |one: &Series, other: &Series| one.metric.key == other.metric.key;
    let figures = history.series.chunk_by(of_metric);
    let figures: Result<Vec<Figure>, PlotError> =
        figures.map(|series| plot(history, series)).collect();
    let events = history.series.iter().flat_map(|series| {
        let points = series.points.iter();
        points.map(move |point| (series, point))
    });
    let mut events: Vec<(&Series, &Point)> = events
        .filter(|(series, point)| !series.events(point).is_empty())
        .collect();
    events.sort_by_key(|(_, point)| point.entry);
    let changes = events.iter().filter(|(_, point)| point.change.is_some());
    let page = HistoryPage {
        title,
        history,
        figures: &figures?,
        events: &events,
        changes: changes.count(),
        wide: history
            .series
            .windows(2)
            .any(|s| s[0].dataset != s[1].dataset),
    };
    Ok(visible(&page.render()?).into_owned())
}

/// Plots the series of one metric, one panel per dataset.
fn plot(history: &History, series: &[Series]) -> Result<Figure, PlotError> {
    let methods = history.methods();
    let style_of = |series: &Series| {
        let at = methods.iter().position(|method| *method == series.method);
        style(at.unwrap_or(0))
    };
    let metric = &series[0].metric;
    let panels = series.chunk_by(|one, other| one.dataset == other.dataset);
    let panels = panels.map(|series| Panel {
        frame: PanelFrame {
            infinity: points(series).any(|point| point.mean.is_some_and(f64::is_infinite)),
            ..PanelFrame::new(
                &series[0].dataset,
                "",
                horizontal(history),
                vertical(series),
            )
        },
        content: if points(series).any(|point| point.mean.is_some_and(|mean| !mean.is_nan())) {
            Ok(Box::new(move |surface: &mut Surface, area: &PlotArea| {
                labels(surface, area, history);
                let middle = (series.len() - 1) as f64 / 2.0;
                for (at, series) in series.iter().enumerate() {
                    let shift = (at as f64 - middle) * POINT_DISTANCE;
                    draw(surface, area, series, shift, style_of(series));
                }
            }))
        } else {
            Err("no numbers")
        },
    });
    let panels: Vec<Panel<'_>> = panels.collect();
    let legend = series.iter().map(|s| (s.method.as_str(), style_of(s)));
    let legend: Vec<(&str, Style)> = legend.collect();
    let caption = format!(
        "{}: {}. Mean of each entry with its 95 % interval; lines join entries that can be \
         compared, and a hollow point cannot be compared with any before it. Triangles are change \
         points: filled for worse, hollow for better, pointing in the direction of the change.",
        metric.label,
        metric.direction_words()
    );
    figure(
        &format!("{} over entries", metric.label),
        &caption,
        &legend,
        &panels,
        None,
    )
}

fn points(series: &[Series]) -> impl Iterator<Item = &Point> {
    series.iter().flat_map(|series| &series.points)
}

/// Axis from half an entry before the first to half an entry after the last.
fn horizontal(history: &History) -> PlotAxis {
    let number = |entry: Option<&(u32, Occasion)>| entry.map_or(1.0, |(n, _)| f64::from(*n));
    let (first, last) = (
        number(history.entries.first()),
        number(history.entries.last()),
    );
    // Entry labels replace the axis label.
    let label = if last - first < MAX_LABELLED {
        ""
    } else {
        "entry"
    };
    PlotAxis::over(label, first - 0.5, last + 0.5, 12).counting()
}

fn vertical(series: &[Series]) -> PlotAxis {
    let values = points(series).flat_map(|point| [point.mean, point.ci_low, point.ci_high]);
    PlotAxis::around(&series[0].metric.axis_label(), values.flatten(), 0.1)
}

/// Draws the entries' labels below their numbers, if there is room.
fn labels(surface: &mut Surface, area: &PlotArea, history: &History) {
    let room = area.x.place(1.0) - area.x.place(0.0) - 6.0;
    if area.x.high - area.x.low > MAX_LABELLED {
        return;
    }
    let lettering = Lettering::new(LABEL_SIZE, MUTED, Anchor::Middle);
    for (number, occasion) in &history.entries {
        let text = fitted(&occasion.label, LABEL_SIZE, Weight::Regular, room * 0.85);
        let at = (area.x.place(f64::from(*number)), area.y.from + 33.0);
        surface.text(&text, at, lettering);
    }
}

fn draw(surface: &mut Surface, area: &PlotArea, series: &Series, shift: f64, style: Style) {
    let place = |point: &Point| {
        let mean = point.mean.filter(|mean| !mean.is_nan())?;
        let x = area.x.place(f64::from(point.entry)) + shift;
        Some((x, area.height(mean)))
    };
    for point in &series.points {
        let before = series
            .points
            .iter()
            .find(|p| Some(p.entry) == point.follows);
        if let (Some(from), Some(to)) = (before.and_then(place), place(point)) {
            stroke(surface, &[from, to], 2.0, style);
        }
    }
    for point in &series.points {
        let Some((x, y)) = place(point) else {
            continue;
        };
        if let (Some(low), Some(high)) = (point.ci_low, point.ci_high) {
            let (low, high) = (area.y.place(low), area.y.place(high));
            surface.line(&[(x, low), (x, high)], 1.4, style.ink);
            for end in [low, high] {
                surface.line(&[(x - 3.0, end), (x + 3.0, end)], 1.4, style.ink);
            }
        }
        let begins_anew = point.broken.is_some() && point.follows.is_none();
        marker(surface, (x, y), style, begins_anew);
        if let Some(change) = &point.change {
            let (sign, side) = if change.difference > 0.0 {
                (Marker::Up, -1.0)
            } else {
                (Marker::Down, 1.0)
            };
            let at = (x, y + side * 3.2 * MARKER);
            sign.draw(surface, at, MARKER * 1.2, INK);
            if change.verdict == Verdict::Better {
                sign.draw(surface, at, MARKER * 0.6, PAPER);
            }
        }
    }
}
