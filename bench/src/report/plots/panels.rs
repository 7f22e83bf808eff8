//! A grid of panels, one a dataset, with axes and a legend shared by all.

use crate::report::error::ReportError;

use super::canvas::{Anchor, Figure, GRID, INK, Ink, Lettering, MUTED, PAPER, Point, Surface};
use super::palette::{Style, stroke};
use super::scale::{Scale, Step};
use super::text::{CAP_HEIGHT, Weight, fitted, width, wrapped};

const LEFT: f64 = 62.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 52.0;
const MARGIN: f64 = 10.0;
const LEGEND_ROW: f64 = 22.0;
const CAPTION_ROW: f64 = 17.0;
const TICK_SIZE: f64 = 11.5;
const LABEL_SIZE: f64 = 12.5;
const TITLE_SIZE: f64 = 14.0;

/// Share of its room that a line of an SVG may fill in the bundled font: systems without it show wider ones.
const ROOM: f64 = 0.8;
/// Radius of a data point.
pub const MARKER: f64 = 4.2;
/// Height of the strip above the axis where infinite values stand.
const INFINITY_STRIP: f64 = 22.0;

/// An axis: its range and its ticks.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotAxis {
    /// With the unit.
    pub label: String,
    pub low: f64,
    pub high: f64,
    /// Distance of ticks.
    pub step: Step,
}

impl PlotAxis {
    /// An axis over `low..=high`, widened where that is a single point, with at most `ticks` ticks.
    pub fn over(label: &str, low: f64, high: f64, ticks: usize) -> Self {
        let (low, high) = if low < high {
            (low, high)
        } else {
            let room = (low.abs() * 0.05).max(0.5);
            (low - room, low + room)
        };
        Self {
            label: label.to_owned(),
            low,
            high,
            step: Step::nice(high - low, ticks),
        }
    }
}

/// What stands around a panel.
#[derive(Debug, Clone, PartialEq)]
pub struct PanelFrame {
    /// Over the panel, left.
    pub title: String,
    /// Over the panel, right, smaller.
    pub remark: String,
    pub x: PlotAxis,
    pub y: PlotAxis,
    /// Whether there is a place for infinite values.
    pub infinity: bool,
}

/// Where the data of a panel goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlotArea {
    pub x: Scale,
    /// Grows upwards.
    pub y: Scale,
    /// Height at which infinite values stand.
    pub infinity: f64,
}

/// Draws the data of a panel.
pub type DrawData<'a> = Box<dyn Fn(&mut dyn Surface, &PlotArea) + 'a>;

/// A panel of a figure.
pub struct Panel<'a> {
    pub frame: PanelFrame,
    /// `Err` says why there is no data.
    pub content: Result<DrawData<'a>, &'static str>,
}

