//! A grid of panels, one per dataset, with a shared legend and axes.

use std::collections::BTreeSet;

use crate::PlotError;

use super::axis::PlotAxis;
use super::canvas::{Anchor, Lettering, Point, Surface};
use super::figure::Figure;
use super::ink::{BARS, GRID, INK, MUTED, PAPER};
use super::palette::{Style, stroke};
use super::scale::Scale;
use super::style::{FigureStyle, Medium};
use super::text::{CAP_HEIGHT, Weight, fitted, width, wrapped, wrapped_to};

const LEFT: f64 = 62.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 52.0;
const MARGIN: f64 = 10.0;
const LEGEND_LINE: f64 = 16.0;
/// Gap between rows of the legend.
const LEGEND_GAP: f64 = 6.0;
/// Maximum number of lines of a label in the legend.
const LABEL_LINES: usize = 3;
/// Distance from the left of a legend entry to its label.
const LEGEND_MARK: f64 = 33.0;
/// Distance from a legend label to the next entry.
const LEGEND_SPACE: f64 = 12.0;
const CAPTION_ROW: f64 = 17.0;
const TITLE_ROW: f64 = 26.0;
const TICK_SIZE: f64 = 11.5;
const LABEL_SIZE: f64 = 12.5;
const TITLE_SIZE: f64 = 14.0;

/// Share of the available room that a line of text may fill on a screen, where fallback fonts may be
/// wider than the bundled font.
const ROOM: f64 = 0.8;
/// Share of the available room that a line of text may fill in print, where the bundled font is used.
const PRINT_ROOM: f64 = 0.96;
/// Preferred minimum panel width in print.
const NARROWEST: f64 = 170.0;
/// Minimum panel width; below this width, the numbers of an axis overlap.
const MIN_WIDTH: f64 = 130.0;
/// Height of the strip of sample counts.
const COUNT_STRIP: f64 = 30.0;
/// Font size of sample counts.
const COUNT_SIZE: f64 = 9.5;
/// Radius of a data point.
pub const MARKER: f64 = 4.2;
/// Height of the strip for infinite values, above the axis.
const INFINITY_STRIP: f64 = 22.0;

/// Texts and axes around a panel.
#[derive(Debug, Clone, PartialEq)]
pub struct PanelFrame {
    /// Text above the panel, left-aligned.
    pub title: String,
    /// Text above the panel, right-aligned and smaller than the title.
    pub remark: String,
    pub x: PlotAxis,
    pub y: PlotAxis,
    /// Whether to reserve a strip for infinite values.
    pub infinity: bool,
    /// Number of samples in each part of the horizontal axis, drawn in a strip below the data; may
    /// be empty.
    pub counts: Vec<BinCount>,
}

impl PanelFrame {
    /// A frame without a strip for infinite values or counts.
    pub fn new(
        title: impl Into<String>,
        remark: impl Into<String>,
        x: PlotAxis,
        y: PlotAxis,
    ) -> Self {
        Self {
            title: title.into(),
            remark: remark.into(),
            x,
            y,
            infinity: false,
            counts: Vec::new(),
        }
    }

    /// The frame with the labels and limits of a style.
    fn styled(&self, style: &FigureStyle) -> Self {
        let x = self.x.styled(style.xlabel.as_ref(), style.xlim);
        let within = |count: &BinCount| BinCount {
            low: count.low.max(x.low),
            high: count.high.min(x.high),
            ..*count
        };
        let counts = self.counts.iter().map(within);
        Self {
            counts: counts.filter(|count| count.low < count.high).collect(),
            y: self.y.styled(style.ylabel.as_ref(), style.ylim),
            x,
            ..self.clone()
        }
    }
}

/// Number of samples in a part of the horizontal axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BinCount {
    pub low: f64,
    pub high: f64,
    /// Smallest and largest number of samples of any curve; equal if the curves agree.
    pub n: (usize, usize),
}

/// Area of a panel's data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlotArea {
    pub x: Scale,
    /// Vertical scale; values grow upwards.
    pub y: Scale,
    /// Vertical position of infinite values.
    pub infinity: f64,
}

/// Function that draws the data of a panel.
pub type DrawData<'a> = Box<dyn Fn(&mut Surface, &PlotArea) + 'a>;

