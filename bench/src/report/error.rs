//! Errors of reports.

use sharp_plots::PlotError;

use crate::evaluate::EvaluateError;
use crate::io::atomic_files::FileError;

/// Why a report cannot be made. Messages are one line and name the file or unit.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Two records of one pair contradict each other.
    #[error("pair '{pair}', method '{method}': {reason}")]
    Conflict {
        pair: String,
        method: String,
        reason: String,
    },
    /// A name that is not in the results.
    #[error("{what} '{name}' is not in these runs; they have {known}")]
    Absent {
        /// Kind of the name: `metric`, `method`, `pair`, ….
        what: &'static str,
        name: String,
        /// Known names, comma-separated.
        known: String,
    },
    /// A file of a run, or a depth map, cannot be read.
    #[error(transparent)]
    Run(Box<EvaluateError>),
    /// The figure needs exactly one method.
    #[error("this figure shows one method: name it with --methods")]
    NotOneMethod,
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// A table could not be written as CSV.
    #[error("a table cannot be encoded: {0}")]
    Encode(#[from] csv::Error),
    /// A template could not be filled in.
    #[error("index.html: {0}")]
    Page(#[from] askama::Error),
}

impl From<EvaluateError> for ReportError {
    fn from(error: EvaluateError) -> Self {
        Self::Run(Box::new(error))
    }
}

impl ReportError {
    pub fn absent<'a>(
        what: &'static str,
        name: &str,
        known: impl Iterator<Item = &'a str>,
    ) -> Self {
        let known: Vec<&str> = known.take(20).collect();
        Self::Absent {
            what,
            name: name.to_owned(),
            known: if known.is_empty() {
                "none".to_owned()
            } else {
                known.join(", ")
            },
        }
    }
}

/// Why a picture is missing, as a short text shown in its place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MissingPicture {
    #[error("its dataset's terms do not allow it to be published")]
    NotPublic,
    #[error("the dataset is not available")]
    NoDataset,
    #[error("the prediction was not kept")]
    NotKept,
    /// The file was replaced after scoring.
    #[error("the kept picture is not the one that was scored")]
    NotScored,
    /// The picture cannot be read or encoded.
    #[error("{0}")]
    Unusable(String),
    #[error("failed: {0}")]
    Failed(String),
    /// An input of the error map is missing.
    #[error("no {0}")]
    Without(&'static str),
    /// The pictures of an error map have different sizes: width and height, in pixels.
    #[error("the prediction has {} × {} pixels, but the target has {} × {}", prediction.0, prediction.1, target.0, target.1)]
    Sizes {
        prediction: (u32, u32),
        target: (u32, u32),
    },
}
