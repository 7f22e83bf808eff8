//! Combines folders. A unit that occurs in several folders is kept once. If folders contradict each other, the error
//! states how.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::aggregation::Aggregation;
use super::differences::{Purpose, joined, refusal};
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::plan::RunPlan;
use super::record::{Record, file_difference};
use super::results::{Current, Results, write_tables};
use super::unit::Unit;
use crate::io::atomic_files::{FileError, write_atomic};
use crate::pairs::PairList;

/// A folder to join, `NAME=FOLDER` or `FOLDER`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Prefix for the label of each method; if the folder has only one method, its whole label.
    pub name: Option<String>,
    pub path: PathBuf,
}

/// A name that a folder cannot have, because it contains a control character.
#[derive(Debug, thiserror::Error)]
#[error("the name '{}' contains a control character", .0.escape_debug())]
pub struct NameError(String);

impl std::str::FromStr for Named {
    type Err = NameError;

    /// Splits at the first `=`, unless the whole text is an existing path or the name would be empty.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let plain = Self {
            name: None,
            path: text.into(),
        };
        match text.split_once('=') {
            Some((name, path)) if !plain.path.exists() && !name.is_empty() => {
                if name.contains(char::is_control) {
                    return Err(NameError(name.to_owned()));
                }
                Ok(Self {
                    name: Some(name.to_owned()),
                    path: path.into(),
                })
            }
            _ => Ok(plain),
        }
    }
}

/// Reads folders or bundles as one set of results.
///
/// # Errors
/// If a folder or bundle cannot be read, or two of them contradict each other.
pub fn join(folders: &[Named]) -> Result<Results, EvaluateError> {
    join_under(folders, None)
}

/// Like [`join`], but if `aggregation` is given, averages all results by it, even if the runs used another rule.
///
/// # Errors
/// Those of [`join`].
pub fn join_under(
    folders: &[Named],
    aggregation: Option<Aggregation>,
) -> Result<Results, EvaluateError> {
    let read: Result<Vec<_>, EvaluateError> = folders
        .iter()
        .map(|folder| {
            let mut results = Results::read(&folder.path)?;
            if let Some(aggregation) = aggregation {
                results.manifest.aggregate(aggregation);
            }
            Ok((folder.clone(), results))
        })
        .collect();
    join_results(read?)
}

/// Like [`join`], for results in memory.
///
/// # Errors
/// If two of them contradict each other.
pub fn join_results(
    read: impl IntoIterator<Item = (Named, Results)>,
) -> Result<Results, EvaluateError> {
    let mut joined: Option<(PathBuf, Results)> = None;
    for (folder, mut results) in read {
        if let Some(name) = &folder.name {
            let methods = results.manifest.methods.len();
            results.relabel(|label| label_under(name, label, methods));
        }
        joined = Some(match joined {
            None => (folder.path.clone(), results),
            Some((first, before)) => {
                let results = joined_results(before, results).map_err(|difference| {
                    EvaluateError::Conflict {
                        a: first.clone(),
                        b: folder.path.clone(),
                        difference,
                    }
                })?;
                (first, results)
            }
        });
    }
    match joined {
        Some((_, results)) => Ok(results),
        None => Err(
            FileError::new(Path::new(""), "report")(std::io::Error::other(
                "no run folder is given",
            ))
            .into(),
        ),
    }
}

/// The label of a method in a run called `name`; see [`Named::name`].
pub(crate) fn label_under(name: &str, label: &str, methods: usize) -> String {
    match methods {
        1 => name.to_owned(),
        _ => format!("{name}/{label}"),
    }
}

/// Joins two results. The error is the first contradiction.
fn joined_results(a: Results, b: Results) -> Result<Results, String> {
    let manifest = joined(a.manifest, b.manifest)?;
    let mut records: BTreeMap<(String, String), Record> = BTreeMap::new();
    for record in a.records.into_iter().chain(b.records) {
        let key = (record.pair_id.clone(), record.method.clone());
        match records.remove(&key) {
            None => records.insert(key, record),
            Some(before) => {
                let joined = joined_records(before, record)
                    .map_err(|what| format!("{what} of {} on {} differs", key.1, key.0))?;
                records.insert(key, joined)
            }
        };
    }
    if let Some(difference) = file_difference(records.values()) {
        return Err(difference);
    }
    let order: BTreeMap<&str, usize> = manifest
        .methods
        .iter()
        .enumerate()
        .map(|(at, method)| (method.label.as_str(), at))
        .collect();
    let mut records: Vec<Record> = records.into_values().collect();
    records.sort_by(|a, b| {
        let at = |record: &Record| order.get(record.method.as_str()).copied();
        a.pair_id.cmp(&b.pair_id).then_with(|| at(a).cmp(&at(b)))
    });
    // A unit missing in one input may exist in the other.
    let mut missing = a.missing;
    missing.extend(b.missing);
    for record in &records {
        missing.remove(&(record.pair_id.clone(), record.method.clone()));
    }
    let mut pictures = a.pictures;
    pictures.extend(b.pictures);
    let mut damaged = a.damaged;
    damaged.extend(b.damaged);
    damaged.dedup();
    Ok(Results {
        damaged,
        manifest,
        records,
        missing,
        pictures,
        methods_listed: false,
    })
}