pub struct Panel<'a> {
    pub frame: PanelFrame,
    /// Draws the data of the panel; `Err` is the reason why there are no data.
    pub content: Result<DrawData<'a>, &'static str>,
}

/// Draws a figure. If a style is given, the figure is made for print, and the style may omit the caption. Repeated
/// labels appear in the legend once.
///
/// # Errors
/// If the drawing library fails, or the style has no room for a panel.
pub fn figure(
    title: &str,
    caption: &str,
    legend: &[(&str, Style)],
    panels: &[Panel<'_>],
    print: Option<&FigureStyle>,
) -> Result<Figure, PlotError> {
    let mut known = BTreeSet::new();
    let legend = legend.iter().filter(|(label, _)| known.insert(*label));
    let legend: Vec<(&str, Style)> = legend.copied().collect();
    let labels: Vec<&str> = legend.iter().map(|(label, _)| *label).collect();
    let caption = if print.is_none_or(|style| style.caption) {
        caption
    } else {
        ""
    };
    let mut layout = PanelLayout::new(panels.len(), &labels, caption, print);
    if let Some(style) = print.filter(|_| layout.panel.0 < MIN_WIDTH) {
        let times = 1.0 + (MIN_WIDTH - layout.panel.0) / style.units();
        return Err(PlotError::new(title, style.narrow(times)));
    }
    if panels.iter().any(|panel| !panel.frame.counts.is_empty()) {
        layout.bottom += COUNT_STRIP;
    }
    let medium = print.map_or(Medium::SCREEN, FigureStyle::medium);
    Figure::draw(title, layout.size(), medium, |surface| {
        layout.surround(surface, &legend);
        for (i, panel) in panels.iter().enumerate() {
            let frame =
                print.map_or_else(|| panel.frame.clone(), |style| panel.frame.styled(style));
            let area = layout.panel(surface, i, &frame);
            let mut data = Surface::default();
            match &panel.content {
                Ok(draw) => draw(&mut data, &area),
                Err(reason) => area.remark(&mut data, reason),
            }
            if print.is_some_and(|style| style.xlim.or(style.ylim).is_some()) {
                let top = area.y.to.min(area.infinity);
                data.clip((area.x.from, top), (area.x.to, area.y.from));
            }
            surface.extend(data);
        }
    })
}

/// Layout of a figure: its grid of panels and the wrapped title, legend and caption around it.
#[derive(Debug, Clone, PartialEq)]
struct PanelLayout {
    columns: usize,
    rows: usize,
    panel: (f64, f64),
    /// Distance from a panel to the content below it.
    bottom: f64,
    /// Share of the available room that text may fill.
    fill: f64,
    /// Title above everything else; empty for no title.
    title: String,
    legend: Vec<Vec<LegendEntry>>,
    caption: Vec<String>,
}

#[derive(Debug, Clone, PartialEq)]
struct LegendEntry {
    /// Index in the figure's legend.
    index: usize,
    label: Vec<String>,
    width: f64,
}

impl PanelLayout {
    /// Layout for `panels` panels, a legend of `labels`, and `caption`.
    fn new(panels: usize, labels: &[&str], caption: &str, print: Option<&FigureStyle>) -> Self {
        let (columns, panel) = match print {
            None => match panels {
                0..=1 => (1, (600.0, 290.0)),
                2 => (2, (400.0, 260.0)),
                _ => (3, (310.0, 215.0)),
            },
            Some(style) => {
                let room = style.units() - 2.0 * MARGIN;
                let fitting = (room / (LEFT + NARROWEST + RIGHT)) as usize;
                let columns = style.columns.unwrap_or(fitting).clamp(1, panels.max(1));
                let width = room / columns as f64 - LEFT - RIGHT;
                (columns, (width, width * style.panel_aspect))
            }
        };
        let mut grid = Self {
            columns,
            rows: panels.div_ceil(columns).max(1),
            panel,
            bottom: BOTTOM,
            fill: if print.is_some() { PRINT_ROOM } else { ROOM },
            title: print
                .and_then(|style| style.title.clone())
                .unwrap_or_default(),
            legend: Vec::new(),
            caption: Vec::new(),
        };
        let room = grid.width() - LEFT - RIGHT;
        grid.caption = wrapped(caption, TICK_SIZE, Weight::Regular, room * grid.fill);
        let mut used = f64::INFINITY;
        let label_room = (room - LEGEND_MARK - LEGEND_SPACE) * grid.fill;
        for (index, label) in labels.iter().enumerate() {
            let label = wrapped_to(LABEL_LINES, label, LABEL_SIZE, Weight::Regular, label_room);
            let widths = label
                .iter()
                .map(|line| width(line, LABEL_SIZE, Weight::Regular));
            let widest = widths.fold(0.0, f64::max);
            let width = LEGEND_MARK + widest / grid.fill + LEGEND_SPACE;
            if used + width > room {
                grid.legend.push(Vec::new());
                used = 0.0;
            }
            used += width;
            if let Some(row) = grid.legend.last_mut() {
                row.push(LegendEntry {
                    index,
                    label,
                    width,
                });
            }
        }
        grid
    }

    fn width(&self) -> f64 {
        2.0 * MARGIN + self.columns as f64 * (LEFT + self.panel.0 + RIGHT)
    }

    fn title_row(&self) -> f64 {
        if self.title.is_empty() {
            0.0
        } else {
            TITLE_ROW
        }
    }

    fn head(&self) -> f64 {
        MARGIN + self.title_row() + self.legend.iter().map(|row| legend_row(row)).sum::<f64>()
    }

    /// Lower edge of the panels.
    fn foot(&self) -> f64 {
        self.head() + self.rows as f64 * (TOP + self.panel.1 + self.bottom)
    }

    /// Size of the whole figure, CSS pixels.
    fn size(&self) -> (u32, u32) {
        let height = self.foot() + self.caption.len() as f64 * CAPTION_ROW + MARGIN;
        (self.width().round() as u32, height.round() as u32)
    }

    /// Draws the legend and the caption.
    fn surround(&self, surface: &mut Surface, entries: &[(&str, Style)]) {
        let mut top = MARGIN + self.title_row();
        let title = Lettering {
            weight: Weight::Bold,
            ..Lettering::new(TITLE_SIZE, INK, Anchor::Middle)
        };
        let room = self.fill * (self.width() - 2.0 * MARGIN);
        let text = fitted(&self.title, TITLE_SIZE, Weight::Bold, room);
        surface.text(&text, (self.width() / 2.0, top - 10.0), title);
        for row in &self.legend {
            let y = top + (LEGEND_LINE + LEGEND_GAP) / 2.0;
            let mut x = MARGIN + LEFT;
            for entry in row {
                if let Some((_, style)) = entries.get(entry.index) {
                    stroke(surface, &[(x, y), (x + 26.0, y)], 2.0, *style);
                    style.marker.draw(surface, (x + 13.0, y), MARKER, style.ink);
                }
                for (i, line) in entry.label.iter().enumerate() {
                    let base = y + middle(LABEL_SIZE) + i as f64 * LEGEND_LINE;
                    let label = Lettering::new(LABEL_SIZE, INK, Anchor::Start);
                    surface.text(line, (x + LEGEND_MARK, base), label);
                }
                x += entry.width;
            }
            top += legend_row(row);
        }
        let small = Lettering::new(TICK_SIZE, MUTED, Anchor::Start);
        for (i, line) in self.caption.iter().enumerate() {
            let at = (MARGIN + LEFT, self.foot() + (i as f64 + 0.7) * CAPTION_ROW);
            surface.text(line, at, small);
        }
    }

    /// Draws the frame of panel number `index` and returns its data area.
    fn panel(&self, surface: &mut Surface, index: usize, frame: &PanelFrame) -> PlotArea {
        let (column, row) = (index % self.columns, index / self.columns);
        let (w, h) = self.panel;
        let left = MARGIN + column as f64 * (LEFT + w + RIGHT) + LEFT;
        let top = self.head() + row as f64 * (TOP + h + self.bottom) + TOP;
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
        let remark = fitted(&frame.remark, TICK_SIZE, Weight::Regular, self.fill * w);
        let small = Lettering::new(TICK_SIZE, MUTED, Anchor::End);
        surface.text(&remark, (right, top - 12.0), small);
        let room = self.fill * w - width(&remark, TICK_SIZE, Weight::Regular) - 12.0;
        let title = Lettering {
            weight: Weight::Bold,
            ..Lettering::new(TITLE_SIZE, INK, Anchor::Start)
        };
        surface.text(
            &fitted(&frame.title, TITLE_SIZE, Weight::Bold, room),
            (left, top - 12.0),
            title,
        );

        let tick = Lettering::new(TICK_SIZE, MUTED, Anchor::End);
        for (at, text) in &frame.y.ticks {
            let y = place.y.place(*at);
            surface.line(&[(left, y), (right, y)], 1.0, GRID);
            surface.text(text, (left - 8.0, y + middle(TICK_SIZE)), tick);
        }
        if frame.infinity {
            let y = place.infinity;
            surface.line(&[(left, y), (right, y)], 1.0, GRID);
            surface.text("∞", (left - 8.0, y + middle(TICK_SIZE)), tick);
        }
        surface.line(&[(left, bottom), (right, bottom)], 1.0, MUTED);
        let mut bottom = bottom;
        if !frame.counts.is_empty() {
            bottom += COUNT_STRIP;
            count_strip(surface, &frame.counts, &place.x, bottom);
        }
        let tick = Lettering::new(TICK_SIZE, MUTED, Anchor::Middle);
        for (at, text) in &frame.x.ticks {
            let x = place.x.place(*at);
            surface.line(&[(x, bottom), (x, bottom + 4.0)], 1.0, MUTED);
            surface.text(text, (x, bottom + 17.0), tick);
        }
        let label = Lettering::new(LABEL_SIZE, INK, Anchor::Middle);
        let room = self.fill * (w + 2.0 * RIGHT);
        let across = fitted(&frame.x.label, LABEL_SIZE, Weight::Regular, room);
        surface.text(&across, ((left + right) / 2.0, bottom + 36.0), label);
        let upwards = Lettering {
            upwards: true,
            ..label
        };
        let at = (left - LEFT + 14.0, top + h / 2.0);
        let label = fitted(&frame.y.label, LABEL_SIZE, Weight::Regular, self.fill * h);
        surface.text(&label, at, upwards);
        place
    }
}

impl PlotArea {
    /// Vertical position of a value, which may be infinite.
    pub fn height(&self, value: f64) -> f64 {
        if value.is_infinite() {
            self.infinity
        } else {
            self.y.place(value)
        }
    }

    /// Centres a line of text in an empty panel.
    fn remark(&self, surface: &mut Surface, text: &str) {
        let at = (
            (self.x.from + self.x.to) / 2.0,
            (self.y.from + self.y.to) / 2.0,
        );
        surface.text(text, at, Lettering::new(LABEL_SIZE, MUTED, Anchor::Middle));
    }
}

/// Draws a marker, hollow for a single sample.
pub fn point(surface: &mut Surface, at: Point, style: Style, hollow: bool) {
    style.marker.draw(surface, at, MARKER + 1.2, PAPER);
    style.marker.draw(surface, at, MARKER, style.ink);
    if hollow {
        style.marker.draw(surface, at, MARKER * 0.5, PAPER);
    }
}

/// Draws bars of the sample counts, with the numbers above if they fit; `foot` is the lower edge.
fn count_strip(surface: &mut Surface, counts: &[BinCount], x: &Scale, foot: f64) {
    let most = counts.iter().map(|count| count.n.1).max().unwrap_or(1);
    let text_of = |(least, most): (usize, usize)| {
        if least == most {
            most.to_string()
        } else {
            format!("{least}–{most}")
        }
    };
    let room = |count: &BinCount| x.place(count.high) - x.place(count.low);
    let fits =
        |count: &&BinCount| width(&text_of(count.n), COUNT_SIZE, Weight::Regular) < room(count);
    let numbered = counts
        .iter()
        .filter(|count| room(count) > 0.0)
        .all(|count| fits(&count));
    for count in counts {
        let (left, right) = (x.place(count.low) + 0.75, x.place(count.high) - 0.75);
        let top = foot - (COUNT_STRIP - 16.0) * count.n.1 as f64 / most as f64;
        let right = right.max(left + 0.5);
        let corners = [(left, top), (right, top), (right, foot), (left, foot)];
        surface.polygon(&corners, BARS);
        if numbered {
            let at = ((left + right) / 2.0, top - 2.0);
            let small = Lettering::new(COUNT_SIZE, MUTED, Anchor::Middle);
            surface.text(&text_of(count.n), at, small);
        }
    }
    let label = if numbered {
        "n".to_owned()
    } else {
        format!("n ≤ {most}")
    };
    let small = Lettering::new(COUNT_SIZE, MUTED, Anchor::End);
    surface.text(&label, (x.from - 8.0, foot - 2.0), small);
}

fn legend_row(row: &[LegendEntry]) -> f64 {
    let lines = row.iter().map(|entry| entry.label.len()).max();
    lines.unwrap_or(1).max(1) as f64 * LEGEND_LINE + LEGEND_GAP
}

/// Distance from the middle of a capital letter to its baseline.
fn middle(size: f64) -> f64 {
    size * CAP_HEIGHT / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_end_where_the_axis_does() {
        let axis = || PlotAxis::over("x", 0.0, 1.0, 5);
        let count = |low, high| BinCount {
            low,
            high,
            n: (1, 1),
        };
        let frame = PanelFrame {
            counts: vec![count(0.0, 0.2), count(0.2, 0.5), count(0.5, 1.0)],
            ..PanelFrame::new("", "", axis(), axis())
        };
        let style = FigureStyle {
            xlim: Some([0.3, 0.4]),
            xlabel: Some("label".into()),
            ..FigureStyle::default()
        };
        let styled = frame.styled(&style);
        assert_eq!(styled.counts, [count(0.3, 0.4)]);
        assert_eq!((styled.x.label.as_str(), styled.x.low), ("label", 0.3));
        assert_eq!(styled.y, frame.y);
    }

    #[test]
    fn an_axis_over_one_point_has_width() {
        let axis = PlotAxis::over("", 3.0, 3.0, 5);
        assert!(axis.low < 3.0 && axis.high > 3.0);
        let axis = PlotAxis::over("", f64::INFINITY, f64::NEG_INFINITY, 5);
        assert!(axis.ticks.iter().all(|(at, _)| !at.is_nan()));
    }

    #[test]
    fn the_legend_wraps_and_the_figure_grows_with_it() {
        let labels: Vec<String> = (0..20)
            .map(|i| format!("a rather long label {i}"))
            .collect();
        let labels: Vec<&str> = labels.iter().map(String::as_str).collect();
        let (few, many) = (
            PanelLayout::new(2, &labels[..2], "", None),
            PanelLayout::new(2, &labels, "", None),
        );
        assert!(many.legend.len() > 2);
        assert_eq!(many.legend.iter().flatten().count(), 20);
        assert!(many.size().1 > few.size().1);
    }

    #[test]
    fn labels_wider_than_the_legend_have_several_lines() {
        let labels = ["a label/without spaces, ".repeat(6), "x".repeat(400)];
        let labels = [labels[0].as_str(), "short", &labels[1]];
        for print in [None, Some(&FigureStyle::default())] {
            let layout = PanelLayout::new(1, &labels, "", print);
            let entries: Vec<&LegendEntry> = layout.legend.iter().flatten().collect();
            let room = layout.width() - LEFT - RIGHT;
            assert!(entries.iter().all(|entry| entry.width <= room));
            assert!(entries[0].label.len() > 1 && entries[1].label == ["short"]);
            assert!(entries[2].label.len() == LABEL_LINES && entries[2].label[1].contains('…'));
            let rows = layout.legend.iter().map(|row| legend_row(row));
            assert_eq!(layout.head(), MARGIN + rows.sum::<f64>());
        }
    }

    #[test]
    fn a_style_without_room_for_a_panel_is_refused() {
        let style = |width_mm, font_pt| FigureStyle {
            width_mm,
            font_pt,
            ..FigureStyle::default()
        };
        let of = |style| figure("t", "c", &[], &[], Some(&style)).map_err(|e| e.to_string());
        let error = of(style(20.0, 40.0)).unwrap_err();
        assert!(
            error.contains("width_mm") && error.contains("40 pt"),
            "{error}"
        );
        assert!(
            of(style(51.0, 8.0))
                .unwrap_err()
                .contains("width_mm of 52,")
        );
        assert!(of(style(52.0, 8.0)).is_ok());
    }
}
