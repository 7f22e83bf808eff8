//! Why the harness cannot train.

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

/// Why a training cannot begin or continue.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A value from the command line that the configuration cannot take.
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
    /// The folder holds something else.
    #[error("{}: {reason}", folder.display())]
    OtherFolder { folder: PathBuf, reason: String },
    /// A dataset that is no check of what was learnt.
    #[error("validation dataset '{spec}': {reason}")]
    NotHeldOut { spec: String, reason: String },
    /// A pair without a prediction: means without it could not be compared with the others.
    #[error("pair '{pair}': {reason}")]
    Unpredicted { pair: String, reason: String },
    /// A log that is not as it was written.
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
