//! The predicting half of a run: which units are to be done, and their predictions.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::Instant;

use image::RgbImage;
use sharp_datasets::View;
use sharp_metrics::Mask;

use super::error::RunError;
use super::plan::{Keep, RunPlan};
use super::region::common_region;
use super::store::{RunFolder, Timing, UnitFile};
use super::unit::{SOURCE_FINGERPRINT, UnitKey, cpu_backend};
use crate::durable::file_sha256;
use crate::methods::{Method, MethodError, PairInput, Prediction, Truth};
use crate::protocol::Region;
use crate::protocol::depth::PosedDepth;
use crate::protocol::frustum_mask::{FrustumMaskOptions, frustum_mask};
use crate::protocol::pair_list::ResolvedPair;
use crate::record::{Record, Status};
use crate::view_hashes::ViewHashes;

/// Hands over every unit of a plan in order, until one cannot be had or nobody takes them any more.
pub(super) fn predict_all(
    plan: &RunPlan,
    folder: &RunFolder,
    sender: &SyncSender<Result<Step, RunError>>,
) {
    let hashes = ViewHashes::default();
    let mut sources = Sources::default();
    for planned in &plan.pairs {
        let mut pair = PairRun::new(plan, planned, &hashes);
        for method in plan.methods {
            let step = pair.step(method.as_ref(), folder, &mut sources);
            let failed = step.is_err();
            // An error here: who scores has stopped, and says why itself.
            if sender.send(step).is_err() || failed {
                return;
            }
        }
    }
}

/// A unit as it comes from the predicting to the scoring thread.
pub(super) enum Step {
    /// It was done before.
    Stored(Box<UnitFile>),
    /// To be scored.
    Predicted(Box<PredictedUnit>),
}

/// A unit that lacks its scores.
pub(super) struct PredictedUnit {
    pub(super) key: UnitKey,
    pub(super) record: Record,
    pub(super) timing: Timing,
    /// What all methods predict of the target, where only that is scored.
    pub(super) common: Option<Region>,
    pub(super) outcome: Result<(Prediction, Arc<Loaded>), String>,
}

/// One pair of a run, on the predicting thread: its pictures are loaded when the first method needs them, once.
struct PairRun<'a> {
    plan: &'a RunPlan<'a>,
    planned: &'a ResolvedPair<'a>,
    hashes: &'a ViewHashes,
    inputs: String,
    /// What all methods predict of the target, where that is asked for.
    common: Option<Region>,
    loaded: Option<Result<Arc<Loaded>, String>>,
}

/// Why there is no prediction.
enum Failure {
    /// It becomes the unit's record.
    Pair(String),
    /// It ends the run.
    Device(String),
}

/// The last source's photograph: pairs come sorted, so that those of one source follow each other.
#[derive(Default)]
struct Sources<'a>(Option<(&'a View, Arc<RgbImage>)>);

impl<'a> Sources<'a> {
    fn read(&mut self, view: &'a View) -> Result<Arc<RgbImage>, String> {
        if let Some((last, picture)) = &self.0
            && std::ptr::eq(*last, view)
        {
            return Ok(Arc::clone(picture));
        }
        let picture = Arc::new(view.content.image().map_err(|error| error.to_string())?);
        self.0 = Some((view, Arc::clone(&picture)));
        Ok(picture)
    }
}

/// The pictures of a pair.
pub(super) struct Loaded {
    source: Arc<RgbImage>,
    pub(super) truth: Truth,
    pub(super) mask: Option<Mask>,
}

impl<'a> PairRun<'a> {
    fn new(plan: &'a RunPlan, planned: &'a ResolvedPair, hashes: &'a ViewHashes) -> Self {
        // A file that cannot be read hashes to its error: the unit fails anyway, with the reason.
        let inputs = [planned.source, planned.target]
            .map(|view| hashes.view(view).unwrap_or_else(|error| error.to_string()));
        Self {
            plan,
            planned,
            hashes,
            inputs: inputs.join(" "),
            common: plan
                .common_region
                .then(|| common_region(plan.methods, planned)),
            loaded: None,
        }
    }

    fn key(&self, method: &dyn Method) -> UnitKey {
        let pair_id = self.planned.pair.pair_id.as_str();
        let method_inputs = match method.input_files(pair_id) {
            Ok(files) => files
                .iter()
                .map(|file| {
                    let hash = self.hashes.file(file);
                    hash.unwrap_or_else(|error| error.to_string())
                })
                .collect::<Vec<_>>()
                .join(" "),
            Err(error) => error.to_string(),
        };
        let metrics: Vec<String> = self
            .plan
            .scoring
            .metrics
            .iter()
            .map(|metric| format!("{} {}", metric.key, metric.weights))
            .collect();
        UnitKey::new(&[
            ("sources", SOURCE_FINGERPRINT),
            ("backend", self.plan.renderer.name()),
            ("kernels", cpu_backend()),
            ("pair", pair_id),
            ("facts", &self.pair_facts()),
            ("inputs", &self.inputs),
            (
                "reading",
                self.plan
                    .readings
                    .get(self.planned.scene.dataset.as_str())
                    .map_or("", String::as_str),
            ),
            ("method", method.label()),
            ("method identity", &method.identity()),
            ("method inputs", &method_inputs),
            ("metrics", &metrics.join("\n")),
            (
                "metric networks",
                &self.plan.scoring.scorer.options().arithmetic().to_string(),
            ),
            (
                "region",
                &self.common.map_or_else(String::new, |r| r.to_string()),
            ),
        ])
    }

