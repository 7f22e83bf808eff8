//! What a pipeline is given, and what it counts.

use std::collections::BTreeSet;
use std::time::Duration;

use super::keys::Keys;
use super::record::{Record, Status};
use super::shard::Shard;
use crate::config::{Keep, RunConfig};
use crate::io::observer::Observer;
use crate::methods::Method;
use crate::pairs::pair_list::ResolvedPair;
use crate::rendering::SharedRenderer;
use crate::scoring::Scoring;

/// Stages of a run to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Stages {
    /// All of them
    #[default]
    All,
    /// Predictions of sources alone; they and predicted pictures are kept
    Predict,
    /// Pictures from kept predictions; they are kept
    Render,
    /// Both of these, for a machine that has the network's device and shall not score
    Pictures,
    /// Scores of kept pictures
    Score,
}

impl Stages {
    /// True if units have their scores after it.
    pub fn scores(self) -> bool {
        matches!(self, Self::All | Self::Score)
    }
}

/// Default of [`RunOptions::memory_limit_bytes`].
pub const MEMORY_LIMIT_BYTES: u64 = 2 << 30;

/// Options that change no result.
#[derive(Debug, Clone, Copy)]
pub struct RunOptions {
    /// Which stages are done.
    pub stages: Stages,
    /// Which pictures are kept.
    pub keep: Keep,
    /// Whether predictions of sources are kept.
    pub keep_gaussians: bool,
    /// Memory that is kept within, bytes: Gaussians of a source beyond their share wait on disk, and predictions of a pair
    /// are made and scored in parts. What networks take of their own is not counted, and one picture is the least.
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

/// Input of a pipeline.
pub(super) struct Job<'a> {
    /// In the order of their ids.
    pub(super) pairs: Vec<ResolvedPair<'a>>,
    /// Sources for which other readings of their Gaussians are tried.
    pub(super) checked: BTreeSet<String>,
    pub(super) methods: &'a [Box<dyn Method>],
    pub(super) scoring: &'a Scoring,
    pub(super) renderer: &'a SharedRenderer,
    pub(super) keys: &'a Keys,
    pub(super) options: RunOptions,
    /// Monotonic time; only differences matter. Tests plant their own.
    pub(super) clock: fn() -> Duration,
    /// The part of a plan that it is, where that has several: their logs lie apart.
    pub(super) shard: Shard,
}

/// Counts of a run's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct UnitCounts {
    /// Units of the plan.
    pub units: usize,
    /// Units whose stored result was complete.
    pub reused: usize,
    /// Predictions that were made: of a source for methods that make Gaussians, else of a pair.
    pub predicted: usize,
    /// Renderings that were made.
    pub rendered: usize,
    /// Units that got scores.
    pub scored: usize,
    /// Units that are recorded failures.
    pub failed: usize,
    /// Units that wait for another stage.
    pub waiting: usize,
    /// Units that were not come to, or not scored yet, when the run was stopped.
    pub left: usize,
}

impl UnitCounts {
    /// Counts a record that says why there is no score.
    pub(super) fn count(&mut self, record: &Record, observer: &dyn Observer) {
        if record.status != Status::Ok {
            self.failed += 1;
            observer.failed();
        }
    }
}
