//! Predicts, scores and records every unit that is not done yet.

use std::collections::BTreeMap;
use std::time::Instant;

use image::RgbImage;
use sharp_datasets::View;
use sharp_metrics::{Mask, Picture};

use super::plan::{Keep, RunPlan};
use super::region::{common_region, cut, region_extras};
use super::store::{RunFolder, Timing};
use super::unit::{SOURCE_FINGERPRINT, UnitKey, cpu_backend};
use crate::durable::{FileError, file_sha256, sha256_hex};
use crate::methods::{Method, PairInput, Prediction};
use crate::protocol::Region;
use crate::protocol::depth::PosedDepth;
use crate::protocol::frustum_mask::{FrustumMaskOptions, frustum_mask};
use crate::protocol::pair_list::ResolvedPair;
use crate::record::{Record, Score, Status};
use crate::render_file::write_png;

/// What happened to the units of a run.
#[derive(Debug, Clone, Default)]
pub struct Executed {
    /// Every unit's record and timing, sorted by pair id, then in the order of the methods.
    pub units: Vec<(Record, Timing)>,
    /// Units whose stored result was taken over.
    pub reused: usize,
}

impl Executed {
    /// The records alone.
    pub fn records(&self) -> Vec<Record> {
        self.units
            .iter()
            .map(|(record, _)| record.clone())
            .collect()
    }

    /// How many units failed.
    pub fn failures(&self) -> usize {
        self.units
            .iter()
            .filter(|(record, _)| record.status != Status::Ok)
            .count()
    }
}

/// Runs a plan into a folder. Finished units are taken over, recorded failures tried again; a failing pair becomes
/// a record and the others go on. `progress(pair_id, method)` is called before each unit.
///
/// # Errors
/// Only when the run folder itself cannot be read or written.
pub fn execute(
    plan: &RunPlan,
    folder: &RunFolder,
    mut progress: impl FnMut(&str, &str),
) -> Result<Executed, FileError> {
    let mut executed = Executed::default();
    let mut hashes = ViewHashes::default();
    for method in plan.methods {
        method.begin(&folder.logs_path());
    }
    for planned in &plan.pairs {
        let mut pair = PairRun::new(plan, planned, &mut hashes);
        for method in plan.methods {
            progress(&planned.pair.pair_id, method.label());
            let key = pair.key(method.as_ref());
            let stored = folder
                .load(&key)?
                .filter(|unit| unit.record.status == Status::Ok)
                .filter(|_| pair.prediction_is_kept(folder, method.label()));
            let unit = match stored {
                Some(unit) => {
                    executed.reused += 1;
                    (unit.record, unit.timing)
                }
                None => {
                    let (record, timing) = pair.run(method.as_ref(), folder)?;
                    folder.save(&key, record.clone(), timing)?;
                    (record, timing)
                }
            };
            executed.units.push(unit);
        }
    }
    Ok(executed)
}

/// Hashes of all the files a view is made of, computed once a run.
#[derive(Debug, Default)]
struct ViewHashes(BTreeMap<(String, String, String), String>);

impl ViewHashes {
    /// A file that cannot be read hashes to its error: the unit fails anyway, with the reason.
    fn of(&mut self, planned: &ResolvedPair, view: &View) -> String {
        let name = (
            planned.scene.dataset.clone(),
            planned.scene.id.clone(),
            view.id.clone(),
        );
        self.0
            .entry(name)
            .or_insert_with(|| hash_view(view))
            .clone()
    }
}

fn hash_view(view: &View) -> String {
    let mut text = format!("{:?}\n{:?}\n", view.intrinsics, view.camera_from_world);
    let image = view.content.image_sha256();
    text += &image.unwrap_or_else(|error| error.to_string());
    for file in view.content.files() {
        text += "\n";
        text += &file_sha256(&file).unwrap_or_else(|error| error.to_string());
    }
    sha256_hex(text.as_bytes())
}

/// One pair of a run: its pictures are loaded when the first method needs them, once.
struct PairRun<'a> {
    plan: &'a RunPlan<'a>,
    planned: &'a ResolvedPair<'a>,
    inputs: String,
    /// What all methods predict of the target, where that is asked for.
    common: Option<Region>,
    loaded: Option<Result<Loaded, String>>,
}

