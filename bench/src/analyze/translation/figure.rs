//! Plots each metric against the shift. For comparison, a line marks the score of the mean image.

use crate::report::column::Column;
use sharp_plots::axis::PlotAxis;
use sharp_plots::canvas::{Point, Surface};
use sharp_plots::palette::{Marker, Style, stroke, style};
use sharp_plots::panels::{Panel, PanelFrame, PlotArea, figure as draw, point};
use sharp_plots::{Figure, PlotError};

use sharp_plots::scale::finite_range;

use super::experiment::Experiment;

/// Plots the scores, one panel per metric; a panel without values shows a note instead. `None` if
/// no metric has a value.
///
/// # Errors
/// If the drawing library fails.
pub fn figure(experiment: &Experiment) -> Result<Option<Figure>, PlotError> {
    let label = "translation (% of the width)";
    let moved_style = style(0);
    let mean_style = Style {
        ink: style(1).ink,
        marker: Marker::Square,
        dash: Some((7.0, 4.0)),
    };
    let shifts = experiment.comparisons.iter().filter_map(|c| c.shift);
    let farthest = shifts.map(|(percent, _)| percent).fold(0.0, f64::max);
    let panels = experiment.keys().into_iter().map(|key| {
        let comparisons = experiment.comparisons.iter();
        let moved = comparisons.filter_map(|c| Some((c.shift?.0, c.score(key)?)));
        let moved: Vec<Point> = moved.collect();
        let mean = experiment.comparisons.iter().find(|c| c.shift.is_none());
        let mean = mean.and_then(|c| c.score(key));
        let values: Vec<f64> = moved.iter().map(|(_, value)| *value).chain(mean).collect();
        let column = Column::from(key);
        Panel {
            frame: PanelFrame {
                infinity: values.iter().any(|v| v.is_infinite()),
                ..PanelFrame::new(
                    &column.label,
                    column.direction_words(),
                    PlotAxis::over(label, 0.0, farthest * 1.04, 6),
                    vertical(&column, &values),
                )
            },
            content: if values.is_empty() {
                Err("unavailable")
            } else {
                Ok(Box::new(move |surface: &mut Surface, area: &PlotArea| {
                    if let Some(value) = mean {
                        let y = area.height(value);
                        let line = [(area.x.from, y), (area.x.to, y)];
                        stroke(surface, &line, 2.0, mean_style);
                    }
                    let points = moved.iter();
                    let points = points.map(|(x, v)| (area.x.place(*x), area.height(*v)));
                    let points: Vec<Point> = points.collect();
                    if points.len() > 1 {
                        stroke(surface, &points, 2.0, moved_style);
                    }
                    for at in points {
                        point(surface, at, moved_style, false);
                    }
                }))
            },
        }
    });
    let panels: Vec<Panel<'_>> = panels.collect();
    if panels.iter().all(|panel| panel.content.is_err()) {
        return Ok(None);
    }
    let legend = [("translated", moved_style), ("mean image", mean_style)];
    let caption = "Compared with the untranslated picture; each panel has its own scale.";
    draw(
        "Metrics against small translations",
        caption,
        &legend,
        &panels,
        None,
    )
    .map(Some)
}

fn vertical(column: &Column, values: &[f64]) -> PlotAxis {
    // Distances start at zero (no difference).
    let zero = column.unit.is_empty().then_some(0.0);
    let range = finite_range(values.iter().copied());
    let all = range.and_then(|(low, high)| finite_range([low, high].into_iter().chain(zero)));
    let (low, high) = all.unwrap_or((0.0, 1.0));
    let room = (high - low) * 0.08;
    let below = if low == 0.0 { 0.0 } else { room };
    PlotAxis::over(&column.axis_label(), low - below, high + room, 6)
}
