//! Figures for screens and papers, drawn as SVG, PNG and PDF from one description. Independent of metrics and runs.
//!
//! * [`panels`]: legend and the grid of panels; [`axis`]: an axis; [`curves`]: bin means with their bands; [`bins`]: binning along
//!   an axis; [`scale`]: round tick steps and number formatting.
//! * [`canvas`]: a drawing; [`figure`]: its output files; [`png`]: the PNG encoder; [`text`]: text in the bundled font.
//! * [`style`]: size and colours of figures; [`palette`]: colours and markers; [`ink`]: one colour.

pub mod axis;
pub mod bins;
pub mod canvas;
pub mod curves;
pub mod figure;
pub mod ink;
pub mod palette;
pub mod panels;
mod pdf;
pub mod png;
pub mod scale;
pub mod style;
pub mod text;

pub use figure::{Drawing, Figure};

/// Error of making a figure: the drawing library or an encoder failed, there is nothing to draw, or
/// there is no room.
#[derive(Debug, thiserror::Error)]
#[error("plot '{plot}': {reason}")]
pub struct PlotError {
    pub plot: String,
    pub reason: String,
}

impl PlotError {
    pub fn new(plot: impl Into<String>, reason: impl ToString) -> Self {
        Self {
            plot: plot.into(),
            reason: reason.to_string(),
        }
    }
}
