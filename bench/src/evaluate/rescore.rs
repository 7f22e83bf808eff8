//! Scores kept predictions again with more metrics or on another region. Predicts and renders nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use image::RgbImage;
use sharp_metrics::Picture;

use super::differences::{Purpose, extended, refusal};
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::job::UnitCounts;
use super::keys::Keys;
use super::manifest::{Manifest, metric_records};
use super::record::Status;
use super::results::{Current, Results, check_rows, units_folder, write_tables};
use super::score::{MemoryShares, PairTruth, Unscored, crop, missing, score_pair};
use super::shard::Shard;
use super::unit::{ScoredPicture, Slot, Unit, picture_sha256};
use crate::io::hash::file_sha256;
use crate::io::observer::Observer;
use crate::io::pictures::read_rgb8;
use crate::io::rendering_files::write_png;
use crate::pairs::dataset::scenes_of;
use crate::pairs::pair_list::ResolvedPair;
use crate::pairs::{OpenDataset, PairList};
use crate::scoring::{Region, Scoring};

/// Computes the scores under the given metrics that a folder's kept predictions do not have yet.
///
/// # Errors
/// If the folder or its datasets cannot be read, or LPIPS and DISTS were previously computed on another device.
pub fn rescore(
    root: &Path,
    scoring: &Scoring,
    memory_limit_bytes: u64,
    observer: &dyn Observer,
) -> Result<(UnitCounts, Results), EvaluateError> {
    // Read the results first, so that a mistyped path does not create a folder.
    Results::read(root)?;
    let folder = RunFolder::create(root)?;
    let current = Current::read(&folder)?;
    let mut manifest = current.manifest;
    let scoring = &scoring.under(manifest.rules);
    let new = under(&manifest, scoring);
    let datasets = open_datasets(&manifest)?;
    let store = units_folder(&folder, &manifest);
    let keys = Keys::new(&datasets, &manifest.renderer);
    keys.check_files(
        &folder,
        &current.units,
        &scenes_of(&datasets),
        &[],
        EVALUATE_AGAIN,
    )?;
    let (extended, replaced) = extended(manifest, new, root)?;
    manifest = extended;
    for what in replaced {
        observer.warn(&format!(
            "{what} before; units that are not rescored now lose this score"
        ));
    }
    folder.remove_tables()?;
    folder.write_manifest(&manifest)?;
    let work = Kept {
        folder: &store,
        keys: &keys,
        datasets: &datasets,
        units: current.units,
        scoring,
        memory: MemoryShares::of(memory_limit_bytes),
    };
    let list = PairList::read(&folder.pairs_path())?;
    let counts = work.score(list, observer)?;
    let results = match counts.left {
        0 => write_tables(&folder)?,
        _ => Results::read(root)?,
    };
    Ok((counts, results))
}

/// Like [`rescore`], for one shard of a plan, while other processes score other shards. Needs the datasets, but not the
/// methods. Writes units, but neither manifest nor tables.
///
/// # Errors
/// If the metrics, or the device or code that computes them, differ from the plan's; also the errors of [`rescore`].
pub fn score_shard(
    root: &Path,
    scoring: &Scoring,
    shard: Shard,
    memory_limit_bytes: u64,
    observer: &dyn Observer,
) -> Result<UnitCounts, EvaluateError> {
    let folder = RunFolder::join(root)?;
    let Current {
        manifest,
        mut units,
        ..
    } = Current::read(&folder)?;
    let scoring = &scoring.under(manifest.rules);
    if let Some(difference) = refusal(&manifest, &under(&manifest, scoring), Purpose::Shard) {
        return Err(EvaluateError::NotKept {
            folder: root.to_owned(),
            reason: difference.between("in the plan", "in this shard"),
        });
    }
    let plan = folder.plan()?;
    let list = PairList::read(&folder.pairs_path())?;
    check_rows(&folder, &manifest.pairs, &plan, &list)?;
    folder.remove_tables()?;
    let own: BTreeSet<&str> = shard
        .of(plan.pairs().into_iter().collect(), |id| id)
        .into_iter()
        .collect();
    units.retain(|unit| own.contains(unit.slot.pair_id.as_str()));
    let (of_shard, there) = (own.len() * manifest.methods.len(), units.len());
    let datasets = open_datasets(&manifest)?;
    let keys = Keys::new(&datasets, &manifest.renderer);
    keys.check_files(&folder, &units, &scenes_of(&datasets), &[], EVALUATE_AGAIN)?;
    let work = Kept {
        folder: &folder,
        keys: &keys,
        datasets: &datasets,
        units,
        scoring,
        memory: MemoryShares::of(memory_limit_bytes),
    };
    let mut counts = work.score(list, observer)?;
    // Units of the shard that have no prediction count as waiting.
    counts.units += of_shard - there;
    counts.waiting += of_shard - there;
    Ok(counts)
}

/// Advice if input files have changed since the pictures were kept, because an old prediction must not be scored
/// against a new photograph.
const EVALUATE_AGAIN: &str = "`run` with the same options evaluates this pair again";

