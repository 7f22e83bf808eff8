//! Training of SHARP: losses with their derivatives, data, optimiser, both stages of the paper.
//!
//! Knows no harness: whoever runs a training hands in how it is validated.
//!
//! # Contents
//! * [`data`]: what is learnt from; `self_supervision`: the second stage's part of it;
//!   `examples`: as a configuration says.
//! * [`losses`]: what is minimised; `objective`: all of it on one example.
//! * `initial`: weights before the first step.
//! * [`config`]: a training as one TOML file; [`parts`]: which of the network's parts learn.
//! * [`position`]: where a training stands.
//! * [`optimizer`], [`schedule`]: Adam, the clipped gradient, the learning rate.
//! * [`checkpoint`]: a training's state as a file, the files that are kept, weights alone.
//! * [`log`]: every step as a row; `stopped`: what a step that went wrong was given.
//! * [`trainer`]: from the first step to the last.

pub mod checkpoint;
pub mod config;
pub mod data;
mod examples;
mod initial;
pub mod log;
pub mod losses;
mod objective;
pub mod optimizer;
pub mod parts;
pub mod position;
pub mod schedule;
mod self_supervision;
mod stopped;
pub mod trainer;
