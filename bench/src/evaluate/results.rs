//! The results of a folder, computed only from its units, manifest and pair list.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::doubts::{doubts_of, joint_doubts, rule_notes};
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::manifest::{Manifest, MethodRecord, PairsRecord};
use super::plan::RunPlan;
use super::record::{Record, Score, Status, file_difference, finite_or_text};
use super::unit::{ScoredPicture, Slot, Unit};
use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::hash::file_sha256;
use crate::io::text::{csv_bytes, csv_cell};
use crate::methods::MAX_EXTRAS;
use crate::pairs::{Pair, PairList};

/// The results of a run folder.
#[derive(Debug, Clone)]
pub struct Results {
    pub manifest: Manifest,
    /// One record per unit, sorted by pair id, then in the order of the methods.
    pub records: Vec<Record>,
    /// Pair id and method of planned units without a result.
    pub missing: BTreeSet<(String, String)>,
    pub pictures: Vec<PictureFolder>,
    /// Damaged files of units; these units count as missing.
    pub damaged: Vec<PathBuf>,
    /// Whether the user listed the methods to show; see [`Shown`](super::Shown).
    pub methods_listed: bool,
}

/// A folder of kept pictures, and how its labels relate to the results.
#[derive(Debug, Clone)]
pub struct PictureFolder {
    pub folder: RunFolder,
    /// Maps labels in the results to labels in this folder.
    pub labels: BTreeMap<String, String>,
    /// SHA-256 of each kept file, keyed by pair id and the method's label in the folder.
    pub sha256: BTreeMap<(String, String), String>,
    /// SHA-256 of each kept linear rendering, with the keys of [`Self::sha256`].
    pub float_sha256: BTreeMap<(String, String), String>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeptPicture {
    pub path: PathBuf,
    /// Whether the file's bytes are still those of the scored picture.
    pub is_scored: bool,
}

#[derive(Debug, Clone)]
pub(super) struct Current {
    pub(super) manifest: Manifest,
    pub(super) units: Vec<Unit>,
    pub(super) missing: BTreeSet<(String, String)>,
    pub(super) damaged: Vec<PathBuf>,
}

impl Current {
    /// The units of a folder that count as results; see `Manifest::counted_slots`.
    pub(super) fn read(folder: &RunFolder) -> Result<Self, EvaluateError> {
        let Some(manifest) = folder.manifest()? else {
            let path = folder.root().join("manifest.json");
            let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
            return Err(FileError::new(&path, "read")(missing).into());
        };
        let (mut units, damaged) = units_folder(folder, &manifest).units()?;
        let counts = manifest.counted_slots();
        units.retain(|unit| counts(&unit.slot));
        drop(counts);
        let labels = manifest.methods.iter().map(|method| method.label.as_str());
        let places: BTreeMap<&str, usize> = labels.zip(0..).collect();
        let order = |unit: &Unit| places.get(unit.slot.method.as_str()).copied();
        units.sort_by(|a, b| {
            let by_pair = a.slot.pair_id.cmp(&b.slot.pair_id);
            by_pair.then_with(|| order(a).cmp(&order(b)))
        });
        let done: BTreeSet<(&str, &str)> = units
            .iter()
            .filter(|unit| unit.is_done())
            .map(|unit| (unit.slot.pair_id.as_str(), unit.slot.method.as_str()))
            .collect();
        let plan = folder.plan()?;
        let planned = plan.units();
        let missing = planned.difference(&done);
        let missing = missing.map(|(pair, method)| ((*pair).to_owned(), (*method).to_owned()));
        let missing = missing.collect();
        Ok(Self {
            missing,
            damaged,
            units,
            manifest,
        })
    }

