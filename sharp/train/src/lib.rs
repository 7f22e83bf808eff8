//! Training of SHARP: losses with their derivatives, data, optimiser, both stages of the paper.
//!
//! Knows no harness: whoever runs a training hands in how it is validated.
//!
//! # Contents
//! * [`losses`]: what is minimised.
//! * [`config`]: a training as one TOML file; [`parts`]: which of the network's parts learn.
//! * [`position`]: where a training stands.
//! * [`optimizer`], [`schedule`]: Adam, the clipped gradient, the learning rate.
//! * [`checkpoint`]: a training's state as a file, the files that are kept, weights alone.
//! * [`log`]: every step as a row.

pub mod checkpoint;
pub mod config;
pub mod log;
pub mod losses;
pub mod optimizer;
pub mod parts;
pub mod position;
pub mod schedule;
