//! Errors of the network.

use std::path::PathBuf;

use sharp_checkpoint::{CheckpointError, Incomplete};

use crate::composer::{ComposerGradientError, DeltaLength};
use crate::image_file::ImageFileError;
use crate::initializer::InitializerError;

/// An error of configuration, weights, input or computation.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    #[error("tensor operation: {0}")]
    Tensor(#[source] candle_core::Error),
    /// A configuration that does not describe a network.
    #[error("configuration {0}")]
    Config(String),
    /// A file that cannot be read or written, or does not hold what it should.
    #[error("{}: {reason}", path.display())]
    File { path: PathBuf, reason: String },
    /// A photograph that is not a complete PNG or JPEG.
    #[error("{}: not an image that can be read: {reason}", path.display())]
    Photograph {
        path: PathBuf,
        #[source]
        reason: ImageFileError,
    },
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A checkpoint that does not fit the configuration, with everything in which it differs.
    #[error(transparent)]
    Incomplete(#[from] Incomplete),
    /// A source that gives a parameter another number of values than it has.
    #[error("parameter {name} has {expected} values, its source gives {found}")]
    Weights {
        name: String,
        expected: usize,
        found: usize,
    },
    /// The picture is not usable.
    #[error("{0}")]
    Image(String),
    /// The network's depth cannot be turned into Gaussians.
    #[error("predicted depth: {0}")]
    Depth(#[from] InitializerError),
    /// The network's deltas do not fit its base Gaussians.
    #[error(transparent)]
    Deltas(#[from] DeltaLength),
    /// The gradient of a pass does not fit what it made.
    #[error(transparent)]
    Gradient(#[from] ComposerGradientError),
    #[error("{0}")]
    Device(String),
    /// An observer's own reason to stop.
    #[error("{0}")]
    Stopped(String),
}

/// An error of ours that candle passed on is itself again.
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
