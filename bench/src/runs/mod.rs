//! Runs: from a plan to a folder of durable results.
//!
//! * [`plan`]: which pairs, which methods, which metrics.
//! * [`mod@unit`]: the key of a unit, a hash of all that its value depends on.
//! * [`device_class`]: on what kind of device the networks behind the metrics were computed.
//! * [`store`]: the run folder; one file a unit, written atomically.
//! * [`manifest`]: what was run, said once.
//! * [`identity`]: whether two runs may share a column.
//! * [`metric_facts`]: what a metric column was computed with.
//! * [`execute`]: predicts and scores what is not done yet, one unit ahead of the other, and records it.
//! * [`error`]: why a run stops.
//! * `region`: scoring on a part of the target.
//! * [`scores`]: the table `scores.csv`.

pub mod device_class;
pub mod error;
pub mod execute;
pub mod identity;
pub mod manifest;
pub mod metric_facts;
pub mod plan;
mod predict;
mod region;
pub mod scores;
pub mod store;
pub mod unit;
