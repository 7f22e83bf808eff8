use std::path::PathBuf;

use sharp::model::ModelError;

use crate::checkpoint::StateError;
use crate::data::DataError;
use crate::log::LogError;
use crate::losses::perceptual::PerceptualError;
use crate::objective::ObjectiveError;
use crate::optimizer::OptimizerError;
use crate::position::Position;

/// Errors that end a training run.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    State(#[from] StateError),
    #[error(transparent)]
    Log(#[from] LogError),
    #[error(transparent)]
    Data(#[from] DataError),
    #[error(transparent)]
    Perceptual(#[from] PerceptualError),
    #[error(transparent)]
    Objective(#[from] ObjectiveError),
    #[error(transparent)]
    Optimizer(#[from] OptimizerError),
    #[error("{}: {source}", path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// Predicted depth, a loss or a gradient is NaN or infinite.
    #[error(
        "{position}: {what} of an example is not finite; its views are saved in {}. Inspect them, or start again \
         with a smaller learning rate",
        folder.display()
    )]
    NotFinite {
        position: Position,
        what: &'static str,
        folder: PathBuf,
    },
    /// The caller's validation failed.
    #[error("validation after {position}: {reason}")]
    Validation { position: Position, reason: String },
}
