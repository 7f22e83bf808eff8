//! Prepares a pair's units: takes finished units from the folder, and predicts and renders the others.

use std::collections::BTreeMap;
use std::sync::Arc;

use image::RgbImage;
use sharp::render::{RenderError, RenderOutput};
use sharp_datasets::{DepthMap, View};
use sharp_metrics::Picture;

use super::doubts::TRAINED_ON;
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::gaussians::gaussian_store::{GaussianStore, StoreError};
use super::gaussians::render::{depth_scale, far_moved, render};
use super::gaussians::source_check::{CheckedSource, SourceFacts, absurd_coverage, check_source};
use super::job::{Job, Stages, UnitCounts};
use super::keys::PictureKeys;
use super::manifest::FORMAT;
use super::record::{ChosenScale, Record, Status};
use super::score::{PairTruth, Unscored, crop, empty_record, missing};
use super::unit::{ScoredPicture, Slot, Timing, Unit, picture_sha256};
use crate::config::Keep;
use crate::io::hash::file_sha256;
use crate::io::machine::{cpu_and_threads, peak_bytes};
use crate::io::observer::Observer;
use crate::io::pictures::{read_rgb8, to_rgb8};
use crate::io::rendering_files::{write_exr, write_png};
use crate::io::text::reason_line;
use crate::methods::{
    Approach, GaussianPrediction, Method, MethodError, PicturePrediction, SourceView, TargetCamera,
    TrueDepth,
};
use crate::pairs::PosedCamera;
use crate::pairs::pair_id::source_of;
use crate::pairs::pair_list::ResolvedPair;
use crate::scoring::ground_truth::valid_mask;

