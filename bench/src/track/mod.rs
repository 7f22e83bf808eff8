//! Scores from run to run.
//!
//! * [`compare`]: two runs pair by pair: changes, their parts and their significance.
//! * [`gate`]: limits on such changes, for continuous integration.
//! * [`history`]: runs over time, with their change points.

pub mod compare;
pub mod gate;
pub mod history;
