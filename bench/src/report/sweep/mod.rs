//! Scores against camera motion: a study over the pairs of runs.
//!
//! * [`motion`]: the horizontal axis; [`spec`]: the options.
//! * [`study`]: means of bins by dataset and method, with intervals over scenes; [`crossing`]: the motion beyond which
//!   a method is worse than another, or than a threshold.
//! * [`figure`]: the plots; [`table`]: their numbers as CSV and LaTeX; [`files`]: writes a folder.

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
