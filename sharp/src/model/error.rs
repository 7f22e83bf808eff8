//! Errors of the network.

use std::path::PathBuf;

use sharp_checkpoint::{CheckpointError, Incomplete};

use crate::composer::{ComposerGradientError, DeltaLength};
use crate::image_file::ImageFileError;
use crate::initializer::InitializerError;

/// An error in configuration, weights, input or computation.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    #[error("tensor operation: {0}")]
    Tensor(#[source] candle_core::Error),
    /// The configuration is invalid.
    #[error("configuration {0}")]
    Config(String),
    /// A file cannot be read or written, or has unexpected content.
    #[error("{}: {reason}", path.display())]
    File { path: PathBuf, reason: String },
    /// A photograph cannot be decoded completely.
    #[error("{}: not an image that can be read: {reason}", path.display())]
    Photograph {
        path: PathBuf,
        #[source]
        reason: ImageFileError,
    },
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The checkpoint does not fit the configuration; lists all differences.
    #[error(transparent)]
    Incomplete(#[from] Incomplete),
    /// A weight source returned the wrong number of values for a parameter.
    #[error("parameter {name} has {expected} values, but the weight source returned {found}")]
    Weights {
        name: String,
        expected: usize,
        found: usize,
    },
    /// The picture cannot be used as input, for the given reason.
    #[error("{0}")]
    Image(String),
    /// The network's depth cannot be converted to Gaussians.
    #[error(
        "predicted depth: {0} (`sharp-bench weights check FILE` counts weights that are not finite)"
    )]
    Depth(#[from] InitializerError),
    /// A weight is NaN or infinite, so that the prediction is unusable.
    #[error(
        "{broken} of {count} predicted Gaussians are not finite: the checkpoint's weights are broken (`sharp-bench weights \
         check FILE` counts those that are not finite)"
    )]
    NotFinite { broken: usize, count: usize },
    /// The number of deltas does not match the base Gaussians.
    #[error(transparent)]
    Deltas(#[from] DeltaLength),
    /// The gradient of a pass does not match the pass's outputs.
    #[error(transparent)]
    Gradient(#[from] ComposerGradientError),
    #[error("{0}")]
    Device(String),
    /// The observer stopped the prediction; holds the observer's reason.
    #[error("{0}")]
    Stopped(String),
}

/// Unwraps a [`ModelError`] that was passed through candle.
impl From<candle_core::Error> for ModelError {
    fn from(error: candle_core::Error) -> Self {
        use candle_core::Error::WrappedContext;
        match error {
            WrappedContext { wrapped, context } => match wrapped.downcast() {
                Ok(ours) => *ours,
                Err(wrapped) => Self::Tensor(WrappedContext { wrapped, context }),
            },
            other => Self::Tensor(other),
        }
    }
}

impl From<ModelError> for candle_core::Error {
    fn from(error: ModelError) -> Self {
        Self::WrappedContext {
            wrapped: Box::new(error),
            context: String::new(),
        }
    }
}

impl ModelError {
    pub fn file(path: impl Into<PathBuf>, reason: impl ToString) -> Self {
        Self::File {
            path: path.into(),
            reason: reason.to_string(),
        }
    }
}
