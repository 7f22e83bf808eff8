//! An axis of a plot: range, ticks and label.

use super::scale::{Step, finite_range, log_ticks};

/// An axis: its range and its ticks.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotAxis {
    /// Label with the unit.
    pub label: String,
    pub low: f64,
    pub high: f64,
    /// Positions and texts of the ticks.
    pub ticks: Vec<(f64, String)>,
    /// Whether positions are decimal logarithms of the values.
    pub is_logarithmic: bool,
}

impl PlotAxis {
    /// An axis over `low..=high` with at most `ticks` ticks; widened if the range is a single point.
    pub fn over(label: &str, low: f64, high: f64, ticks: usize) -> Self {
        let (low, high) = if low < high {
            (low, high)
        } else {
            let room = (low.abs() * 0.05).max(0.5);
            (low - room, low + room)
        };
        let step = Step::nice(high - low, ticks);
        let ticks = step.within(low, high).into_iter();
        Self {
            label: label.to_owned(),
            low,
            high,
            ticks: ticks.map(|k| (step.at(k), step.text(k))).collect(),
            is_logarithmic: false,
        }
    }

    /// The axis with a style's label and limits, if the style sets them.
    pub(super) fn styled(&self, label: Option<&String>, limits: Option<[f64; 2]>) -> Self {
        let label = label.unwrap_or(&self.label);
        match limits {
            None => Self {
                label: label.clone(),
                ..self.clone()
            },
            Some([low, high]) if self.is_logarithmic => {
                Self::logarithmic(label, low.max(f64::MIN_POSITIVE), high)
            }
            Some([low, high]) => Self::over(label, low, high, 6),
        }
    }

    /// An axis over all finite values, extended at either end by `room` times their range; 0 to 1
    /// without finite values.
    pub fn around(label: &str, values: impl IntoIterator<Item = f64>, room: f64) -> Self {
        let (low, high) = finite_range(values).unwrap_or((0.0, 1.0));
        let room = (high - low) * room;
        Self::over(label, low - room, high + room, 6)
    }

    /// Keeps only ticks at whole numbers.
    #[must_use]
    pub fn counting(mut self) -> Self {
        self.ticks.retain(|(at, _)| at.fract() == 0.0);
        for (at, text) in &mut self.ticks {
            *text = format!("{at:.0}");
        }
        self
    }

    /// An axis of decimal logarithms over `low..=high`, both positive; data drawn on it must be
    /// logarithms too.
    pub fn logarithmic(label: &str, low: f64, high: f64) -> Self {
        let ticks = log_ticks(low, high).into_iter();
        Self {
            ticks: ticks.map(|tick| (tick.log10(), tick.to_string())).collect(),
            is_logarithmic: true,
            ..Self::over(label, low.log10(), high.log10(), 1)
        }
    }
}
