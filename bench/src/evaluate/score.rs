//! The score stage: compares all pictures of a pair with its target.

use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::time::Instant;

use image::RgbImage;
use sharp::frustum_mask::{FrustumMask, FrustumMaskOptions, frustum_mask, source_bounds_mask};
use sharp_datasets::{DepthMap, View};
use sharp_metrics::{Mask, MetricKey, MetricRegion, Picture, Scorer, Unavailable};

use super::error::EvaluateError;
use super::folder::RunFolder;
use super::keys::Keys;
use super::record::{Crop, Record, Score, Status};
use super::unit::{StoredScore, Unit};
use crate::io::text::reason_line;
use crate::pairs::Pair;
use crate::pairs::depth::PosedDepth;
use crate::pairs::pair_list::ResolvedPair;
use crate::scoring::ground_truth::PairMasks;
use crate::scoring::metrics::ScoredMetric;
use crate::scoring::rules::{MIN_PIXELS, PairMask};
use crate::scoring::{GroundTruth, Region, Scoring, ScoringRules};

/// The ground truth of a pair: the target's photograph and masks, read on first use.
pub(super) struct PairTruth<'a> {
    pub(super) planned: ResolvedPair<'a>,
    truth: OnceLock<Result<GroundTruth, String>>,
}

impl<'a> PairTruth<'a> {
    pub(super) fn new(planned: ResolvedPair<'a>) -> Self {
        Self {
            planned,
            truth: OnceLock::new(),
        }
    }

    /// The target's photograph, read on first use. Errors do not name the pair.
    pub(super) fn get(&self) -> Result<&GroundTruth, String> {
        let content = &self.planned.target.content;
        let read = || {
            let image = content.image().map_err(|error| error.to_string())?;
            let valid = content.valid_pixels().map_err(|error| error.to_string())?;
            Ok(GroundTruth::of(image, valid.as_ref()))
        };
        self.truth.get_or_init(read).as_ref().map_err(Clone::clone)
    }

    /// The masks that the metrics need; a mask is empty if the depth that it requires is missing.
    pub(super) fn masks(&self, scoring: &Scoring) -> Result<PairMasks, String> {
        let ScoringRules { mask, border } = scoring.rules;
        let mut masks = PairMasks {
            border,
            ..PairMasks::default()
        };
        let with_frustum = scoring.needs(MetricRegion::Frustum);
        let with_given = scoring.needs(MetricRegion::Given) && mask == PairMask::SourceBounds;
        if !with_frustum && !with_given {
            return Ok(masks);
        }
        let ResolvedPair { source, target, .. } = self.planned;
        let depth = target.content.depth().map_err(|error| error.to_string())?;
        let posed = depth.map(|depth| PosedDepth::of_view(target, depth));
        let posed = posed.transpose().map_err(|error| error.to_string())?;
        let world_from_target = target.camera_from_world.inverse();
        let source_from_target = source.camera_from_world.after(&world_from_target);
        let (seen, seer, pose) = (&target.intrinsics, &source.intrinsics, &source_from_target);
        let mask = |of: &dyn Fn(&DepthMap) -> FrustumMask| {
            let mask = of(posed.as_ref()?.depth());
            let inside = mask.as_raw().iter().map(|&v| v != 0).collect();
            Mask::new(mask.width(), mask.height(), inside)
        };
        if with_frustum {
            let options = FrustumMaskOptions::default();
            masks.frustum = mask(&|depth| frustum_mask(depth, seen, seer, pose, &options));
        }
        if with_given {
            let bounds = mask(&|depth| source_bounds_mask(depth, seen, seer, pose));
            let size = (target.intrinsics.width, target.intrinsics.height);
            // The mask is empty if the target has no depth, or if too few pixels are inside the source's bounds.
            let enough = bounds.filter(|mask| mask.count() >= MIN_PIXELS);
            let nothing = || Mask::new(size.0, size.1, vec![false; Region::whole(size).area()]);
            masks.given = enough.or_else(nothing);
        }
        Ok(masks)
    }
}

