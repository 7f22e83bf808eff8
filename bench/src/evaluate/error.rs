//! Why an evaluation cannot be prepared, run or read.

use std::path::PathBuf;

use sharp::render::RenderError;
use sharp_metrics::WeightsError;

use super::shard::ShardError;
use crate::io::atomic_files::FileError;
use crate::methods::SpecError;
use crate::pairs::PairError;

/// Why an evaluation stopped before its end. What was finished is kept.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// The run folder cannot be read or written.
    #[error(transparent)]
    Folder(#[from] FileError),
    /// Datasets or pair lists.
    #[error(transparent)]
    Pairs(#[from] PairError),
    /// A dataset that a run was made from.
    #[error("{spec}, from which the run has its pictures: {reason}{from}")]
    RunDataset {
        /// As it was given to the run.
        spec: String,
        reason: Box<PairError>,
        /// What its path is relative to; empty for an absolute one.
        from: String,
    },
    #[error(
        "dataset '{0}': the manifest does not tell, in a form that this version reads, where its files lay"
    )]
    NoDatasetSpec(String),
    /// A method's options.
    #[error(transparent)]
    Method(#[from] SpecError),
    /// The weights of a metric.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The renderer cannot be opened.
    #[error(transparent)]
    Renderer(#[from] RenderError),
    /// Two methods have one label.
    #[error("the label '{0}' is taken; give one of them label=NAME")]
    RepeatedLabel(String),
    /// The method chose the pairs that it would be judged on.
    #[error(
        "the pairs were chosen by the depth of the checkpoint that method '{method}' is evaluated with; choose them by \
         other depth, such as --overlap-depth DIR"
    )]
    ChosenByMethod {
        /// Its label.
        method: String,
    },
    /// The renderer's device failed: the unit stays undone, and the same run continues from there.
    #[error("{method} on {pair_id}: {reason}; finished units are kept, the same command continues")]
    Device {
        /// The pair of the unit.
        pair_id: String,
        /// Its method.
        method: String,
        /// What the device said.
        reason: String,
    },
    /// The folder's results came from a machine that computes differently.
    #[error(
        "{}: {difference}; a folder has one: choose another folder",
        folder.display()
    )]
    OtherMachine {
        /// The run folder.
        folder: PathBuf,
        /// What differs, with both values.
        difference: String,
    },
    /// A folder of another version.
    #[error(
        "{}: a run folder of format {found}; this version reads format {expected}: run the command again into a new folder",
        folder.display()
    )]
    Format {
        /// The run folder.
        folder: PathBuf,
        /// Its format.
        found: u32,
        /// [`super::manifest::FORMAT`].
        expected: u32,
    },
    /// A file that is taken for a bundle.
    #[error("{}: not a bundle of scores: {reason}", path.display())]
    Bundle {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Folders whose results cannot stand side by side.
    #[error("{} and {} cannot be joined: {difference}", a.display(), b.display())]
    Conflict {
        /// One folder.
        a: PathBuf,
        /// The other.
        b: PathBuf,
        /// The first difference.
        difference: String,
    },
    /// A number of shards that cannot be.
    #[error(transparent)]
    Shard(#[from] ShardError),
    /// What is there does not suffice for what is asked.
    #[error("{}: {reason}", folder.display())]
    NotKept {
        /// The run folder.
        folder: PathBuf,
        /// What is missing, and what to do.
        reason: String,
    },
}
