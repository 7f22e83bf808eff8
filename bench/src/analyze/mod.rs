//! Experiments other than evaluations.
//!
//! * [`port`]: compares a port of SHARP with the release or with this implementation.
//! * [`translation`]: the paper's experiment on any picture: how much each metric changes under a small shift.

pub mod port;
pub mod translation;
