//! What a run is asked to do, parsed once, from a command line, a file or a program.
//!
//! * [`RunConfig`]: all of it; [`metrics`], `pairs`, [`rendering`]: its parts that other commands take, too.

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