/// A unit passed from the predicting to the scoring thread.
pub(super) enum Prepared {
    /// The unit is complete or has failed.
    Done(Box<Unit>, Reuse),
    Unscored(Box<Unscored>),
    /// The unit needs another stage first.
    Waiting,
    /// The unit was not started before the run was stopped.
    Left,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Reuse {
    Complete,
    New,
}

/// State shared by successive pairs of one source; the list of pairs is sorted by source.
pub(super) struct Sources<'a> {
    gaussians: GaussianStore,
    photograph: Option<(&'a View, RgbImage)>,
    depth: Option<(&'a View, Option<DepthMap>)>,
    /// Depth scale, with the key of the prediction to which it applies.
    scale: Option<(String, Result<f64, String>)>,
    /// Source check, with the key of the prediction to which it applies.
    check: Option<(String, SourceFacts)>,
}

impl<'a> Sources<'a> {
    pub(super) fn new(gaussians: GaussianStore) -> Self {
        Self {
            gaussians,
            photograph: None,
            depth: None,
            scale: None,
            check: None,
        }
    }

    fn photograph(&mut self, view: &'a View) -> Result<&RgbImage, MethodError> {
        cached(&mut self.photograph, view, || Ok(view.content.image()?))
    }

    fn depth(&mut self, view: &'a View) -> Result<Option<&DepthMap>, MethodError> {
        let depth = cached(&mut self.depth, view, || Ok(view.content.depth()?))?;
        Ok(depth.as_ref())
    }

    /// The depth of a view for a method that is allowed to use it; otherwise `None`.
    fn depth_seen_by(
        &mut self,
        method: &dyn Method,
        view: &'a View,
    ) -> Result<Option<DepthMap>, MethodError> {
        match method.privilege().depth {
            TrueDepth::SourceDepth => Ok(self.depth(view)?.cloned()),
            _ => Ok(None),
        }
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

/// Why a unit has no picture.
enum Failure {
    /// The reason is recorded as the unit's failure.
    Pair(String),
    /// The error ends the run.
    Run(EvaluateError),
    /// This stage needs a kept prediction that does not exist.
    Waiting,
}

/// Rejects pictures of the wrong size, and values out of range, which rounding to 8 bit would hide.
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

struct Made {
    prediction: PicturePrediction,
    warnings: BTreeMap<String, String>,
    /// Value for [`Record::rule_note`].
    rule_note: Option<String>,
    scale: Option<ChosenScale>,
    rendering: Option<RenderOutput>,
    predict_secs: f64,
    render_secs: f64,
    /// Value for [`Timing::inference`].
    inference: Option<String>,
}

/// The predicting thread's work on one pair.
pub(super) struct PairWork<'j, 'a> {
    job: &'j Job<'a>,
    observer: &'j dyn Observer,
    folder: &'j RunFolder,
    source: PosedCamera,
    target: PosedCamera,
    pub(super) truth: Arc<PairTruth<'a>>,
    pub(super) made: UnitCounts,
}

impl<'j, 'a> PairWork<'j, 'a> {
    pub(super) fn new(
        job: &'j Job<'a>,
        planned: ResolvedPair<'a>,
        folder: &'j RunFolder,
        observer: &'j dyn Observer,
    ) -> Self {
        Self {
            job,
            observer,
            folder,
            source: planned.source.into(),
            target: planned.target.into(),
            truth: Arc::new(PairTruth::new(planned)),
            made: UnitCounts::default(),
        }
    }

    /// Reuses the stored unit if possible; otherwise makes its picture.
    pub(super) fn prepare(
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
                ..empty_record(planned.pair, &planned.scene.cluster, method.label())
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
                Ok(if job.options.stages.scores() {
                    Prepared::Unscored(Box::new(Unscored { unit, picture }))
                } else {
                    Prepared::Waiting
                })
            }
        }
    }

    /// Updates the facts about pair and files in a stored unit from the current pair list and the current hashes of
    /// files.
    fn refreshed(&self, method: &dyn Method, mut unit: Unit) -> Result<Unit, EvaluateError> {
        let ResolvedPair { pair, scene, .. } = self.truth.planned;
        let refreshed = Record {
            cluster: scene.cluster.clone(),
            baseline_m: pair.baseline_m,
            rotation_deg: pair.rotation_deg,
            median_depth_m: pair.median_depth_m,
            overlap: pair.overlap,
            files: self.job.keys.pair_files(method, &self.truth.planned),
            ..unit.record.clone()
        };
        // The stored scores belong to the old files. Clear all, because this run may not compute every metric again.
        if refreshed.files != unit.record.files {
            unit.scores.clear();
        }
        if refreshed == unit.record {
            return Ok(unit);
        }
        unit.record = refreshed;
        Ok(self.folder.save(unit)?)
    }

    /// Records the picture, and stores it if requested. This happens before scoring, so that a run killed during
    /// scoring need not predict again.
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
        unit.record.rule_note = made.rule_note;
        for note in prediction.notes {
            // Tables show one note of each kind. A kind is identified by the note's first four words without numbers.
            let words = note
                .split(' ')
                .filter(|word| !word.contains(char::is_numeric));
            let about = words.take(4).collect::<Vec<_>>().join(" ");
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

    /// Makes a method's picture; `None` if the requested stages make none.
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
            rule_note: None,
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
                let depth = sources.depth_seen_by(method, view)?;
                let image = sources.photograph(view)?;
                let source = SourceView::new(name, &self.source, image, depth.as_ref());
                let (prediction, secs) = self.timed(|| pictures.predict(&source, &target));
                let prediction = prediction?;
                check(&prediction, target.size())?;
                plain(prediction, secs)
            }
            Approach::Scales(sweep) => {
                let depth = sources.depth_seen_by(method, view)?;
                let image = sources.photograph(view)?;
                let source = SourceView::new(name, &self.source, image, depth.as_ref());
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

    /// Makes the picture of a method that predicts Gaussians; `None` if the requested stages make none.
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
        let pair_id = &self.truth.planned.pair.pair_id;
        let target = gaussians
            .needs_target()
            .then(|| TargetCamera::new(pair_id, &self.target));
        let predicted = std::cell::Cell::new(0);
        let depth = match method.privilege().depth {
            TrueDepth::None => None,
            _ => sources.depth(view)?.cloned(),
        };
        let prediction = if stages == Stages::Render {
            sources.gaussians.get(&keys.predict, name, None)
        } else {
            // The photograph is read only when a prediction is made.
            let photograph = std::cell::RefCell::new(&mut sources.photograph);
            let predict = || {
                predicted.set(1);
                let mut photograph = photograph.borrow_mut();
                let image = cached(&mut photograph, view, || Ok(view.content.image()?))?;
                let seen = depth
                    .as_ref()
                    .filter(|_| method.privilege().depth == TrueDepth::SourceDepth);
                let source = SourceView::new(name, &self.source, image, seen);
                let (made, secs) = self.timed(|| gaussians.predict(&source, target.as_ref()));
                let made = made?;
                // Check for changed files before storing the prediction for other targets.
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
        let scale = match method.privilege().depth {
            TrueDepth::DepthScale => {
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
        let truth = if method.privilege().target_pose {
            Some(self.truth.get().map_err(Failure::Pair)?)
        } else {
            None
        };
        let (rendered, render_secs) = self.timed(|| {
            let (source, target) = (&self.source, &self.target);
            render(&prediction, scale, source, target, self.job.renderer, truth)
        });
        let (mut picture, output) =
            rendered.map_err(|error| self.render_failure(method, &error))?;
        let mut warnings = BTreeMap::new();
        if let Some((_, facts)) = &sources.check {
            picture.extras.extend(facts.extras.clone());
            warnings.clone_from(&facts.warnings);
        }
        let trained = method.trained_on(pair_id).into_iter().flatten();
        let trained = TRAINED_ON.into_iter().zip(trained);
        let trained = trained.map(|(name, is)| (name.to_owned(), f64::from(u8::from(is))));
        picture.extras.extend(trained);
        warnings.extend(far_moved(&picture, &output, pair_id));
        self.made.rendered += 1;
        Ok(Some(Made {
            prediction: picture,
            warnings,
            rule_note: prediction.rule_note.clone(),
            scale: None,
            rendering: (self.job.options.keep == Keep::Float).then_some(output),
            predict_secs,
            render_secs,
            inference: keys.predict.get(..16).map(str::to_owned),
        }))
    }

    /// Runs a step; also returns its wall time in seconds.
    fn timed<T>(&self, step: impl FnOnce() -> T) -> (T, f64) {
        let started = (self.job.clock)();
        let value = step();
        (
            value,
            (self.job.clock)().saturating_sub(started).as_secs_f64(),
        )
    }

    /// Compares a prediction with its source photograph.
    fn check_source(
        &self,
        method: &dyn Method,
        prediction: &GaussianPrediction,
        name: &str,
        sources: &mut Sources<'a>,
    ) -> Result<SourceFacts, Failure> {
        let planned = self.truth.planned;
        let absurd = absurd_coverage(prediction, &self.source);
        let is_chosen = self.job.checked.contains(name);
        if let Some((_, text)) = absurd.as_ref().filter(|_| is_chosen) {
            // Warn before rendering, because the warning is that rendering will take very long.
            self.observer
                .warn(&format!("method '{}': {text}", method.label()));
        }
        let depth = match method.privilege().depth {
            // The method itself does not need this depth, so unreadable depth must not make its prediction fail.
            TrueDepth::None => sources.depth(planned.source).ok().flatten().cloned(),
            _ => None,
        };
        let photograph = sources.photograph(planned.source)?;
        // Treat an unreadable mask as none: it matters only to pairs with this view as their target, and those fail.
        let valid = planned.source.content.valid_pixels().ok().flatten();
        let valid = valid.as_ref().and_then(valid_mask);
        let source = CheckedSource {
            camera: &self.source,
            photograph,
            valid: valid.as_ref(),
            depth: depth.as_ref(),
            scene: planned.scene,
            is_chosen,
            of_several_views: method.privilege().several_views,
        };
        let facts = check_source(prediction, &source, self.job.renderer);
        let mut facts = facts.map_err(|error| self.render_failure(method, &error))?;
        facts.warnings.extend(absurd);
        Ok(facts)
    }

    /// A lost device or lack of memory ends the run instead of counting as the pair's failure; the next run retries the
    /// unit.
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
