//! Comparison of runs.
//!
//! * [`compare`]: two runs pair by pair: changes, their significance, and changes by part.
//! * [`gate`]: limits on such changes, for continuous integration.
//! * [`history`]: runs over time, with change points.

pub mod compare;
pub mod gate;
pub mod history;