/// Joins two records of the same unit. The error names the contradiction.
fn joined_records(mut a: Record, b: Record) -> Result<Record, String> {
    let bits = |v: Option<f64>| v.map(f64::to_bits);
    if let Some(what) = a.differing_fact(&b) {
        return Err(what.to_owned());
    }
    if a.status != b.status {
        return Err("the outcome".to_owned());
    }
    for (key, score) in b.scores {
        match a.scores.get(&key) {
            Some(before) if before.value().is_some() => {
                if let Some(value) = score.value()
                    && bits(before.value()) != Some(value.to_bits())
                {
                    return Err(key);
                }
            }
            _ => {
                a.scores.insert(key, score);
            }
        }
    }
    Ok(a)
}

/// Joins folders into `out`, or rewrites the tables of a single folder.
///
/// # Errors
/// If a folder cannot be read or written, or two of them contradict each other.
pub fn merge(folders: &[PathBuf], out: Option<&Path>) -> Result<Results, EvaluateError> {
    let out = match (folders, out) {
        ([folder], None) => {
            let results = Results::read(folder)?;
            // Shards may be running; their units count as soon as they are written.
            let folder = RunFolder::join(folder)?;
            folder.remove_old_leftovers();
            if results.missing.is_empty() {
                return write_tables(&folder);
            }
            // Only finished runs have tables.
            folder.remove_tables()?;
            return Ok(results);
        }
        (_, Some(out)) => out,
        (_, None) => return Err(EvaluateError::NoOutput),
    };
    let named: Vec<Named> = folders
        .iter()
        .map(|path| Named {
            name: None,
            path: path.clone(),
        })
        .collect();
    let joined = join(&named)?;
    let mut manifest = joined.manifest;
    let mut opened = Vec::new();
    for path in folders {
        let folder = RunFolder::open(path)?;
        let current = Current::read(&folder)?;
        if let Some(difference) = refusal(&manifest, &current.manifest, Purpose::Merged) {
            return Err(EvaluateError::Conflict {
                a: folders[0].clone(),
                b: path.clone(),
                difference: difference.to_string(),
            });
        }
        opened.push((folder, current));
    }
    let target = RunFolder::create(out)?;
    let mut list: Option<PairList> = None;
    let mut plan = RunPlan::default();
    for (folder, current) in opened {
        let of_folder = PairList::read(&folder.pairs_path())?;
        list = Some(match list {
            None => of_folder,
            Some(before) => before.joined(&of_folder),
        });
        for block in folder.plan()?.blocks {
            plan = plan.with(block);
        }
        for unit in current.units {
            copy_unit(&folder, &target, unit)?;
        }
    }
    if let Some(list) = list {
        manifest.pairs.sha256.clone_from(&list.sha256);
        manifest.pairs.listed = list.pairs.len();
        manifest.pairs.evaluated = plan.pairs().len();
        write_atomic(&target.pairs_path(), list.bytes())?;
    }
    target.write_plan(&plan)?;
    target.write_manifest(&manifest)?;
    write_tables(&target)
}

/// Copies a unit with its pictures; keeps the scores of an existing copy.
fn copy_unit(from: &RunFolder, to: &RunFolder, mut unit: Unit) -> Result<(), EvaluateError> {
    if let Some(before) = to.load(&unit.slot)? {
        for (key, score) in before.scores {
            unit.scores.entry(key).or_insert(score);
        }
    }
    for extension in ["png", "exr"] {
        let path = |folder: &RunFolder| {
            folder.prediction_path(&unit.slot.method, &unit.slot.pair_id, extension)
        };
        let (source, copy) = (path(from), path(to));
        if source.is_file() && !copy.is_file() {
            let bytes = fs::read(&source).map_err(FileError::new(&source, "read"))?;
            write_atomic(&copy, &bytes)?;
        }
    }
    to.save(unit)?;
    Ok(())
}