/// A figure of panels, with a legend and a caption.
///
/// # Errors
/// When the drawing library refuses.
pub fn figure(
    title: &str,
    caption: &str,
    legend: &[(&str, Style)],
    panels: &[Panel<'_>],
) -> Result<Figure, ReportError> {
    let labels: Vec<&str> = legend.iter().map(|(label, _)| *label).collect();
    let layout = PanelLayout::new(panels.len(), &labels, caption);
    Figure::draw(title, layout.size(), |surface| {
        layout.surround(surface, legend);
        for (i, panel) in panels.iter().enumerate() {
            let area = layout.panel(surface, i, &panel.frame);
            match &panel.content {
                Ok(draw) => draw(surface, &area),
                Err(reason) => area.remark(surface, reason),
            }
        }
    })
}

/// Sizes of a figure.
#[derive(Debug, Clone, PartialEq)]
struct PanelLayout {
    columns: usize,
    rows: usize,
    panel: (f64, f64),
    legend: Vec<Vec<usize>>,
    caption: Vec<String>,
}

impl PanelLayout {
    /// Room for `panels` panels, a legend with these labels, and a caption.
    fn new(panels: usize, labels: &[&str], caption: &str) -> Self {
        let columns = panels.clamp(1, 3);
        let panel = match columns {
            1 => (600.0, 290.0),
            2 => (400.0, 260.0),
            _ => (310.0, 215.0),
        };
        let mut grid = Self {
            columns,
            rows: panels.div_ceil(columns).max(1),
            panel,
            legend: Vec::new(),
            caption: Vec::new(),
        };
        let room = grid.width() - LEFT - RIGHT;
        grid.caption = wrapped(caption, TICK_SIZE, Weight::Regular, room * ROOM);
        let mut used = f64::INFINITY;
        for (i, label) in labels.iter().enumerate() {
            let item = legend_width(label);
            if used + item > room {
                grid.legend.push(Vec::new());
                used = 0.0;
            }
            used += item;
            if let Some(row) = grid.legend.last_mut() {
                row.push(i);
            }
        }
        grid
    }

    fn width(&self) -> f64 {
        2.0 * MARGIN + self.columns as f64 * (LEFT + self.panel.0 + RIGHT)
    }

    fn head(&self) -> f64 {
        MARGIN + self.legend.len() as f64 * LEGEND_ROW
    }

    /// Lower edge of the panels.
    fn foot(&self) -> f64 {
        self.head() + self.rows as f64 * (TOP + self.panel.1 + BOTTOM)
    }

    /// Of the whole figure, CSS pixels.
    fn size(&self) -> (u32, u32) {
        let height = self.foot() + self.caption.len() as f64 * CAPTION_ROW + MARGIN;
        (self.width().round() as u32, height.round() as u32)
    }

    /// Draws the legend and the caption.
    fn surround(&self, surface: &mut dyn Surface, entries: &[(&str, Style)]) {
        for (r, row) in self.legend.iter().enumerate() {
            let y = MARGIN + (r as f64 + 0.5) * LEGEND_ROW;
            let mut x = MARGIN + LEFT;
            for (label, style) in row.iter().filter_map(|i| entries.get(*i)) {
                stroke(surface, &[(x, y), (x + 26.0, y)], 2.0, *style);
                style.marker.draw(surface, (x + 13.0, y), MARKER, style.ink);
                let at = (x + 33.0, y + middle(LABEL_SIZE));
                surface.text(label, at, lettering(LABEL_SIZE, INK, Anchor::Start));
                x += legend_width(label);
            }
        }
        let small = lettering(TICK_SIZE, MUTED, Anchor::Start);
        for (i, line) in self.caption.iter().enumerate() {
            let at = (MARGIN + LEFT, self.foot() + (i as f64 + 0.7) * CAPTION_ROW);
            surface.text(line, at, small);
        }
    }

    /// Draws the frame of panel number `index` and says where its data goes.
    fn panel(&self, surface: &mut dyn Surface, index: usize, frame: &PanelFrame) -> PlotArea {
        let (column, row) = (index % self.columns, index / self.columns);
        let (w, h) = self.panel;
        let left = MARGIN + column as f64 * (LEFT + w + RIGHT) + LEFT;
        let top = self.head() + row as f64 * (TOP + h + BOTTOM) + TOP;
        let (right, bottom) = (left + w, top + h);
        let strip = if frame.infinity { INFINITY_STRIP } else { 0.0 };
        let place = PlotArea {
            x: Scale {
                low: frame.x.low,
                high: frame.x.high,
                from: left,
                to: right,
            },
            y: Scale {
                low: frame.y.low,
                high: frame.y.high,
                from: bottom,
                to: top + strip,
            },
            infinity: top + strip / 2.0,
        };
        let remark = lettering(TICK_SIZE, MUTED, Anchor::End);
        surface.text(&frame.remark, (right, top - 12.0), remark);
        let room = ROOM * w - width(&frame.remark, TICK_SIZE, Weight::Regular) - 12.0;
        let title = Lettering {
            weight: Weight::Bold,
            ..lettering(TITLE_SIZE, INK, Anchor::Start)
        };
        surface.text(
            &fitted(&frame.title, TITLE_SIZE, Weight::Bold, room),
            (left, top - 12.0),
            title,
        );

        let tick = lettering(TICK_SIZE, MUTED, Anchor::End);
        for k in frame.y.step.within(frame.y.low, frame.y.high) {
            let y = place.y.place(frame.y.step.at(k));
            surface.line(&[(left, y), (right, y)], 1.0, GRID);
            surface.text(
                &frame.y.step.text(k),
                (left - 8.0, y + middle(TICK_SIZE)),
                tick,
            );
        }
        if frame.infinity {
            let y = place.infinity;
            surface.line(&[(left, y), (right, y)], 1.0, GRID);
            surface.text("∞", (left - 8.0, y + middle(TICK_SIZE)), tick);
        }
        let tick = lettering(TICK_SIZE, MUTED, Anchor::Middle);
        for k in frame.x.step.within(frame.x.low, frame.x.high) {
            let x = place.x.place(frame.x.step.at(k));
            surface.line(&[(x, bottom), (x, bottom + 4.0)], 1.0, MUTED);
            surface.text(&frame.x.step.text(k), (x, bottom + 17.0), tick);
        }
        surface.line(&[(left, bottom), (right, bottom)], 1.0, MUTED);
        let label = lettering(LABEL_SIZE, INK, Anchor::Middle);
        surface.text(&frame.x.label, ((left + right) / 2.0, bottom + 36.0), label);
        let upwards = Lettering {
            upwards: true,
            ..label
        };
        let at = (left - LEFT + 14.0, (top + bottom) / 2.0);
        let label = fitted(&frame.y.label, LABEL_SIZE, Weight::Regular, ROOM * h);
        surface.text(&label, at, upwards);
        place
    }
}

impl PlotArea {
    /// Height of a value, infinite ones included.
    pub fn height(&self, value: f64) -> f64 {
        if value.is_infinite() {
            self.infinity
        } else {
            self.y.place(value)
        }
    }

    /// A line of text in the middle of an empty panel.
    fn remark(&self, surface: &mut dyn Surface, text: &str) {
        let at = (
            (self.x.from + self.x.to) / 2.0,
            (self.y.from + self.y.to) / 2.0,
        );
        surface.text(text, at, lettering(LABEL_SIZE, MUTED, Anchor::Middle));
    }
}

/// A marker for several samples, or a hollow one for a single sample.
pub fn point(surface: &mut dyn Surface, at: Point, style: Style, hollow: bool) {
    style.marker.draw(surface, at, MARKER + 1.2, PAPER);
    style.marker.draw(surface, at, MARKER, style.ink);
    if hollow {
        style.marker.draw(surface, at, MARKER * 0.5, PAPER);
    }
}

fn legend_width(label: &str) -> f64 {
    33.0 + width(label, LABEL_SIZE, Weight::Regular) / ROOM + 12.0
}

/// From the middle of a capital to its baseline.
fn middle(size: f64) -> f64 {
    size * CAP_HEIGHT / 2.0
}

fn lettering(size: f64, ink: Ink, anchor: Anchor) -> Lettering {
    Lettering {
        size,
        weight: Weight::Regular,
        ink,
        anchor,
        upwards: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_over_one_point_has_width() {
        let axis = PlotAxis::over("", 3.0, 3.0, 5);
        assert!(axis.low < 3.0 && axis.high > 3.0);
        let axis = PlotAxis::over("", f64::INFINITY, f64::NEG_INFINITY, 5);
        assert!(!axis.step.at(1).is_nan());
    }

    #[test]
    fn the_legend_wraps_and_the_figure_grows_with_it() {
        let labels: Vec<String> = (0..20)
            .map(|i| format!("a rather long label {i}"))
            .collect();
        let labels: Vec<&str> = labels.iter().map(String::as_str).collect();
        let (few, many) = (
            PanelLayout::new(2, &labels[..2], ""),
            PanelLayout::new(2, &labels, ""),
        );
        assert!(many.legend.len() > 2);
        assert_eq!(many.legend.iter().flatten().count(), 20);
        assert!(many.size().1 > few.size().1);
    }
}
