//! Experiments besides evaluations.
//!
//! * [`port`]: a port of SHARP against the release or us.
//! * [`translation`]: the paper's, on any picture: how far each metric moves when it is shifted a little.

pub mod port;
pub mod translation;
