//! Plots of a run, drawn by plotters as SVG and PNG from one description.
//!
//! * [`canvas`]: a surface in CSS pixels and its two backends; [`text`]: text in the bundled font.
//! * [`palette`]: colours and markers of the methods; [`scale`]: round tick steps; [`bins`]: samples by baseline.
//! * [`panels`]: axes, legend and the grid of panels; [`baselines`]: the figures.

pub mod baselines;
pub mod bins;
pub mod canvas;
pub mod palette;
pub mod panels;
pub mod scale;
pub mod text;

pub use canvas::Figure;
