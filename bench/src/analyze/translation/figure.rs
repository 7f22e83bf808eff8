//! Each metric against the shift, with the mean image as the line that no small shift should reach.

use crate::report::error::ReportError;
use crate::report::input::Metric;
use crate::report::plots::canvas::{Figure, Point, Surface};
use crate::report::plots::palette::{Marker, Style, stroke, style};
use crate::report::plots::panels::{Axis, Frame, Grid, Place, point};

use super::experiment::Experiment;
use super::shift;

/// One panel a metric; a metric without values says so in its panel. `None` without any value.
///
/// # Errors
/// When the drawing library refuses.
pub fn figure(experiment: &Experiment) -> Result<Option<Figure>, ReportError> {
    let panels: Vec<Panel> = experiment
        .keys()
        .into_iter()
        .map(|key| Panel::new(experiment, key))
        .collect();
    if panels.iter().all(|panel| panel.values().next().is_none()) {
        return Ok(None);
    }
    let moved = style(0);
    let mean = Style {
        ink: style(1).ink,
        marker: Marker::Square,
        dash: Some((7.0, 4.0)),
    };
    let legend = [("translated", moved), ("mean image", mean)];
    let side = match experiment.axis {
        shift::Axis::X => "width",
        shift::Axis::Y => "height",
    };
    let label = format!("translation (% of the {side})");
    let caption = "Against the untranslated picture; each panel has its own scale.";
    let grid = Grid::new(panels.len(), &legend.map(|(label, _)| label), caption);
    let farthest = panels
        .iter()
        .flat_map(|p| &p.moved)
        .map(|(x, _)| *x)
        .fold(0.0, f64::max);
    let draw = |surface: &mut dyn Surface| {
        grid.surround(surface, &legend);
        for (i, panel) in panels.iter().enumerate() {
            let frame = Frame {
                title: panel.metric.label.clone(),
                remark: panel.metric.better.words().to_owned(),
                x: Axis::over(&label, 0.0, farthest * 1.04, 6),
                y: panel.vertical(),
                infinity: panel.values().any(f64::is_infinite),
            };
            let place = grid.panel(surface, i, &frame);
            panel.draw(surface, &place, moved, mean);
        }
    };
    Figure::draw("Metrics against small translations", grid.size(), draw).map(Some)
}

/// A metric's values.
struct Panel {
    metric: Metric,
    /// Shift in per cent, value.
    moved: Vec<Point>,
    mean: Option<f64>,
}

impl Panel {
    fn new(experiment: &Experiment, key: sharp_metrics::MetricKey) -> Self {
        let comparisons = experiment.comparisons.iter();
        let moved = comparisons
            .clone()
            .filter_map(|c| Some((c.shift?.0, c.score(key)?)));
        let mean = comparisons.clone().find(|c| c.shift.is_none());
        Self {
            metric: key.into(),
            moved: moved.collect(),
            mean: mean.and_then(|c| c.score(key)),
        }
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        self.moved.iter().map(|(_, value)| *value).chain(self.mean)
    }

    fn vertical(&self) -> Axis {
        let finite = || self.values().filter(|v| v.is_finite());
        let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        });
        // Distances start at zero, where nothing differs.
        let low = if self.metric.unit.is_empty() {
            low.min(0.0)
        } else {
            low
        };
        let (low, high) = if low > high { (0.0, 1.0) } else { (low, high) };
        let room = (high - low) * 0.08;
        let below = if low == 0.0 { 0.0 } else { room };
        Axis::over(&self.metric.axis_label(), low - below, high + room, 6)
    }

    fn draw(&self, surface: &mut dyn Surface, place: &Place, moved: Style, mean: Style) {
        if self.values().next().is_none() {
            return place.remark(surface, "unavailable");
        }
        let height = |value: f64| {
            if value.is_infinite() {
                place.infinity
            } else {
                place.y.place(value)
            }
        };
        if let Some(value) = self.mean {
            let y = height(value);
            stroke(surface, &[(place.x.from, y), (place.x.to, y)], 2.0, mean);
        }
        let points: Vec<Point> = self
            .moved
            .iter()
            .map(|(shift, value)| (place.x.place(*shift), height(*value)))
            .collect();
        if points.len() > 1 {
            stroke(surface, &points, 2.0, moved);
        }
        for at in points {
            point(surface, at, moved, false);
        }
    }
}
