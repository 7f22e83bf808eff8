//! Experiments other than evaluations.
//!
//! * [`port`]: compares a port of SHARP with the release or with this implementation.
//! * [`translation`]: the paper's experiment on any picture: how much a small shift changes each
//!   metric.

pub mod port;
pub mod translation;
