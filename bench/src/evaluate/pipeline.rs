//! Runs a plan: predicts and renders the pictures of a pair on one thread, scores those of the pair before on the other.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Duration;

use image::RgbImage;

use super::doubts::doubts;
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::gaussian_store::GaussianStore;
use super::keys::Keys;
use super::picture_check::{is_checked, note_change};
use super::predict::{PairWork, Prepared, Reuse, Sources};
use super::record::{Record, Status};
use super::score::{MemoryShares, PairTruth, score_pair};
use super::shard::Shard;
use crate::config::{Keep, RunConfig};
use crate::io::hash::{StableHasher, sha256_hex};
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

/// A pair with its prepared units, or with as many of them as memory takes at once.
struct PreparedPair<'a> {
    truth: Arc<PairTruth<'a>>,
    units: Vec<(String, Prepared)>,
    made: UnitCounts,
}

/// Runs a plan into a folder. Finished units are taken over, recorded failures tried again; a failing pair becomes a
/// record and the others continue.
///
/// While a pair is scored, the next one is predicted, and one step ahead only: the pictures of at most two pairs are in
/// memory, or of two parts of a pair where memory is too small for all methods' pictures. No value depends on it.
pub(super) fn run(
    job: &Job,
    folder: &RunFolder,
    observer: &dyn Observer,
) -> Result<UnitCounts, EvaluateError> {
    let logs = folder.logs_path(job.shard);
    for method in job.methods {
        method.begin(&logs, folder.root());
    }
    // A channel without room: who predicts waits until who scores is ready for it.
    let (sender, pairs) = sync_channel(0);
    let units = job.pairs.len() * job.methods.len();
    let memory = MemoryShares::of(job.options.memory_limit_bytes);
    observer.begin("", units, "units");
    std::thread::scope(|scope| {
        scope.spawn(move || prepare_all(job, folder, &sender, observer));
        let mut counts = UnitCounts::default();
        let mut doubted = BTreeSet::new();
        for pair in pairs {
            let PreparedPair { truth, units, made } = pair?;
            counts.predicted += made.predicted;
            counts.rendered += made.rendered;
            let mut unscored = Vec::new();
            for (method, unit) in units {
                let pair_id = &truth.planned.pair.pair_id;
                observer.progress(counts.units, &format!("{method} {pair_id}"));
                counts.units += 1;
                match unit {
                    Prepared::Done(unit, reuse) => {
                        counts.count(&unit.record, observer);
                        counts.reused += usize::from(reuse == Reuse::Complete);
                    }
                    Prepared::Waiting => counts.waiting += 1,
                    Prepared::Left => counts.left += 1,
                    Prepared::Unscored(mut item) => {
                        let maker = job.methods.iter().find(|m| m.label() == method);
                        if maker.is_some_and(|maker| is_checked(&maker.identity().kind))
                            && let Ok(photograph) = truth.get()
                        {
                            let (record, shown) = (&mut item.unit.record, &item.picture);
                            note_change(record, photograph.image(), shown);
                        }
                        let privilege = maker.map(|maker| maker.privilege()).unwrap_or_default();
                        let mut new = doubts(&item.unit.record, privilege);
                        new.retain(|about, _| {
                            doubted.insert((method.clone(), (*about).to_owned()))
                        });
                        if !new.is_empty() {
                            let texts: Vec<String> = new.into_values().collect();
                            observer.warn(&format!("method '{method}': {}", texts.join("; ")));
                        }
                        unscored.push(*item);
                    }
                }
            }
            if observer.stop() && job.options.keeps_pictures() {
                counts.left += unscored.len();
            } else {
                for unit in score_pair(&truth, unscored, job.scoring, job.keys, memory, folder)? {
                    counts.scored += 1;
                    counts.count(&unit.record, observer);
                }
            }
        }
        counts.left += units - counts.units;
        counts.units = units;
        observer.end();
        Ok(counts)
    })
}

/// Hands over every pair of a plan in order, until one cannot be had, nobody takes them any more or the run is stopped.
fn prepare_all<'a>(
    job: &Job<'a>,
    folder: &RunFolder,
    sender: &SyncSender<Result<PreparedPair<'a>, EvaluateError>>,
    observer: &dyn Observer,
) {
    let runs_at_once = matches!(job.options.stages, Stages::All | Stages::Pictures);
    let kept = job.options.keep_gaussians || !runs_at_once;
    let memory = MemoryShares::of(job.options.memory_limit_bytes);
    let gaussians = kept.then(|| folder.gaussians_path());
    let gaussians = GaussianStore::new(gaussians, folder.root(), memory.gaussians);
    let mut sources = Sources::new(gaussians);
    for planned in &job.pairs {
        if observer.stop() {
            return;
        }
        let mut pair = PairWork::new(job, *planned, folder, observer);
        for methods in job.methods.chunks(memory.pictures_of(planned.target)) {
            let units: Result<Vec<_>, EvaluateError> = methods
                .iter()
                .map(|method| {
                    let prepared = match observer.stop() {
                        true => Prepared::Left,
                        false => pair.prepare(method.as_ref(), &mut sources)?,
                    };
                    Ok((method.label().to_owned(), prepared))
                })
                .collect();
            let failed = units.is_err();
            let prepared = units.map(|units| PreparedPair {
                truth: Arc::clone(&pair.truth),
                units,
                made: std::mem::take(&mut pair.made),
            });
            // An error here: who scores has stopped, and says why itself.
            if sender.send(prepared).is_err() || failed {
                return;
            }
        }
    }
}

/// sha256 of a picture's size and pixels.
pub(super) fn picture_sha256(picture: &RgbImage) -> String {
    StableHasher::default()
        .add("size", &format!("{:?}", picture.dimensions()))
        .add("pixels", &sha256_hex(picture.as_raw()))
        .finish()
}
