//! Training of SHARP: losses with their derivatives, data, optimiser, and both stages of the paper.
//!
//! Independent of the harness: the caller provides the validation.
//!
//! # Contents
//! * [`data`]: training data; `self_supervision`: the data of the second stage; `examples`: data according to a
//!   configuration.
//! * [`losses`]: the individual losses; `objective`: all losses of one example.
//! * `initial`: weights before the first step.
//! * [`config`]: a training run as one TOML file; [`parts`]: the trained parts of the network.
//! * [`position`]: stage and step of a training run.
//! * [`optimizer`], [`schedule`]: Adam, gradient clipping, the learning rate.
//! * [`checkpoint`]: saved states of a training run, and exported weights.
//! * [`log`]: a row per step; `stopped`: the inputs of a failed step.
//! * [`trainer`]: the training loop.

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
mod pseudo_views;
pub mod schedule;
mod self_supervision;
mod stopped;
pub mod trainer;
