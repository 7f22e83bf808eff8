//! The configuration of a run, parsed once from a command line, a file or a program.
//!
//! * [`RunConfig`]: the whole configuration; [`metrics`], `pairs`, [`rendering`]: parts that other commands share.

pub mod error;
pub mod metrics;
mod pairs;
pub mod rendering;
mod run;
mod text;

pub use error::ConfigError;
pub use metrics::MetricConfig;
pub use pairs::{OverlapConfig, PairConfig};
pub use rendering::RenderingConfig;
pub use run::{Keep, RunConfig};