struct Loaded {
    source: RgbImage,
    target: RgbImage,
    /// The target again, as the scorer takes it.
    truth: Picture,
    mask: Option<Mask>,
}

impl<'a> PairRun<'a> {
    fn new(plan: &'a RunPlan, planned: &'a ResolvedPair, hashes: &mut ViewHashes) -> Self {
        let inputs = [planned.source, planned.target].map(|view| hashes.of(planned, view));
        Self {
            plan,
            planned,
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
                .map(|file| file_sha256(file).unwrap_or_else(|error| error.to_string()))
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
            ("backend", cpu_backend()),
            ("pair", pair_id),
            ("facts", &self.pair_facts()),
            ("inputs", &self.inputs),
            ("method", method.label()),
            ("method identity", &method.identity()),
            ("method inputs", &method_inputs),
            ("metrics", &metrics.join("\n")),
            (
                "metric networks",
                &self.plan.scoring.scorer.options().arithmetic(),
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

    fn prediction_is_kept(&self, folder: &RunFolder, method: &str) -> bool {
        self.plan.keep == Keep::None
            || folder
                .prediction_path(method, &self.planned.pair.pair_id)
                .is_file()
    }

    fn run(
        &mut self,
        method: &dyn Method,
        folder: &RunFolder,
    ) -> Result<(Record, Timing), FileError> {
        let mut record = self.empty_record(method.label());
        let mut timing = Timing::default();
        match self.attempt(method, &mut record, &mut timing) {
            Ok(prediction) => {
                if self.plan.keep == Keep::All
                    && let Picture::Rgb8(image) = &prediction.picture
                {
                    let path = folder.prediction_path(method.label(), &record.pair_id);
                    write_png(&path, image)?;
                }
            }
            Err(reason) => {
                record.scores.clear();
                record.extras.clear();
                record.status = Status::Failed {
                    reason: one_line(&reason),
                };
            }
        }
        Ok((record, timing))
    }

    fn attempt(
        &mut self,
        method: &dyn Method,
        record: &mut Record,
        timing: &mut Timing,
    ) -> Result<Prediction, String> {
        let (plan, planned) = (self.plan, self.planned);
        let loaded = self
            .loaded
            .get_or_insert_with(|| load(plan, planned))
            .as_ref()
            .map_err(Clone::clone)?;
        let input = PairInput {
            pair_id: &planned.pair.pair_id,
            source: planned.source,
            target: planned.target,
            source_image: &loaded.source,
            target_image: &loaded.target,
        };
        let started = Instant::now();
        let mut prediction = method.predict(&input).map_err(|error| error.to_string())?;
        timing.predict_secs = started.elapsed().as_secs_f64();

        let started = Instant::now();
        if let Some(common) = self.common {
            cut(&mut prediction, common, loaded.truth.dimensions())?;
        }
        let scores = prediction.score(&plan.scoring.scorer, &loaded.truth, loaded.mask.as_ref())?;
        timing.score_secs = started.elapsed().as_secs_f64();
        record.scores = scores
            .into_iter()
            .map(|(key, score)| {
                let score = match score {
                    Ok(value) => Score::Value(value),
                    Err(unavailable) => Score::Unavailable {
                        unavailable: unavailable.to_string(),
                    },
                };
                (key.to_string(), score)
            })
            .collect();
        record.extras = prediction.extras.clone();
        if let Some(region) = prediction.region {
            let size = loaded.truth.dimensions();
            record.extras.extend(region_extras(&region, size));
        }
        Ok(prediction)
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

fn load(plan: &RunPlan, planned: &ResolvedPair) -> Result<Loaded, String> {
    let image = |view: &View| view.content.image().map_err(|error| error.to_string());
    let (source, target) = (image(planned.source)?, image(planned.target)?);
    let mask = if plan.scoring.metrics.iter().any(|m| m.key.is_masked()) {
        mask(planned)?
    } else {
        None
    };
    Ok(Loaded {
        truth: Picture::Rgb8(target.clone()),
        source,
        target,
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

/// Reasons become table cells and CSV fields.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
