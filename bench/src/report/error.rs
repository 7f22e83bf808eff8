//! Errors of a report.

use sharp_plots::PlotError;

use crate::evaluate::EvaluateError;
use crate::io::atomic_files::FileError;

/// Every message names the file or unit and the reason, in one line.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The system refused to read or write a file.
    #[error(transparent)]
    File(#[from] FileError),
    /// Two records of one pair and method that do not agree, or a pair with two descriptions.
    #[error("pair '{pair}', method '{method}': {reason}")]
    Conflict {
        pair: String,
        method: String,
        reason: String,
    },
    /// Something that was named is not in the results.
    #[error("{what} '{name}' is not in these runs; they have {known}")]
    Absent {
        /// `metric`, `method`, `pair`, ….
        what: &'static str,
        name: String,
        /// By commas.
        known: String,
    },
    /// A file of a run, or a depth map.
    #[error(transparent)]
    Run(Box<EvaluateError>),
    /// Of another number of methods this figure cannot be made.
    #[error("this figure shows one method: name it with --method")]
    NotOneMethod,
    /// A figure cannot be made.
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
    /// The error about a name that is none of those known.
    pub fn absent<'a>(
        what: &'static str,
        name: &str,
        known: impl Iterator<Item = &'a str>,
    ) -> Self {
        let known: Vec<&str> = known.take(20).collect();
        Self::Absent {
            what,
            name: name.to_owned(),
            known: match known.is_empty() {
                true => "none".to_owned(),
                false => known.join(", "),
            },
        }
    }
}

/// Why there is no picture to show, in a few words that stand in its place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MissingPicture {
    #[error("its dataset's terms do not let it be published")]
    NotPublic,
    #[error("the dataset is not at hand")]
    NoDataset,
    #[error("the prediction was not kept")]
    NotKept,
    /// A file that was exchanged since: the scores beside it are not its own.
    #[error("the kept picture is not the one that was scored")]
    NotScored,
    /// A picture that cannot be read or encoded.
    #[error("{0}")]
    Unusable(String),
    #[error("failed: {0}")]
    Failed(String),
    /// No error map.
    #[error("no {0}")]
    Without(&'static str),
    /// No error map either. Width and height, pixels.
    #[error("the prediction has {} × {} pixels, the target {} × {}", prediction.0, prediction.1, target.0, target.1)]
    Sizes {
        prediction: (u32, u32),
        target: (u32, u32),
    },
}