/// The manifest with its metrics replaced by the metrics of `scoring`.
fn under(manifest: &Manifest, scoring: &Scoring) -> Manifest {
    let options = scoring.scorer.options();
    Manifest {
        metrics: metric_records(scoring),
        metric_networks: options.arithmetic(),
        kernels: options.simd.instruction_set(),
        ..manifest.clone()
    }
}

struct Kept<'a> {
    folder: &'a RunFolder,
    keys: &'a Keys,
    datasets: &'a [OpenDataset],
    units: Vec<Unit>,
    scoring: &'a Scoring,
    memory: MemoryShares,
}

impl Kept<'_> {
    fn score(
        self,
        mut list: PairList,
        observer: &dyn Observer,
    ) -> Result<UnitCounts, EvaluateError> {
        let Self {
            folder,
            keys,
            datasets,
            scoring,
            memory,
            ..
        } = self;
        let scenes = scenes_of(datasets);
        let wanted: BTreeSet<String> = self
            .units
            .iter()
            .map(|unit| unit.slot.pair_id.clone())
            .collect();
        list.pairs.retain(|pair| wanted.contains(&pair.pair_id));
        let mut reasons = BTreeSet::new();
        list.pairs.retain(|pair| {
            let dataset = datasets.iter().find(|d| d.name == pair.dataset);
            let left_out = dataset.and_then(|dataset| dataset.leaves_out(&pair.scene));
            reasons.extend(left_out.map(ToString::to_string));
            left_out.is_none()
        });
        for reason in reasons {
            observer.warn(&reason);
        }
        let list = PairList::new("pairs.csv", list.pairs);
        let readable = list.resolve_readable(&scenes, datasets)?;
        let mut units: BTreeMap<&str, Vec<Unit>> = BTreeMap::new();
        for unit in &self.units {
            units
                .entry(&unit.slot.pair_id)
                .or_default()
                .push(unit.clone());
        }
        let mut counts = UnitCounts::default();
        observer.begin("", self.units.len(), "units");
        let (mut not_kept, mut changed) = (0, 0);
        for planned in readable {
            if observer.stop() {
                let left = units
                    .remove(planned.pair.pair_id.as_str())
                    .map_or(0, |units| units.len());
                counts.units += left;
                counts.left += left;
                continue;
            }
            let truth = PairTruth::new(planned);
            let mut of_pair = Vec::new();
            for unit in units
                .remove(planned.pair.pair_id.as_str())
                .unwrap_or_default()
            {
                counts.units += 1;
                let Some(unit) = unit.scorable() else {
                    counts.failed += 1;
                    continue;
                };
                if missing(&unit, scoring, keys, &planned).is_empty() {
                    counts.reused += 1;
                    continue;
                }
                of_pair.push(unit);
            }
            let mut of_pair = of_pair.into_iter().peekable();
            while of_pair.peek().is_some() {
                observer.progress(counts.units, &planned.pair.pair_id);
                let mut unscored = Vec::new();
                for unit in of_pair.by_ref().take(memory.pictures_of(planned.target)) {
                    match kept_picture(folder, &unit) {
                        Some(picture) => unscored.push(Unscored { unit, picture }),
                        None if is_changed(folder, &unit) => changed += 1,
                        None => not_kept += 1,
                    }
                }
                for unit in score_pair(&truth, unscored, scoring, keys, memory, folder)? {
                    counts.scored += 1;
                    counts.count(&unit.record, observer);
                }
            }
        }
        observer.progress(counts.units, "");
        observer.end();
        // The remaining units are of scenes or views that were left out because they cannot be read.
        let unread = units.into_values().flatten().count();
        counts.units += unread;
        counts.failed += unread;
        counts.waiting += not_kept + changed;
        let units = counts.units;
        if not_kept > 0 {
            observer.warn(&format!(
                "{not_kept} of {units} units have no kept picture; `run` with these metrics repeats their predictions"
            ));
        }
        if changed > 0 {
            observer.warn(&format!(
                "the kept pictures of {changed} of {units} units differ from those that were scored, so they are not \
                 scored; `run` with these metrics recreates them (`report` names the files)"
            ));
        }
        Ok(counts)
    }
}

pub(super) fn open_datasets(
    manifest: &super::manifest::Manifest,
) -> Result<Vec<OpenDataset>, EvaluateError> {
    let mut datasets = Vec::new();
    for dataset in &manifest.datasets {
        datasets.push(dataset.open(dataset.only_scenes.as_deref())?);
    }
    Ok(datasets)
}

fn kept_picture(folder: &RunFolder, unit: &Unit) -> Option<RgbImage> {
    if !folder.has_picture(unit) {
        return None;
    }
    let path = folder.prediction_path(&unit.slot.method, &unit.slot.pair_id, "png");
    read_rgb8(&path).ok()
}

/// Whether the file of a unit's kept picture was changed after the picture was scored.
fn is_changed(folder: &RunFolder, unit: &Unit) -> bool {
    let path = folder.prediction_path(&unit.slot.method, &unit.slot.pair_id, "png");
    let is_kept = |picture: &ScoredPicture| picture.file_sha256.is_some();
    unit.picture.as_ref().is_some_and(is_kept) && path.is_file() && !folder.has_picture(unit)
}