/// A unit with a picture but missing scores.
pub(super) struct Unscored {
    pub(super) unit: Unit,
    pub(super) picture: RgbImage,
}

/// The metrics whose scores are missing or were computed from different inputs.
pub(super) fn missing<'s>(
    unit: &Unit,
    scoring: &'s Scoring,
    keys: &Keys,
    planned: &ResolvedPair,
) -> Vec<&'s ScoredMetric> {
    let Some(picture) = &unit.picture else {
        return scoring.metrics.iter().collect();
    };
    let region = unit.record.crop.map(|crop| crop.region);
    let metrics = scoring.metrics.iter();
    metrics
        .filter(|metric| {
            let key = keys.score(metric, &picture.sha256, region, planned);
            let stored = unit.scores.get(&metric.key.to_string());
            stored.is_none_or(|stored| stored.key != key)
        })
        .collect()
}

/// Shares of the memory limit, in bytes. The remainder is for the metrics' networks, the target, and the picture being
/// rendered.
#[derive(Debug, Clone, Copy)]
pub(super) struct MemoryShares {
    /// Share for the Gaussians of a source.
    pub(super) gaussians: u64,
    /// Share for predicted pictures.
    pictures: u64,
    /// Share for the working memory of the metrics.
    metrics: u64,
}

impl MemoryShares {
    pub(super) fn of(memory_limit_bytes: u64) -> Self {
        let quarter = memory_limit_bytes / 4;
        Self {
            gaussians: quarter,
            pictures: quarter,
            metrics: quarter,
        }
    }

    /// Maximum number of a target's predictions to pass to [`score_pair`] at once, at least 1. Memory holds up to twice
    /// as many, because the next batch is prepared meanwhile.
    pub(super) fn pictures_of(self, target: &View) -> usize {
        let picture = 3 * u64::from(target.intrinsics.width) * u64::from(target.intrinsics.height);
        (self.pictures / (2 * picture).max(1)).max(1) as usize
    }

    /// Number of predictions, 1 to `most`, that the metrics can compare at once within their share of memory.
    fn compared(self, truth: &GroundTruth, scorer: &Scorer, most: usize) -> usize {
        let fits = |count: &usize| {
            let copies = *count as u64 * truth.copied_bytes();
            copies + scorer.memory_bytes(truth.dimensions(), *count) <= self.metrics
        };
        (2..=most).take_while(fits).last().unwrap_or(1)
    }
}