    /// Fails if rows were removed from the pair list or the plan after the manifest was written, or if the list
    /// contradicts the units.
    fn check_list(&self, folder: &RunFolder, list: &PairList) -> Result<(), EvaluateError> {
        let said = &self.manifest.pairs;
        check_rows(folder, said, &folder.plan()?, list)?;
        let pairs: BTreeMap<&str, &Pair> =
            list.pairs.iter().map(|p| (p.pair_id.as_str(), p)).collect();
        let moved = self.units.iter().find(|unit| {
            let pair = pairs.get(unit.slot.pair_id.as_str());
            pair.is_some_and(|pair| {
                let (record, bits) = (&unit.record, |v: Option<f64>| v.map(f64::to_bits));
                record.baseline_m.to_bits() != pair.baseline_m.to_bits()
                    || record.rotation_deg.to_bits() != pair.rotation_deg.to_bits()
                    || bits(record.median_depth_m) != bits(pair.median_depth_m)
                    || bits(record.overlap) != bits(pair.overlap)
            })
        });
        match moved.filter(|_| list.sha256 != said.sha256) {
            Some(unit) => {
                let pair = &unit.slot.pair_id;
                let what = format!(
                    "the cameras of pair '{pair}' in pairs.csv differ from those of the run"
                );
                Err(changed(folder, &what))
            }
            None => Ok(()),
        }
    }

    /// The records of the units, with distances and overlap from the pair list.
    pub(super) fn records(&self, pairs: &[Pair]) -> Vec<Record> {
        let metrics = self.manifest.metric_identities();
        let pairs: BTreeMap<&str, &Pair> = pairs.iter().map(|p| (p.pair_id.as_str(), p)).collect();
        let done = || self.units.iter().filter(|unit| unit.is_done());
        // Limit the number of names: each becomes a column, and external programs may report other names for each pair.
        let mut names: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
        for Unit { slot, record, .. } in done() {
            let of_method = names.entry(&slot.method).or_default();
            of_method.extend(record.extras.keys().map(String::as_str));
        }
        let shown: BTreeMap<&str, BTreeSet<&str>> = names
            .into_iter()
            .map(|(method, names)| (method, names.into_iter().take(MAX_EXTRAS).collect()))
            .collect();
        done()
            .map(|unit| {
                let mut record = unit.record_with(&metrics);
                let shown = shown.get(record.method.as_str());
                record
                    .extras
                    .retain(|name, _| shown.is_some_and(|names| names.contains(name.as_str())));
                if let Some(pair) = pairs.get(record.pair_id.as_str()) {
                    record.baseline_m = pair.baseline_m;
                    record.rotation_deg = pair.rotation_deg;
                    record.median_depth_m = pair.median_depth_m;
                    record.overlap = pair.overlap;
                }
                record
            })
            .collect()
    }
}

/// Fails if rows were removed from the pair list or the plan after the manifest was written.
pub(super) fn check_rows(
    folder: &RunFolder,
    said: &PairsRecord,
    plan: &RunPlan,
    list: &PairList,
) -> Result<(), EvaluateError> {
    let planned = plan.pairs();
    let listed: BTreeSet<&str> = list.pairs.iter().map(|p| p.pair_id.as_str()).collect();
    let what = if listed.len() < said.listed {
        format!(
            "pairs.csv has {} of the {} pairs of the run",
            listed.len(),
            said.listed
        )
    } else if planned.len() < said.evaluated {
        format!(
            "plan.json has {} of the {} pairs of the run",
            planned.len(),
            said.evaluated
        )
    } else if let Some(pair) = planned.iter().find(|id| !listed.contains(**id)) {
        format!("pairs.csv is missing pair '{pair}' of the run")
    } else {
        return Ok(());
    };
    Err(changed(folder, &what))
}

fn changed(folder: &RunFolder, what: &str) -> EvaluateError {
    EvaluateError::NotKept {
        folder: folder.root().to_owned(),
        reason: format!(
            "{what}, so the file was changed after manifest.json was written; `run` with the same options rewrites it"
        ),
    }
}

/// The folder with the units to show in tables: the subfolder with the scores on the common region if the run has one,
/// otherwise `folder`.
pub(super) fn units_folder(folder: &RunFolder, manifest: &Manifest) -> RunFolder {
    if manifest.common_region {
        folder.common_region()
    } else {
        folder.clone()
    }
}

impl Results {
    /// Reads a run folder; the run may be unfinished.
    ///
    /// # Errors
    /// If it is not a run folder, has another format, or pairs have been removed from its pair list or plan.
    pub(super) fn of_folder(root: &Path) -> Result<Self, EvaluateError> {
        let folder = RunFolder::open(root)?;
        let current = Current::read(&folder)?;
        current.check_list(&folder, &PairList::read(&folder.pairs_path())?)?;
        Self::of(&folder, &current)
    }

