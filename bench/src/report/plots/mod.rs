//! Plots of a run, drawn by plotters as SVG and PNG from one description.
//!
//! * [`canvas`]: a surface in CSS pixels and its two backends; [`font`], [`lettering`]: text in the
//!   bundled font.
//! * [`palette`]: colours and markers of the methods; [`scale`]: round tick steps; [`bins`]: samples by motion.
//! * [`panels`]: axes, legend and the grid of panels; [`motion`], [`histogram`]: the figures.

pub mod bins;
pub mod canvas;
pub mod font;
pub mod histogram;
pub mod lettering;
pub mod motion;
pub mod palette;
pub mod panels;
pub mod scale;

pub use canvas::Figure;