/// Computes and saves the missing scores of a pair's units. Units that need the same metrics share each network's pass
/// over the target, if memory allows.
pub(super) fn score_pair(
    truth: &PairTruth,
    unscored: Vec<Unscored>,
    scoring: &Scoring,
    keys: &Keys,
    memory: MemoryShares,
    folder: &RunFolder,
) -> Result<Vec<Unit>, EvaluateError> {
    if unscored.is_empty() {
        return Ok(Vec::new());
    }
    let started = Instant::now();
    let count = unscored.len().max(1) as f64;
    let masks = truth.masks(scoring);
    let mut groups: BTreeMap<Vec<MetricKey>, Vec<Unscored>> = BTreeMap::new();
    for item in unscored {
        let missing = missing(&item.unit, scoring, keys, &truth.planned);
        let missing = missing.iter().map(|metric| metric.key).collect();
        groups.entry(missing).or_default().push(item);
    }
    let mut scored = Vec::new();
    for (metrics, group) in groups {
        let is_virtual = !truth.planned.target.content.has_photograph();
        let read = match (truth.get(), &masks) {
            (Err(reason), _) => Err(reason),
            (_, Err(reason)) => Err(reason.clone()),
            (Ok(truth), Ok(masks)) => Ok((truth, masks)),
        };
        let (units, pictures): (Vec<Unit>, Vec<Picture>) = group
            .into_iter()
            .map(|item| (item.unit, Picture::Rgb8(item.picture)))
            .unzip();
        let regions = units
            .iter()
            .map(|unit| unit.record.crop.map(|crop| crop.region));
        let shown: Vec<(&Picture, Option<Region>)> = pictures.iter().zip(regions).collect();
        let results = match read {
            Err(_) if is_virtual => {
                let nothing = |key: &MetricKey| (*key, Err(Unavailable::NoPhotograph));
                vec![Ok(metrics.iter().map(nothing).collect()); units.len()]
            }
            Err(reason) => vec![Err(reason); units.len()],
            Ok((truth, masks)) => {
                let scorer = scoring.scorer.restricted(&metrics);
                let chunks = shown.chunks(memory.compared(truth, &scorer, shown.len()));
                chunks
                    .flat_map(|shown| truth.score(&scorer, shown, masks))
                    .collect()
            }
        };
        let changed = keys.changed(None, &truth.planned);
        for (mut unit, result) in units.into_iter().zip(results) {
            match changed.clone().map_or(result, Err) {
                Ok(scores) => {
                    let region = unit.record.crop.map(|crop| crop.region);
                    unit.record.valid_share =
                        truth.get().ok().and_then(|truth| truth.valid_share(region));
                    for (key, score) in scores {
                        if let Some(stored) =
                            stored(key, score, &unit, scoring, keys, &truth.planned)
                        {
                            unit.scores.insert(key.to_string(), stored);
                        }
                    }
                }
                Err(reason) => {
                    unit.record.status = Status::Failed {
                        reason: reason_line(&reason),
                    };
                }
            }
            unit.timing.score_secs = started.elapsed().as_secs_f64() / count;
            scored.push(folder.save(unit)?);
        }
    }
    Ok(scored)
}

fn stored(
    key: MetricKey,
    score: Result<f64, sharp_metrics::Unavailable>,
    unit: &Unit,
    scoring: &Scoring,
    keys: &Keys,
    planned: &ResolvedPair,
) -> Option<StoredScore> {
    let metric = scoring.metrics.iter().find(|metric| metric.key == key)?;
    let picture = unit.picture.as_ref()?;
    let region = unit.record.crop.map(|crop| crop.region);
    Some(StoredScore {
        key: keys.score(metric, &picture.sha256, region, planned),
        metric_identity: metric.identity.clone(),
        score: match score {
            Ok(value) => Score::Value(value),
            Err(unavailable) => Score::Unavailable {
                unavailable: unavailable.to_string(),
            },
        },
    })
}

/// A record of a pair that has no result yet; `cluster` is that of the pair's scene.
pub(super) fn empty_record(pair: &Pair, cluster: &str, method: &str) -> Record {
    Record {
        pair_id: pair.pair_id.clone(),
        dataset: pair.dataset.clone(),
        scene: pair.scene.clone(),
        cluster: cluster.to_owned(),
        source: pair.source.clone(),
        target: pair.target.clone(),
        method: method.to_owned(),
        baseline_m: pair.baseline_m,
        rotation_deg: pair.rotation_deg,
        median_depth_m: pair.median_depth_m,
        overlap: pair.overlap,
        status: Status::Ok,
        scores: BTreeMap::new(),
        crop: None,
        valid_share: None,
        resized_from: None,
        scale: None,
        files: None,
        extras: BTreeMap::new(),
        warnings: BTreeMap::new(),
        change: None,
        shows: None,
        camera: None,
        in_world: None,
        wrong_cells: None,
        shift: None,
        far_shift: None,
        tone: None,
        masked: None,
        filled: None,
        rule_note: None,
    }
}

/// The record of a scored region; `None` if the whole target is scored.
pub(super) fn crop(region: Option<Region>, target: (u32, u32)) -> Option<Crop> {
    let region = region.filter(|region| *region != Region::whole(target))?;
    Some(Crop {
        share: region.share_of(target),
        region,
    })
}