    fn of(folder: &RunFolder, current: &Current) -> Result<Self, EvaluateError> {
        if let Some(difference) = file_difference(current.units.iter().map(|unit| &unit.record)) {
            return Err(EvaluateError::NotKept {
                folder: folder.root().to_owned(),
                reason: format!(
                    "{difference}; run again with the same files for all results, in this folder or another"
                ),
            });
        }
        let list = PairList::read(&folder.pairs_path())?;
        let labels = current.manifest.methods.iter();
        let labels = labels.map(|method| (method.label.clone(), method.label.clone()));
        let kept = |sha256: fn(&ScoredPicture) -> &Option<String>| {
            let kept = current.units.iter().filter_map(|unit| {
                let sha256 = sha256(unit.picture.as_ref()?).clone()?;
                let Slot {
                    pair_id, method, ..
                } = unit.slot.clone();
                Some(((pair_id, method), sha256))
            });
            kept.collect()
        };
        Ok(Self {
            records: current.records(&list.pairs),
            missing: current.missing.clone(),
            damaged: current.damaged.clone(),
            pictures: vec![PictureFolder {
                labels: labels.collect(),
                sha256: kept(|picture| &picture.file_sha256),
                float_sha256: kept(|picture| &picture.float_sha256),
                folder: units_folder(folder, &current.manifest).unlocked(),
            }],
            manifest: current.manifest.clone(),
            methods_listed: false,
        })
    }

    /// Replaces each method's label with the label that `renamed` returns for it.
    pub(super) fn relabel(&mut self, renamed: impl Fn(&str) -> String) {
        for record in &mut self.records {
            record.method = renamed(&record.method);
        }
        for method in &mut self.manifest.methods {
            method.label = renamed(&method.label);
        }
        let missing = std::mem::take(&mut self.missing).into_iter();
        self.missing = missing
            .map(|(pair, method)| (pair, renamed(&method)))
            .collect();
        for pictures in &mut self.pictures {
            let labels = std::mem::take(&mut pictures.labels).into_iter();
            pictures.labels = labels
                .map(|(label, kept)| (renamed(&label), kept))
                .collect();
        }
    }

    /// Warnings that depend on all results of a method; see `joint_doubts`.
    pub fn warnings(&self) -> Vec<String> {
        let of = |method: &MethodRecord| {
            let own = self.records.iter().filter(|r| r.method == method.label);
            let found = joint_doubts(own, &method.identity.kind).into_iter();
            let named = found.map(|text| format!("method '{}': {text}", method.label));
            named.collect::<Vec<_>>()
        };
        self.manifest.methods.iter().flat_map(of).collect()
    }

    pub fn failures(&self) -> usize {
        let failed = self.records.iter().filter(|r| r.status != Status::Ok);
        failed.count()
    }

    /// The kept picture of a record; if several folders have one, preferably a picture whose bytes were scored.
    pub fn kept_picture(&self, record: &Record) -> Option<KeptPicture> {
        self.kept(record, "png", |pictures| &pictures.sha256)
    }

    /// The kept floating-point rendering of a record (linear RGB and alpha), chosen like [`Self::kept_picture`].
    pub fn kept_rendering(&self, record: &Record) -> Option<KeptPicture> {
        self.kept(record, "exr", |pictures| &pictures.float_sha256)
    }

