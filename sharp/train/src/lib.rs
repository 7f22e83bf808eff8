//! Training of SHARP: losses with their derivatives, data, optimiser, both stages of the paper.
//!
//! Knows no harness: whoever runs a training hands in how it is validated.

pub mod data;
pub mod losses;
