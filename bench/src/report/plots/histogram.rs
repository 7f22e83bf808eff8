//! How far apart the cameras of the pairs are, one panel a dataset.

use crate::report::error::ReportError;
use crate::report::records::Board;

use super::bins::bins;
use super::canvas::{Figure, Ink, Surface};
use super::motion::Motion;
use super::panels::{Axis, Frame, Grid};
use super::scale::Step;

/// Bins of a dataset are at most this many unless a width is given.
const BINS: usize = 20;
const BAR: Ink = Ink::opaque(0x00, 0x72, 0xB2);

/// The histogram of baselines. `None` if no dataset has a pair.
///
/// # Errors
/// When the drawing library refuses.
pub fn figure(
    board: &Board<'_>,
    motion: Motion,
    bin_width: Option<Step>,
) -> Result<Option<Figure>, ReportError> {
    let samples: Vec<Vec<f64>> = board
        .datasets
        .iter()
        .map(|d| {
            let mut motions: Vec<f64> = d.pairs.iter().filter_map(|p| motion.of(p.facts)).collect();
            motions.sort_by(f64::total_cmp);
            motions
        })
        .collect();
    if samples.iter().all(Vec::is_empty) {
        return Ok(None);
    }
    let caption = "Bins include their left edge; each panel has its own scales.";
    let grid = Grid::new(samples.len(), &[], caption);
    let title = format!("Histogram of {}", motion.label());
    let draw = |surface: &mut dyn Surface| {
        grid.surround(surface, &[]);
        for (i, (motions, dataset)) in samples.iter().zip(&board.datasets).enumerate() {
            let farthest = motions.last().copied().unwrap_or(0.0);
            let step = bin_width.unwrap_or_else(|| Step::nice(farthest, BINS));
            let counted: Vec<(f64, f64)> = motions.iter().map(|m| (*m, 1.0)).collect();
            let bars = bins(&counted, step);
            let most = bars.iter().map(|b| b.n).max().unwrap_or(1) as f64;
            let mut y = Axis::over("pairs", 0.0, most * 1.06, 5);
            if y.step.at(1) < 1.0 {
                y.step = Step::nice(1.0, 1);
            }
            let end = step.at(step.index(farthest).saturating_add(1));
            let frame = Frame {
                title: dataset.dataset.name.clone(),
                remark: remark(motions, motion),
                x: Axis::over(
                    motion.label(),
                    0.0,
                    if end.is_finite() { end } else { 1.0 },
                    6,
                ),
                y,
                infinity: false,
            };
            let place = grid.panel(surface, i, &frame);
            if bars.is_empty() {
                place.remark(surface, "no samples");
            }
            for bar in bars {
                let (left, right) = (
                    place.x.place(bar.low) + 0.75,
                    place.x.place(bar.high) - 0.75,
                );
                let (foot, top) = (place.y.place(0.0), place.y.place(bar.n as f64));
                let right = right.max(left + 0.5);
                surface.polygon(
                    &[(left, top), (right, top), (right, foot), (left, foot)],
                    BAR,
                );
            }
        }
    };
    Figure::draw(&title, grid.size(), draw).map(Some)
}

/// Count and median; the median of an even count is the mean of the middle two.
fn remark(sorted: &[f64], motion: Motion) -> String {
    let n = sorted.len();
    let median = match (sorted.get(n.saturating_sub(1) / 2), sorted.get(n / 2)) {
        (Some(a), Some(b)) => (a + b) / 2.0,
        _ => return "0 pairs".into(),
    };
    let unit = match motion {
        Motion::Metres => " m",
        Motion::MedianDepths => "",
    };
    let pairs = if n == 1 { "pair" } else { "pairs" };
    format!("{n} {pairs}, median {median:.3}{unit}")
}
