//! Plots of a run, drawn as SVG, PNG and PDF from one description.
//!
//! * [`canvas`]: a surface and the files that it becomes; [`pdf`], [`png`]: two of them; [`text`]: text in the bundled font.
//! * [`style`]: how large figures are, and in which colours; [`palette`]: colours and markers of the methods; [`scale`]:
//!   round tick steps; [`bins`]: samples along an axis.
//! * [`panels`]: axes, legend and the grid of panels; [`curves`]: means of bins with their band; [`baselines`]: the figures
//!   of a report.

pub mod baselines;
pub mod bins;
pub mod canvas;
pub mod curves;
pub mod ink;
pub mod palette;
pub mod panels;
pub mod pdf;
pub mod png;
pub mod scale;
pub mod style;
pub mod text;

pub use canvas::Figure;
