use std::path::PathBuf;

use sharp_metrics::weights::{UnknownBackbone, WeightsError};
use sharp_metrics::{Device, SelectionError, Unavailable};

use crate::methods::SpecError;
use crate::pairs::PairError;

/// Why a [`RunConfig`](super::RunConfig) cannot be turned into a run.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The options contradict each other, whatever the files contain.
    #[error("{0}")]
    Usage(String),
    #[error("--metrics {list}: {error}")]
    Selection { list: String, error: SelectionError },
    #[error("--metrics {key}: {reason}")]
    Unavailable { key: String, reason: Unavailable },
    #[error("--device {0}: this build does not include {0}; build with `--features {0}`")]
    NoDevice(Device),
    #[error(
        "--scale-sweep chooses by DISTS, whose network weights are missing; give --weights vgg16=FILE, \
         or see `weights list`"
    )]
    NoChooser,
    #[error("{}: {reason}", path.display())]
    File { path: PathBuf, reason: String },
    #[error(transparent)]
    Backbone(#[from] UnknownBackbone),
    #[error(transparent)]
    Weights(#[from] WeightsError),
    #[error(transparent)]
    Method(#[from] SpecError),
    #[error(transparent)]
    Pairs(#[from] PairError),
}

impl ConfigError {
    /// Whether the user must change the command line or the configuration, rather than the data.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Usage(_) | Self::Selection { .. } | Self::Backbone(_) => true,
            Self::Method(error) => !matches!(error, SpecError::Refused { .. }),
            _ => false,
        }
    }
}