    /// What the record repeats of the pair list.
    fn pair_facts(&self) -> String {
        let pair = self.planned.pair;
        format!(
            "{:?} {:?} {:?} {:?} {}",
            pair.baseline_m,
            pair.rotation_deg,
            pair.median_depth_m,
            pair.overlap,
            self.planned.scene.cluster
        )
    }

    /// Whether the kept picture, if any is wanted, is the one that was scored.
    fn prediction_is_kept(&self, folder: &RunFolder, unit: &UnitFile) -> bool {
        let path = folder.prediction_path(&unit.record.method, &unit.record.pair_id);
        match (&unit.prediction_sha256, self.plan.keep) {
            (_, Keep::None) => true,
            (Some(sha256), Keep::All) => file_sha256(&path).is_ok_and(|found| found == *sha256),
            (None, Keep::All) => false,
        }
    }

    /// Takes over what is stored, or predicts.
    fn step(
        &mut self,
        method: &dyn Method,
        folder: &RunFolder,
        sources: &mut Sources<'a>,
    ) -> Result<Step, RunError> {
        let key = self.key(method);
        let stored = folder
            .load(&key)?
            .filter(|unit| unit.record.status == Status::Ok)
            .filter(|unit| self.prediction_is_kept(folder, unit));
        if let Some(unit) = stored {
            return Ok(Step::Stored(Box::new(unit)));
        }
        let record = self.empty_record(method.label());
        let mut timing = Timing::default();
        let outcome = match self.predict(method, sources, &mut timing) {
            Ok(predicted) => Ok(predicted),
            Err(Failure::Pair(reason)) => Err(reason),
            Err(Failure::Device(reason)) => {
                return Err(RunError::Device {
                    pair_id: record.pair_id,
                    method: record.method,
                    reason,
                });
            }
        };
        Ok(Step::Predicted(Box::new(PredictedUnit {
            key,
            record,
            timing,
            common: self.common,
            outcome,
        })))
    }

    fn predict(
        &mut self,
        method: &dyn Method,
        sources: &mut Sources<'a>,
        timing: &mut Timing,
    ) -> Result<(Prediction, Arc<Loaded>), Failure> {
        let (plan, planned) = (self.plan, self.planned);
        let loaded = self
            .loaded
            .get_or_insert_with(|| load(plan, planned, sources).map(Arc::new));
        let loaded = Arc::clone(loaded.as_ref().map_err(|e| Failure::Pair(e.clone()))?);
        let input = PairInput {
            pair_id: &planned.pair.pair_id,
            source: planned.source,
            target: planned.target,
            source_image: &loaded.source,
            truth: &loaded.truth,
            renderer: plan.renderer,
        };
        let started = Instant::now();
        let prediction = method.predict(&input).map_err(|error| match error {
            MethodError::Device(reason) => Failure::Device(reason),
            other => Failure::Pair(other.to_string()),
        })?;
        timing.predict_secs = started.elapsed().as_secs_f64();
        Ok((prediction, loaded))
    }

    fn empty_record(&self, method: &str) -> Record {
        let ResolvedPair {
            pair,
            scene,
            source,
            target,
        } = self.planned;
        Record {
            pair_id: pair.pair_id.clone(),
            dataset: scene.dataset.clone(),
            scene: scene.id.clone(),
            cluster: scene.cluster.clone(),
            source: source.id.clone(),
            target: target.id.clone(),
            method: method.to_owned(),
            baseline_m: pair.baseline_m,
            rotation_deg: pair.rotation_deg,
            median_depth_m: pair.median_depth_m,
            overlap: pair.overlap,
            status: Status::Ok,
            scores: BTreeMap::new(),
            extras: BTreeMap::new(),
        }
    }
}

fn load<'a>(
    plan: &RunPlan,
    planned: &ResolvedPair<'a>,
    sources: &mut Sources<'a>,
) -> Result<Loaded, String> {
    let source = sources.read(planned.source)?;
    let content = &planned.target.content;
    let target = content.image().map_err(|error| error.to_string())?;
    let valid = content.valid_pixels().map_err(|error| error.to_string())?;
    let mask = if plan.scoring.metrics.iter().any(|m| m.key.is_masked()) {
        mask(planned)?
    } else {
        None
    };
    Ok(Loaded {
        truth: Truth::of(target, valid.as_ref()),
        source,
        mask,
    })
}

/// The view-frustum mask of the target; `None` where it has no depth.
fn mask(planned: &ResolvedPair) -> Result<Option<Mask>, String> {
    let depth = planned.target.content.depth();
    let Some(depth) = depth.map_err(|error| error.to_string())? else {
        return Ok(None);
    };
    let target = PosedDepth::of_view(planned.target, depth).map_err(|error| error.to_string())?;
    let mask = frustum_mask(
        &target,
        &planned.source.intrinsics,
        &planned.source.camera_from_world,
        &FrustumMaskOptions::default(),
    );
    let inside = mask.as_raw().iter().map(|&v| v != 0).collect();
    Ok(Mask::new(mask.width(), mask.height(), inside))
}
