//! What is asked for, parsed once, where it comes in: from a command line, a file or a program.

mod dataset;
pub mod error;
pub mod metrics;
mod pairs;
pub mod rendering;
mod run;
mod text;

pub(crate) use dataset::clap_dataset;
pub use dataset::{DatasetConfig, PairOverrides};
pub use error::ConfigError;
pub use metrics::MetricConfig;
pub use pairs::{OverlapConfig, PairConfig};
pub use rendering::RenderingConfig;
pub use run::{Keep, RunConfig};
