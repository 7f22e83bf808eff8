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
    #[error(transparent)]
    Folder(#[from] FileError),
    #[error(transparent)]
    Pairs(#[from] PairError),
    /// A dataset of a run cannot be opened again.
    #[error("{spec}, from which the run has its pictures: {reason}{from}")]
    RunDataset {
        spec: String,
        reason: Box<PairError>,
        /// What its path is relative to; empty for an absolute one.
        from: String,
    },
    #[error(
        "dataset '{0}': the manifest does not tell, in a form that this version reads, where its files lay"
    )]
    NoDatasetSpec(String),
    #[error(transparent)]
    Method(#[from] SpecError),
    #[error(transparent)]
    Weights(#[from] WeightsError),
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
    ChosenByMethod { method: String },
    /// The renderer's device failed: the unit stays undone, and the same run continues from there.
    #[error("{method} on {pair_id}: {reason}; finished units are kept, the same command continues")]
    Device {
        pair_id: String,
        method: String,
        reason: String,
    },
    /// The folder's results cannot share a table with this run's.
    #[error(
        "{}: {difference}; a folder has one: choose another folder",
        folder.display()
    )]
    OtherMachine {
        folder: PathBuf,
        /// What differs, with both values.
        difference: String,
    },
    #[error(
        "{}: a run folder of format {found}; this version reads format {expected}: run the command again into a new folder",
        folder.display()
    )]
    Format {
        folder: PathBuf,
        found: u32,
        expected: u32,
    },
    /// A file that was expected to be a bundle.
    #[error("{}: not a bundle of scores: {reason}", path.display())]
    Bundle { path: PathBuf, reason: String },
    /// Folders whose results cannot stand side by side.
    #[error("{} and {} cannot be joined: {difference}", a.display(), b.display())]
    Conflict {
        a: PathBuf,
        b: PathBuf,
        difference: String,
    },
    #[error(transparent)]
    Shard(#[from] ShardError),
    /// The folder does not hold what the command needs.
    #[error("{}: {reason}", folder.display())]
    NotKept {
        folder: PathBuf,
        /// What is missing, and what to do.
        reason: String,
    },
}
