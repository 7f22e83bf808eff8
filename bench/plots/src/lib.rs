//! Figures for screens and papers, drawn as SVG, PNG and PDF from one description. Knows no metric and no run.
//!
//! * [`panels`]: axes, legend and the grid of panels; [`curves`]: means of bins with their band; [`bins`]: samples along an
//!   axis; [`scale`]: round tick steps and numbers as they are shown.
//! * [`canvas`]: a drawing and the files that it becomes; [`png`]: one of them; [`text`]: text in the bundled font.
//! * [`style`]: how large figures are, and in which colours; [`palette`]: colours and markers; [`ink`]: one colour.

pub mod bins;
pub mod canvas;
pub mod curves;
pub mod ink;
pub mod palette;
pub mod panels;
mod pdf;
pub mod png;
pub mod scale;
pub mod style;
pub mod text;

pub use canvas::Figure;

/// Why a figure cannot be made: the drawing library or an encoder refused, there is nothing to draw, or no room for it.
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
