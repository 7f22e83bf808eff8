use std::path::PathBuf;

use sharp_datasets::DatasetError;
use sharp_train::config::ConfigError;
use sharp_train::trainer::TrainingError;

use crate::evaluate::EvaluateError;
use crate::io::atomic_files::FileError;
use crate::io::checkpoint::NetworkError;
use crate::methods::MethodError;
use crate::pairs::PairError;
use crate::report::ReportError;

/// Why a training run cannot start or continue.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The configuration does not accept a value from the command line.
    #[error("--set {set}: {reason}")]
    Set { set: String, reason: String },
    #[error(transparent)]
    Training(#[from] TrainingError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Pairs(#[from] PairError),
    #[error(transparent)]
    Evaluate(Box<EvaluateError>),
    #[error(transparent)]
    Report(Box<ReportError>),
    #[error(transparent)]
    Method(#[from] MethodError),
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The folder contains something other than this training run.
    #[error("{}: {reason}", folder.display())]
    OtherFolder { folder: PathBuf, reason: String },
    /// The validation dataset overlaps the training data.
    #[error("validation dataset '{spec}': {reason}")]
    NotHeldOut { spec: String, reason: String },
    /// A pair has no prediction, so means would not be comparable with the means of other
    /// validations.
    #[error("pair '{pair}': {reason}")]
    Unpredicted { pair: String, reason: String },
    /// A log was modified or damaged.
    #[error("{}: {reason}", path.display())]
    Log { path: PathBuf, reason: String },
}

impl From<EvaluateError> for TrainError {
    fn from(error: EvaluateError) -> Self {
        Self::Evaluate(Box::new(error))
    }
}

impl From<ReportError> for TrainError {
    fn from(error: ReportError) -> Self {
        Self::Report(Box::new(error))
    }
}
