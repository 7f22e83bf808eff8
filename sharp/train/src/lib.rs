//! Training of the SHARP network.
//!
//! # Contents
//! * [`losses`]: what is minimised: pure functions of slices, each with its gradient.

pub mod losses;
