//! What can go wrong while a report is made.

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
        /// The pair's id.
        pair: String,
        /// The method's label.
        method: String,
        /// What differs.
        reason: String,
    },
    /// Two columns, methods or datasets of the same name were asked for.
    #[error("{what} '{name}' is given twice")]
    Repeated {
        /// `metric`, `method` or `dataset`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// An option outside its range.
    #[error("{option} = {value}: {reason}")]
    Option {
        /// Its name.
        option: &'static str,
        /// What was given.
        value: String,
        /// What would be right.
        reason: &'static str,
    },
    /// The drawing library refused.
    #[error("plot '{plot}': {reason}")]
    Plot {
        /// The plot's title.
        plot: String,
        /// What it said.
        reason: String,
    },
    /// A picture could not be encoded.
    #[error("{what}: cannot encode the picture: {reason}")]
    Encode {
        /// Which picture.
        what: String,
        /// What the encoder said.
        reason: String,
    },
}
