//! Errors of preparing, running and reading evaluations.

use std::path::PathBuf;

use sharp::render::RenderError;
use sharp_metrics::WeightsError;

use super::shard::ShardError;
use crate::io::atomic_files::FileError;
use crate::methods::SpecError;
use crate::pairs::PairError;

/// Why an evaluation stopped early. Finished units are kept.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    #[error(transparent)]
    Folder(#[from] FileError),
    #[error(transparent)]
    Pairs(#[from] PairError),
    /// A dataset of a run cannot be reopened.
    #[error("cannot read the run's pictures from {spec}: {reason}{from}")]
    RunDataset {
        spec: String,
        reason: Box<PairError>,
        /// The folder to which a relative path was resolved; empty for an absolute path.
        from: String,
    },
    #[error(
        "dataset '{0}': the manifest does not say where the dataset's files are, or says it in a form that this version of \
         sharp-bench cannot read"
    )]
    NoDatasetSpec(String),
    #[error(transparent)]
    Method(#[from] SpecError),
    #[error(transparent)]
    Weights(#[from] WeightsError),
    #[error(transparent)]
    Renderer(#[from] RenderError),
    /// Two methods have the same label.
    #[error("two methods have the label '{0}'; give one of them another label with label=NAME")]
    RepeatedLabel(String),
    /// The pairs were selected with depth that this method's checkpoint predicted.
    #[error(
        "the pairs were selected with depth predicted by the checkpoint of method '{method}'; \
         select them with other depth, such as --overlap-depth DIR"
    )]
    ChosenByMethod { method: String },
    /// The renderer's device failed. The unit is not recorded, so that the same command resumes with it.
    #[error(
        "{method} on {pair_id}: {reason}; finished units are kept; run the same command again to continue"
    )]
    Device {
        pair_id: String,
        method: String,
        reason: String,
    },
    /// This run's results cannot be added to those in the folder.
    #[error(
        "{}: {difference}; all results in a folder must agree in this, so choose another folder",
        folder.display()
    )]
    OtherMachine {
        folder: PathBuf,
        /// A sentence on the difference, with both values.
        difference: String,
    },
    #[error(
        "{}: a run folder of format {found}, but this version reads format {expected}; run the \
         command again with a new folder",
        folder.display()
    )]
    Format {
        folder: PathBuf,
        found: u32,
        expected: u32,
    },
    /// A file that should be a bundle but is not one, or is damaged.
    #[error("{}: not a bundle of scores: {reason}", path.display())]
    Bundle { path: PathBuf, reason: String },
    /// Several folders are to be joined, but no output folder is given.
    #[error("to join several folders, give the folder for the result with --out FOLDER")]
    NoOutput,
    /// Results of two folders contradict each other and cannot be shown together.
    #[error("{} and {} cannot be joined: {difference}", a.display(), b.display())]
    Conflict {
        a: PathBuf,
        b: PathBuf,
        difference: String,
    },
    #[error(transparent)]
    Shard(#[from] ShardError),
    /// Something that the command needs is missing in the folder.
    #[error("{}: {reason}", folder.display())]
    NotKept {
        folder: PathBuf,
        /// What is missing, and what to do about it.
        reason: String,
    },
}
