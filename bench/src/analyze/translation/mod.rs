//! How much each metric changes if a picture is shifted a little, or replaced by its mean colour: the paper's argument
//! for DISTS and LPIPS.
//!
//! A shift moves a window over the picture, so no border is filled in and nothing wraps around. The
//! reference is the window at the picture's left edge, a shifted picture is the window moved to the
//! right, and the mean image has the reference's mean colour. All have the same size. Sub-pixel
//! shifts are bilinear; all pictures are rounded to 8 bits, as predictions are.
//!
//! * [`shift`]: windows, shifts and the mean image.
//! * [`experiment`]: all comparisons of a picture, scored.
//! * [`table`]: the scores as a table, next to the paper's own.
//! * [`figure`]: the scores as plots.
//! * [`strip`]: the pictures side by side.

pub mod experiment;
pub mod figure;
pub mod shift;
pub mod strip;
pub mod table;

pub use experiment::{Comparison, Experiment, ExperimentError};
pub use shift::{Shifts, ShiftsError};