/// Scores each target's units on the region that all methods of the folder predict, ignoring methods that failed on the
/// pair. The results depend on the set of methods, so they are stored in a subfolder.
pub(super) fn score_common_region(
    folder: &RunFolder,
    pairs: &[ResolvedPair],
    scoring: &Scoring,
    keys: &Keys,
    memory: MemoryShares,
    observer: &dyn Observer,
) -> Result<(), EvaluateError> {
    let Some(mut manifest) = folder.manifest()? else {
        return Ok(());
    };
    let common_folder = folder.common_region();
    manifest.common_region = false;
    folder.write_manifest(&manifest)?;
    let current = Current::read(folder)?;
    manifest.common_region = true;
    folder.write_manifest(&manifest)?;
    let mut units: BTreeMap<&str, Vec<&Unit>> = BTreeMap::new();
    for unit in &current.units {
        units.entry(&unit.slot.pair_id).or_default().push(unit);
    }
    observer.begin("scoring the common region", pairs.len(), "pairs");
    for (done, planned) in pairs.iter().enumerate() {
        observer.progress(done, &planned.pair.pair_id);
        let of_pair = units
            .remove(planned.pair.pair_id.as_str())
            .unwrap_or_default();
        let intrinsics = &planned.target.intrinsics;
        let size = (intrinsics.width, intrinsics.height);
        let regions = of_pair
            .iter()
            .filter(|unit| unit.record.status == Status::Ok)
            .filter_map(|unit| unit.record.crop.map(|crop| crop.region));
        // If regions are disjoint, the common region is empty, and no prediction can be cropped to it.
        let nothing = Region {
            width: 0,
            height: 0,
            ..Region::whole(size)
        };
        let common = regions.fold(Region::whole(size), |common, region| {
            common.intersection(&region).unwrap_or(nothing)
        });
        let truth = PairTruth::new(*planned);
        for units in of_pair.chunks(memory.pictures_of(planned.target)) {
            let mut unscored = Vec::new();
            for unit in units {
                match cut(folder, unit, common, size) {
                    Cut::Failed(unit) => {
                        common_folder.save(*unit)?;
                    }
                    Cut::Picture(mut item) => {
                        let stored = common_folder.load(&item.unit.slot)?.filter(|stored| {
                            let sha256 =
                                |unit: &Unit| unit.picture.as_ref().map(|p| p.sha256.clone());
                            sha256(stored) == sha256(&item.unit)
                                && common_folder.has_picture(stored)
                        });
                        match stored {
                            Some(unit) => item.unit = unit,
                            None => keep_cut(&common_folder, &mut item)?,
                        }
                        if missing(&item.unit, scoring, keys, planned).is_empty() {
                            common_folder.save(item.unit)?;
                        } else {
                            unscored.push(*item);
                        }
                    }
                }
            }
            score_pair(&truth, unscored, scoring, keys, memory, &common_folder)?;
        }
    }
    observer.progress(pairs.len(), "");
    observer.end();
    Ok(())
}

/// Stores the part of a picture that is scored, so that reports can show it.
fn keep_cut(folder: &RunFolder, item: &mut Unscored) -> Result<(), EvaluateError> {
    let Slot {
        method, pair_id, ..
    } = &item.unit.slot;
    let path = folder.prediction_path(method, pair_id, "png");
    write_png(&path, &item.picture)?;
    if let Some(scored) = &mut item.unit.picture {
        scored.file_sha256 = Some(file_sha256(&path)?);
        scored.float_sha256 = None;
    }
    Ok(())
}

enum Cut {
    Failed(Box<Unit>),
    Picture(Box<Unscored>),
}

/// Crops a unit's picture to the region common to all methods. `size` is the target's width and height.
fn cut(folder: &RunFolder, unit: &Unit, common: Region, size: (u32, u32)) -> Cut {
    let mut unit = unit.clone();
    if unit.record.status != Status::Ok {
        return Cut::Failed(Box::new(unit));
    }
    let shown = unit
        .record
        .crop
        .map_or(Region::whole(size), |crop| crop.region);
    let cropped = common
        .within(&shown)
        .ok_or_else(|| {
            format!("the methods' common region is {common}, but this prediction covers {shown}")
        })
        .and_then(|inside| {
            let picture = kept_picture(folder, &unit).ok_or("the prediction was not kept")?;
            match inside.crop(&Picture::Rgb8(picture)).into_owned() {
                Picture::Rgb8(picture) => Ok(picture),
                Picture::RgbF32(_) => Err("kept predictions are 8 bit".to_owned()),
            }
        });
    match cropped {
        Ok(picture) => {
            if common != shown {
                unit.scores.clear();
            }
            unit.record.crop = crop(Some(common), size);
            if let Some(scored) = &mut unit.picture {
                scored.sha256 = picture_sha256(&picture);
            }
            Cut::Picture(Box::new(Unscored { unit, picture }))
        }
        Err(reason) => {
            unit.record.status = Status::Failed { reason };
            unit.scores.clear();
            Cut::Failed(Box::new(unit))
        }
    }
}
