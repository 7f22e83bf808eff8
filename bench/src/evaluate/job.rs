//! The input of the pipeline, and the counts of units that it returns.

use std::collections::BTreeSet;
use std::time::Duration;

use super::keys::Keys;
use super::picture_check::sample::PictureSample;
use super::record::{Record, Status};
use super::shard::Shard;
use crate::config::{Keep, RunConfig};
use crate::io::observer::Observer;
use crate::methods::Method;
use crate::pairs::pair_list::ResolvedPair;
use crate::rendering::SharedRenderer;
use crate::scoring::Scoring;

/// Stages of a run to execute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Stages {
    /// All stages
    #[default]
    All,
    /// Only predict, and keep the predictions and predicted pictures
    Predict,
    /// Render pictures from kept predictions and keep them
    Render,
    /// Predict and render without scoring, e.g. on the machine with the GPU
    Pictures,
    /// Score kept pictures
    Score,
}

impl Stages {
    /// Whether units have scores after these stages.
    pub fn scores(self) -> bool {
        matches!(self, Self::All | Self::Score)
    }
}

/// Default of [`RunOptions::memory_limit_bytes`].
pub const MEMORY_LIMIT_BYTES: u64 = 2 << 30;

#[derive(Debug, Clone, Copy)]
pub struct RunOptions {
    pub stages: Stages,
    pub keep: Keep,
    pub keep_gaussians: bool,
    /// Memory limit, in bytes. A share of it is for the Gaussians of a source; Gaussians beyond it are stored on disk.
    /// Another share is for the pictures of a pair; if they need more, they are made and scored in batches of at least
    /// one picture. The memory of the networks is not included.
    pub memory_limit_bytes: u64,
}

impl Default for RunOptions {
    fn default() -> Self {
        Self {
            stages: Stages::All,
            keep: Keep::All,
            keep_gaussians: false,
            memory_limit_bytes: MEMORY_LIMIT_BYTES,
        }
    }
}

impl From<&RunConfig> for RunOptions {
    fn from(config: &RunConfig) -> Self {
        Self {
            keep: config.keep.unwrap_or_default(),
            keep_gaussians: config.keep_gaussians,
            ..Self::default()
        }
    }
}

impl RunOptions {
    pub(super) fn keeps_pictures(&self) -> bool {
        self.keep != Keep::None || self.stages != Stages::All
    }
}

pub(super) struct Job<'a> {
    /// Pairs sorted by id.
    pub(super) pairs: Vec<ResolvedPair<'a>>,
    /// Names of the sources whose Gaussian files are also read with other settings and rendered, to find wrong
    /// settings.
    pub(super) checked: BTreeSet<String>,
    pub(super) sample: PictureSample<'a>,
    pub(super) methods: &'a [Box<dyn Method>],
    pub(super) scoring: &'a Scoring,
    pub(super) renderer: &'a SharedRenderer,
    pub(super) keys: &'a Keys,
    pub(super) options: RunOptions,
    /// Monotonic clock, of which only differences matter; tests replace it.
    pub(super) clock: fn() -> Duration,
    /// The executed shard, which has its own logs.
    pub(super) shard: Shard,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct UnitCounts {
    pub units: usize,
    /// Units that were already complete.
    pub reused: usize,
    /// Number of predictions: one per source for methods that predict Gaussians, one per pair for
    /// other methods.
    pub predicted: usize,
    pub rendered: usize,
    pub scored: usize,
    pub failed: usize,
    pub waiting: usize,
    /// Units that were not reached, or not scored, before the run was stopped.
    pub left: usize,
}

impl UnitCounts {
    /// Counts a recorded failure.
    pub(super) fn count(&mut self, record: &Record, observer: &dyn Observer) {
        if record.status != Status::Ok {
            self.failed += 1;
            observer.failed();
        }
    }
}