    fn kept(
        &self,
        record: &Record,
        extension: &str,
        hashes: fn(&PictureFolder) -> &BTreeMap<(String, String), String>,
    ) -> Option<KeptPicture> {
        let kept = self.pictures.iter().filter_map(|pictures| {
            let label = pictures.labels.get(&record.method)?;
            let unit = (record.pair_id.clone(), label.clone());
            // Use only pictures of known units: others are not part of the run.
            let sha256 = hashes(pictures).get(&unit)?;
            let path = pictures.folder.prediction_path(label, &unit.0, extension);
            path.is_file().then(|| KeptPicture {
                is_scored: file_sha256(&path).is_ok_and(|found| found == *sha256),
                path,
            })
        });
        let kept: Vec<KeptPicture> = kept.collect();
        let scored = kept.iter().find(|picture| picture.is_scored);
        scored.or(kept.first()).cloned()
    }
}

/// Writes `scores.csv` and `timings.csv` of a folder from its units.
///
/// # Errors
/// If the folder cannot be read or written.
pub(super) fn write_tables(folder: &RunFolder) -> Result<Results, EvaluateError> {
    let current = Current::read(folder)?;
    let mut results = Results::of(folder, &current)?;
    let keys: Vec<String> = results
        .manifest
        .metrics
        .iter()
        .map(|m| m.info.key.to_string())
        .collect();
    let scores = scores_csv(&results.records, &keys);
    write_atomic(&folder.scores_path(), &scores)?;
    let timings = timings_csv(current.units.iter().filter(|unit| unit.is_done()));
    write_atomic(&folder.timings_path(), &timings)?;
    for method in &mut results.manifest.methods {
        let own = results.records.iter().filter(|r| r.method == method.label);
        method.drawn = rule_notes(own.clone());
        method.warnings = doubts_of(own, &method.identity.kind);
    }
    if results.manifest != current.manifest {
        folder.write_manifest(&results.manifest)?;
    }
    Ok(results)
}

/// Names of the columns of `scores.csv` that precede the metrics.
pub const FIXED_COLUMNS: [&str; 11] = [
    "pair_id",
    "dataset",
    "scene",
    "source",
    "target",
    "method",
    "baseline_m",
    "rotation_deg",
    "median_depth_m",
    "overlap",
    "status",
];

/// The shortest text that parses to the same number, including `inf`, `-inf` and `nan`.
pub fn number(value: f64) -> String {
    finite_or_text::text(value).map_or_else(|| value.to_string(), str::to_owned)
}

/// The table as CSV. Its columns are [`FIXED_COLUMNS`], one per metric key in the given order, the records' extras
/// (`mean_alpha`, …) by name, and the reason for a failure. Unavailable scores and unknown values are empty cells.
pub fn scores_csv(records: &[Record], metric_keys: &[String]) -> Vec<u8> {
    let extras: BTreeSet<&str> = records
        .iter()
        .flat_map(|record| record.reported().into_keys())
        .collect();
    let header = FIXED_COLUMNS
        .iter()
        .copied()
        .chain(metric_keys.iter().map(String::as_str))
        .chain(extras.iter().copied())
        .chain(["reason"]);
    let optional = |value: Option<f64>| value.map_or_else(String::new, number);
    let rows = records.iter().map(|record| {
        let (status, reason) = match &record.status {
            Status::Ok => ("ok", ""),
            Status::Failed { reason } => ("failed", reason.as_str()),
        };
        let text = |text: &str| csv_cell(text).into_owned();
        let mut row = vec![
            text(&record.pair_id),
            text(&record.dataset),
            text(&record.scene),
            text(&record.source),
            text(&record.target),
            text(&record.method),
            number(record.baseline_m),
            number(record.rotation_deg),
            optional(record.median_depth_m),
            optional(record.overlap),
            status.to_owned(),
        ];
        row.extend(
            metric_keys
                .iter()
                .map(|key| optional(record.scores.get(key).and_then(Score::value))),
        );
        let reported = record.reported();
        row.extend(
            extras
                .iter()
                .map(|name| optional(reported.get(name).copied())),
        );
        row.push(text(reason));
        row
    });
    csv_bytes(header, rows)
}

/// Wall times of each unit's stages in seconds, as CSV; see [`Timing`].
fn timings_csv<'a>(units: impl Iterator<Item = &'a Unit>) -> Vec<u8> {
    let head = [
        "pair_id",
        "method",
        "predict_secs",
        "render_secs",
        "score_secs",
    ];
    let rows = units.map(|unit| {
        let timing = &unit.timing;
        let secs = [timing.predict_secs, timing.render_secs, timing.score_secs];
        let secs = secs.map(|secs| format!("{secs:.3}"));
        let words = [&unit.slot.pair_id, &unit.slot.method].map(|text| csv_cell(text).into_owned());
        words.into_iter().chain(secs)
    });
    csv_bytes(head, rows)
}
