//! Scores against how far the camera moved: a study over the pairs of runs.
//!
//! * [`motion`]: what is on the horizontal axis; [`spec`]: what is asked for.
//! * [`study`]: means of bins by dataset and method, with intervals over scenes; [`crossing`]: from which distance on a method
//!   falls behind another, or is beyond a threshold.
//! * [`figure`]: the plots; [`table`]: the numbers behind them as CSV and LaTeX; [`files`]: all of it
//!   into a folder.

pub mod crossing;
pub mod figure;
pub mod files;
pub mod motion;
pub mod spec;
pub mod study;
pub mod table;
#[cfg(test)]
mod tests;

pub use motion::Motion;
pub use spec::{Band, Split, SweepSpec};
pub use study::Sweep;
