//! Runs a plan: predicts and renders the pictures of a pair on one thread, scores those of the pair before on the other.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Duration;

use image::RgbImage;
use sharp::render::{RenderError, RenderOutput};
use sharp_datasets::{DepthMap, View};
use sharp_metrics::Picture;

use super::doubts::doubts;
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::gaussian_store::{GaussianStore, StoreError};
use super::keys::{Keys, PictureKeys};
use super::manifest::FORMAT;
use super::picture_check::{is_checked, note_change};
use super::record::{ChosenScale, Record, Status};
use super::render::{depth_scale, render};
use super::score::{MemoryShares, PairTruth, Unscored, crop, empty_record, missing, score_pair};
use super::shard::Shard;
use super::source_check::{CheckedSource, SourceFacts, absurd_coverage, check_source, source_of};
use super::unit::{ScoredPicture, Slot, Timing, Unit};
use crate::config::{Keep, RunConfig};
use crate::io::hash::{StableHasher, file_sha256, sha256_hex};
use crate::io::machine::{cpu_and_threads, peak_bytes};
use crate::io::observer::Observer;
use crate::io::pictures::{read_rgb8, to_rgb8};
use crate::io::rendering_files::{write_exr, write_png};
use crate::io::text::reason_line;
use crate::methods::{
    Approach, GaussianPrediction, Method, MethodError, PicturePrediction, Privilege, SourceView,
    TargetCamera,
};
use crate::pairs::PosedCamera;
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
    fn keeps_pictures(&self) -> bool {
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

/// A unit on its way from the predicting to the scoring thread.
enum Prepared {
    /// Nothing is left to do, or it failed.
    Done(Box<Unit>, Reuse),
    /// To be scored.
    Unscored(Box<Unscored>),
    /// Another stage has to come first or afterwards.
    Waiting,
    /// The run was stopped before.
    Left,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Reuse {
    Complete,
    New,
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
    let mut sources = Sources {
        gaussians: GaussianStore::new(
            kept.then(|| folder.gaussians_path()),
            folder.root(),
            memory.gaussians,
        ),
        photograph: None,
        depth: None,
        scale: None,
        check: None,
    };
    for planned in &job.pairs {
        if observer.stop() {
            return;
        }
        let mut pair = PairWork {
            job,
            observer,
            folder,
            source: planned.source.into(),
            target: planned.target.into(),
            truth: Arc::new(PairTruth::new(*planned)),
            made: UnitCounts::default(),
        };
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

/// Data shared by the pairs of one source, which are adjacent because pairs are sorted.
struct Sources<'a> {
    gaussians: GaussianStore,
    photograph: Option<(&'a View, RgbImage)>,
    depth: Option<(&'a View, Option<DepthMap>)>,
    /// By the key of the prediction.
    scale: Option<(String, Result<f64, String>)>,
    /// By the key of the prediction.
    check: Option<(String, SourceFacts)>,
}

impl<'a> Sources<'a> {
    fn photograph(&mut self, view: &'a View) -> Result<&RgbImage, MethodError> {
        cached(&mut self.photograph, view, || Ok(view.content.image()?))
    }

    fn depth(&mut self, view: &'a View) -> Result<Option<&DepthMap>, MethodError> {
        let depth = cached(&mut self.depth, view, || Ok(view.content.depth()?))?;
        Ok(depth.as_ref())
    }
}

fn cached<'c, 'a, T>(
    slot: &'c mut Option<(&'a View, T)>,
    view: &'a View,
    read: impl FnOnce() -> Result<T, MethodError>,
) -> Result<&'c T, MethodError> {
    let is_it = slot
        .as_ref()
        .is_some_and(|(last, _)| std::ptr::eq(*last, view));
    if !is_it {
        *slot = None;
    }
    match slot {
        Some((_, value)) => Ok(value),
        None => Ok(&slot.insert((view, read()?)).1),
    }
}

/// Why there is no picture.
enum Failure {
    /// It becomes the unit's record.
    Pair(String),
    /// It ends the run.
    Run(EvaluateError),
    /// A kept prediction that this stage needs is missing.
    Waiting,
}

/// Refuses a picture that must not be kept: values that rounding to 8 bit would hide, another size than asked for.
fn check(prediction: &PicturePrediction, target: (u32, u32)) -> Result<(), MethodError> {
    let refused = |reason: String| MethodError::Model(format!("the prediction {reason}"));
    let checked = prediction.picture.check();
    checked.map_err(|error| refused(format!("cannot be used: {error}")))?;
    let (of, asked) = match prediction.region {
        None => ("the target", target),
        Some(region) => ("its part of the target", (region.width, region.height)),
    };
    let (width, height) = prediction.picture.dimensions();
    if (width, height) != asked {
        let (w, h) = asked;
        return Err(refused(format!("is {width}x{height} but {of} is {w}x{h}")));
    }
    Ok(())
}

impl From<MethodError> for Failure {
    fn from(error: MethodError) -> Self {
        Self::Pair(error.to_string())
    }
}

/// A picture as a method made it.
struct Made {
    prediction: PicturePrediction,
    warnings: BTreeMap<String, String>,
    scale: Option<ChosenScale>,
    rendering: Option<RenderOutput>,
    predict_secs: f64,
    render_secs: f64,
    /// See [`Timing::inference`].
    inference: Option<String>,
}

/// Work on one pair in the predicting thread.
struct PairWork<'j, 'a> {
    job: &'j Job<'a>,
    observer: &'j dyn Observer,
    folder: &'j RunFolder,
    source: PosedCamera,
    target: PosedCamera,
    truth: Arc<PairTruth<'a>>,
    made: UnitCounts,
}

impl<'a> PairWork<'_, 'a> {
    /// Takes over what is stored, or makes the picture.
    fn prepare(
        &mut self,
        method: &dyn Method,
        sources: &mut Sources<'a>,
    ) -> Result<Prepared, EvaluateError> {
        let job = self.job;
        let planned = self.truth.planned;
        let slot = job.keys.slot(method, &planned);
        let keys = job.keys.picture(method, &planned);
        let stored = self.folder.load(&slot)?;
        let stored = stored
            .filter(|unit| unit.picture_key == keys.picture)
            .and_then(Unit::scorable);
        if let Some(unit) = stored {
            let unit = self.refreshed(method, unit)?;
            let renders = matches!(method.approach(), Approach::Gaussians(_));
            let has_picture = self.folder.has_picture(&unit)
                && (job.options.keep != Keep::Float || !renders || self.folder.has_float(&unit));
            let is_scored = missing(&unit, job.scoring, job.keys, &planned).is_empty();
            if is_scored && (has_picture || job.options.keep == Keep::None) {
                return Ok(Prepared::Done(Box::new(unit), Reuse::Complete));
            }
            if has_picture {
                if !job.options.stages.scores() {
                    return Ok(Prepared::Waiting);
                }
                let Slot {
                    method, pair_id, ..
                } = &unit.slot;
                let path = self.folder.prediction_path(method, pair_id, "png");
                if let Ok(picture) = read_rgb8(&path) {
                    let unscored = Unscored { unit, picture };
                    return Ok(Prepared::Unscored(Box::new(unscored)));
                }
            }
        }
        if job.options.stages == Stages::Score {
            return Ok(Prepared::Waiting);
        }
        let made = self.make(method, &keys, sources);
        let changed = job.keys.changed(Some(method), &planned);
        let made = match (made, changed) {
            (Ok(Some(_)), Some(reason)) => Err(Failure::Pair(reason)),
            (made, _) => made,
        };
        let mut unit = Unit {
            format: FORMAT,
            checksum: String::new(),
            slot,
            picture_key: keys.picture,
            record: Record {
                files: job.keys.pair_files(method, &planned),
                ..empty_record(&planned, method.label())
            },
            picture: None,
            scores: Default::default(),
            timing: Timing {
                machine: cpu_and_threads(),
                peak_bytes: peak_bytes(),
                ..Timing::default()
            },
        };
        match made {
            Ok(None) | Err(Failure::Waiting) => Ok(Prepared::Waiting),
            Err(Failure::Run(error)) => Err(error),
            Err(Failure::Pair(reason)) => {
                unit.record.status = Status::Failed {
                    reason: reason_line(&reason),
                };
                let unit = self.folder.save(unit)?;
                Ok(Prepared::Done(Box::new(unit), Reuse::New))
            }
            Ok(Some(made)) => {
                let picture = self.keep(&mut unit, made)?;
                Ok(match job.options.stages.scores() {
                    false => Prepared::Waiting,
                    true => Prepared::Unscored(Box::new(Unscored { unit, picture })),
                })
            }
        }
    }

    /// A stored unit with what the pair list says of its pair now.
    fn refreshed(&self, method: &dyn Method, mut unit: Unit) -> Result<Unit, EvaluateError> {
        let now = empty_record(&self.truth.planned, &unit.slot.method);
        let refreshed = Record {
            cluster: now.cluster,
            baseline_m: now.baseline_m,
            rotation_deg: now.rotation_deg,
            median_depth_m: now.median_depth_m,
            overlap: now.overlap,
            files: self.job.keys.pair_files(method, &self.truth.planned),
            ..unit.record.clone()
        };
        // Scores by metrics that this run does not compute would stay those of the files before.
        if refreshed.files != unit.record.files {
            unit.scores.clear();
        }
        if refreshed == unit.record {
            return Ok(unit);
        }
        unit.record = refreshed;
        Ok(self.folder.save(unit)?)
    }

    /// Records what was made, and keeps it where that is asked for before anything else is done: a run that is killed
    /// while it scores predicts nothing again.
    fn keep(&self, unit: &mut Unit, made: Made) -> Result<RgbImage, EvaluateError> {
        let prediction = made.prediction;
        let picture = match prediction.picture {
            Picture::Rgb8(image) => image,
            Picture::RgbF32(image) => to_rgb8(&image),
        };
        unit.record.crop = crop(prediction.region, self.target.size());
        unit.record.resized_from = prediction.resized_from;
        unit.record.scale = made.scale;
        unit.timing.predict_secs = made.predict_secs;
        unit.timing.render_secs = made.render_secs;
        unit.timing.inference = made.inference;
        unit.record.extras = prediction.extras;
        unit.record.warnings = made.warnings;
        for note in prediction.notes {
            // Of each kind, which its first words tell, a table shows one.
            let about = note.split(' ').take(4).collect::<Vec<_>>().join(" ");
            let id = &self.truth.planned.pair.pair_id;
            unit.record
                .warnings
                .insert(about, format!("its pictures: {note} ({id})"));
        }
        let mut scored = ScoredPicture {
            sha256: picture_sha256(&picture),
            file_sha256: None,
            float_sha256: None,
        };
        let Slot {
            method, pair_id, ..
        } = &unit.slot;
        let path = |extension| self.folder.prediction_path(method, pair_id, extension);
        if self.job.options.keeps_pictures() {
            write_png(&path("png"), &picture)?;
            scored.file_sha256 = Some(file_sha256(&path("png"))?);
        }
        if let (Keep::Float, Some(rendering)) = (self.job.options.keep, &made.rendering) {
            write_exr(&path("exr"), rendering)?;
            scored.float_sha256 = Some(file_sha256(&path("exr"))?);
        }
        unit.picture = Some(scored);
        if self.job.options.keeps_pictures() {
            *unit = self.folder.save(unit.clone())?;
        }
        Ok(picture)
    }

    /// The picture of a method; `None` where this stage stops before it.
    fn make(
        &mut self,
        method: &dyn Method,
        keys: &PictureKeys,
        sources: &mut Sources<'a>,
    ) -> Result<Option<Made>, Failure> {
        let stages = self.job.options.stages;
        let view = self.truth.planned.source;
        let pair_id = &self.truth.planned.pair.pair_id;
        let plain = |prediction: PicturePrediction, predict_secs: f64| Made {
            prediction,
            warnings: BTreeMap::new(),
            scale: None,
            rendering: None,
            predict_secs,
            render_secs: 0.0,
            inference: None,
        };
        let target = TargetCamera::new(pair_id, &self.target);
        let name = source_of(pair_id);
        let made = match method.approach() {
            Approach::Gaussians(_) => return self.splat(method, name, keys, sources),
            _ if stages == Stages::Render => return Err(Failure::Waiting),
            Approach::Target => {
                let truth = self.truth.get().map_err(Failure::Pair)?;
                plain(truth.image().clone().into(), 0.0)
            }
            Approach::Pictures(pictures) => {
                let depth = match method.privilege() {
                    Privilege::SourceDepth => sources.depth(view)?.cloned(),
                    _ => None,
                };
                let image = sources.photograph(view)?;
                let source = SourceView::new(name, &self.source, image, depth.as_ref());
                let (prediction, secs) = self.timed(|| pictures.predict(&source, &target));
                let prediction = prediction?;
                check(&prediction, target.size())?;
                plain(prediction, secs)
            }
            Approach::Scales(sweep) => {
                let image = sources.photograph(view)?;
                let source = SourceView::new(name, &self.source, image, None);
                let (candidates, secs) = self.timed(|| sweep.predict(&source, &target));
                let mut candidates = candidates?;
                let tried = candidates.len();
                let truth = self.truth.get().map_err(Failure::Pair)?;
                let pictures: Vec<_> = candidates
                    .iter()
                    .map(|c| (c.scale, &c.prediction.picture, c.prediction.region))
                    .collect();
                let best = sweep.chooser().best(truth, &pictures);
                let best = best.map_err(|reason| Failure::Pair(format!("{pair_id}: {reason}")))?;
                let best = candidates.swap_remove(best);
                Made {
                    scale: Some(ChosenScale {
                        best: best.scale,
                        tried,
                    }),
                    ..plain(best.prediction, secs)
                }
            }
        };
        self.made.predicted += 1;
        Ok(Some(made))
    }

    /// The rendering of a method that makes Gaussians.
    fn splat(
        &mut self,
        method: &dyn Method,
        name: &str,
        keys: &PictureKeys,
        sources: &mut Sources<'a>,
    ) -> Result<Option<Made>, Failure> {
        let Approach::Gaussians(gaussians) = method.approach() else {
            return Ok(None);
        };
        let stages = self.job.options.stages;
        let view = self.truth.planned.source;
        let predicted = std::cell::Cell::new(0);
        let depth = match method.privilege() {
            Privilege::None => None,
            _ => sources.depth(view)?.cloned(),
        };
        let prediction = if stages == Stages::Render {
            sources.gaussians.get(&keys.predict, name, None)
        } else {
            // The photograph is only read where a prediction is made.
            let photograph = std::cell::RefCell::new(&mut sources.photograph);
            let predict = || {
                predicted.set(1);
                let mut photograph = photograph.borrow_mut();
                let image = cached(&mut photograph, view, || Ok(view.content.image()?))?;
                let seen = depth
                    .as_ref()
                    .filter(|_| method.privilege() == Privilege::SourceDepth);
                let source = SourceView::new(name, &self.source, image, seen);
                let (made, secs) = self.timed(|| gaussians.predict(&source));
                let made = made?;
                // Before it is kept for other targets.
                match self.job.keys.changed(Some(method), &self.truth.planned) {
                    Some(reason) => Err(MethodError::Model(reason)),
                    None => Ok((made, secs)),
                }
            };
            sources.gaussians.get(&keys.predict, name, Some(&predict))
        };
        self.made.predicted += predicted.get();
        let (prediction, predict_secs) = match prediction {
            Ok(Some(timed)) => timed,
            Ok(None) => return Err(Failure::Waiting),
            Err(StoreError::Method(error)) => return Err(error.into()),
            Err(StoreError::File(error)) => return Err(Failure::Run(error.into())),
        };
        if stages == Stages::Predict {
            return Ok(None);
        }
        let scale = match method.privilege() {
            Privilege::DepthScale => {
                if sources
                    .scale
                    .as_ref()
                    .is_none_or(|(key, _)| *key != keys.predict)
                {
                    let scale =
                        depth_scale(&prediction, depth.as_ref(), &self.source, self.job.renderer);
                    let scale = scale.map_err(|error| self.render_failure(method, &error))?;
                    sources.scale = Some((keys.predict.clone(), scale));
                }
                let scale = sources.scale.as_ref().map(|(_, scale)| scale.clone());
                scale
                    .transpose()
                    .map_err(|reason| Failure::Pair(format!("{}: {reason}", self.source.id)))?
            }
            _ => None,
        };
        if sources
            .check
            .as_ref()
            .is_none_or(|(key, _)| *key != keys.predict)
        {
            let facts = self.check_source(method, &prediction, name, sources)?;
            sources.check = Some((keys.predict.clone(), facts));
        }
        let (rendered, render_secs) = self.timed(|| {
            let (source, target) = (&self.source, &self.target);
            render(&prediction, scale, source, target, self.job.renderer)
        });
        let (mut picture, output) =
            rendered.map_err(|error| self.render_failure(method, &error))?;
        let mut warnings = BTreeMap::new();
        if let Some((_, facts)) = &sources.check {
            picture.extras.extend(facts.extras.clone());
            warnings.clone_from(&facts.warnings);
        }
        self.made.rendered += 1;
        Ok(Some(Made {
            prediction: picture,
            warnings,
            scale: None,
            rendering: (self.job.options.keep == Keep::Float).then_some(output),
            predict_secs,
            render_secs,
            inference: keys.predict.get(..16).map(str::to_owned),
        }))
    }

    /// Runs a step; its value and its wall time, s.
    fn timed<T>(&self, step: impl FnOnce() -> T) -> (T, f64) {
        let started = (self.job.clock)();
        let value = step();
        (
            value,
            (self.job.clock)().saturating_sub(started).as_secs_f64(),
        )
    }

    /// Checks a prediction against its own source: measured values and warnings.
    fn check_source(
        &self,
        method: &dyn Method,
        prediction: &GaussianPrediction,
        name: &str,
        sources: &mut Sources<'a>,
    ) -> Result<SourceFacts, Failure> {
        let planned = self.truth.planned;
        let absurd = absurd_coverage(prediction, &self.source);
        if let Some((_, text)) = &absurd {
            // At once: it is about how long the rendering takes.
            self.observer
                .warn(&format!("method '{}': {text}", method.label()));
        }
        let is_chosen = self.job.checked.contains(name);
        let needs_depth = is_chosen && prediction.reading.is_some();
        let depth = match method.privilege() {
            // Depth that cannot be read is not this method's.
            Privilege::None if needs_depth => sources.depth(planned.source).ok().flatten().cloned(),
            _ => None,
        };
        let photograph = sources.photograph(planned.source)?;
        let source = CheckedSource {
            camera: &self.source,
            photograph,
            depth: depth.as_ref(),
            scene: planned.scene,
            is_chosen,
        };
        let facts = check_source(prediction, &source, self.job.renderer);
        let mut facts = facts.map_err(|error| self.render_failure(method, &error))?;
        facts.warnings.extend(absurd);
        Ok(facts)
    }

    /// A lost or exhausted device says nothing about the pair: the run ends, and a restart tries the unit again.
    fn render_failure(&self, method: &dyn Method, error: &RenderError) -> Failure {
        if error.is_device_fault() {
            Failure::Run(EvaluateError::Device {
                pair_id: self.truth.planned.pair.pair_id.clone(),
                method: method.label().to_owned(),
                reason: error.to_string(),
            })
        } else {
            Failure::Pair(format!("render: {error}"))
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
