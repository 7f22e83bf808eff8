//! Pairs as a file that can be published, verified against someone's files and compared.
//!
//! CSV with one header line, `\n` at line ends, rows sorted bytewise by `pair_id`, numbers in the
//! shortest form that reads back to the same value, an empty field where a value is unknown,
//! `selected` as `true` or `false`. The sha256 of a list is that of the file, whose bytes are kept: a copy of a list that
//! someone's editor gave a byte order mark, other line ends or another order is that very file.

mod csv_form;
mod diff;
mod verify;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use sharp_datasets::{Scene, View};

pub use self::csv_form::COLUMNS;

/// Start of our lists.
pub const LIST_MARK: &str = "pair_id,dataset,";

use self::csv_form::{parse_row, to_csv};
pub use self::diff::{ChangedPair, ListDiff};
pub use self::verify::{HashMismatch, MovedCamera, Unreadable, Verification};
use super::PairError;
use super::build::Pair;
use super::dataset::OpenDataset;
use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::hash::sha256_hex;

/// A list of pairs and where each came from.
#[derive(Debug, Clone, PartialEq)]
pub struct PairList {
    pub path: PathBuf,
    /// The rows in file order.
    pub pairs: Vec<Pair>,
    /// sha256 of the file, 64 lower-case hexadecimal digits.
    pub sha256: String,
    lines: Vec<u64>,
    bytes: Vec<u8>,
}

impl PairList {
    /// A list of pairs that were just made, for [`Self::write`].
    pub fn new(path: impl Into<PathBuf>, mut pairs: Vec<Pair>) -> Self {
        pairs.sort_by(|a, b| a.pair_id.cmp(&b.pair_id));
        let bytes = to_csv(&pairs).into_bytes();
        Self {
            path: path.into(),
            lines: (2..).take(pairs.len()).collect(),
            pairs,
            sha256: sha256_hex(&bytes),
            bytes,
        }
    }

    /// Reads and checks a list.
    ///
    /// # Errors
    /// [`PairError::File`]; [`PairError::List`] with the line of the first thing that is wrong: a
    /// missing column, an unreadable number, an id that disagrees with its row, a pair given twice.
    pub fn read(path: &Path) -> Result<Self, PairError> {
        let bytes = sharp::files::read(path).map_err(FileError::new(path, "read"))?;
        Self::parse(path, &bytes)
    }

    /// As [`Self::read`], from bytes; `path` is for errors only.
    ///
    /// # Errors
    /// As [`Self::read`], without the first.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, PairError> {
        let wrong = |line: u64, reason: String| PairError::List {
            path: path.to_owned(),
            line,
            reason,
        };
        let mut reader = csv::Reader::from_reader(bytes);
        let header = reader
            .headers()
            .map_err(|error| wrong(1, error.to_string()))?;
        if !header.iter().eq(COLUMNS) {
            return Err(wrong(
                1,
                format!("the columns have to be {}", COLUMNS.join(",")),
            ));
        }
        let mut list = Self {
            path: path.to_owned(),
            pairs: Vec::new(),
            lines: Vec::new(),
            sha256: sha256_hex(bytes),
            bytes: bytes.to_vec(),
        };
        let mut seen = BTreeSet::new();
        let mut row = csv::StringRecord::new();
        loop {
            let line = reader.position().line();
            match reader.read_record(&mut row) {
                Ok(false) => return Ok(list),
                Ok(true) => {}
                Err(error) => return Err(wrong(line, error.to_string())),
            }
            let line = row.position().map_or(line, csv::Position::line);
            let pair = parse_row(&row).map_err(|reason| wrong(line, reason))?;
            if !seen.insert(pair.pair_id.clone()) {
                return Err(wrong(
                    line,
                    format!("pair '{}' is given twice", pair.pair_id),
                ));
            }
            list.pairs.push(pair);
            list.lines.push(line);
        }
    }

    /// The pairs of this list and a newer one. A pair of both is as the newer one says, and selected where either does.
    #[must_use]
    pub fn joined(&self, newer: &Self) -> Self {
        let by_id = |list: &Self| -> BTreeMap<String, Pair> {
            let pairs = list.pairs.iter();
            pairs
                .map(|pair| (pair.pair_id.clone(), pair.clone()))
                .collect()
        };
        let (mut joined, new_pairs) = (by_id(self), by_id(newer));
        let covered = |pair: &Pair| {
            let same = new_pairs.get(&pair.pair_id);
            same.is_some_and(|new| new.selected || !pair.selected)
        };
        if joined.values().all(covered) {
            // Nothing is added to the newer list: its bytes stay as they were handed in.
            return newer.clone();
        }
        for (id, mut pair) in new_pairs {
            pair.selected |= joined.get(&id).is_some_and(|before| before.selected);
            joined.insert(id, pair);
        }
        Self::new("pairs.csv", joined.into_values().collect())
    }

    /// The file as it was read or made: what [`Self::sha256`] is of.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Writes the list to its path: whole or not at all.
    pub fn write(&self) -> Result<(), PairError> {
        Ok(write_atomic(&self.path, &self.bytes)?)
    }

    /// Finds the views of the pairs. Pairs that are not selected are resolved too.
    ///
    /// # Errors
    /// [`PairError::List`] naming the line and what is absent from the scenes.
    pub fn resolve<'a>(&'a self, scenes: &'a [Scene]) -> Result<Vec<ResolvedPair<'a>>, PairError> {
        self.resolve_readable(scenes, &[])
    }

    /// As [`Self::resolve`], without the pairs of scenes and views that could not be read.
    ///
    /// # Errors
    /// As [`Self::resolve`]; also for a scene that a setting of its dataset rules out.
    pub fn resolve_readable<'a>(
        &'a self,
        scenes: &'a [Scene],
        datasets: &[OpenDataset],
    ) -> Result<Vec<ResolvedPair<'a>>, PairError> {
        let mut by_name = BTreeMap::new();
        for scene in scenes {
            let views: BTreeMap<&str, &View> =
                scene.views.iter().map(|v| (v.id.as_str(), v)).collect();
            by_name.insert((scene.dataset.as_str(), scene.id.as_str()), (scene, views));
        }
        let resolve_one = |(pair, &line): (&'a Pair, &u64)| {
            let absent = |what: String| PairError::List {
                path: self.path.clone(),
                line,
                reason: what,
            };
            let name = (pair.dataset.as_str(), pair.scene.as_str());
            let Some((scene, views)) = by_name.get(&name) else {
                let dataset = datasets.iter().find(|d| d.name == pair.dataset);
                return match dataset.and_then(|d| d.leaves_out(&pair.scene)) {
                    Some(group) if !group.by_choice => Ok(None),
                    Some(group) => Err(absent(format!(
                        "scene '{}' of dataset '{}' is ruled out: {}",
                        pair.scene, pair.dataset, group.reason
                    ))),
                    None => Err(absent(absent_scene(pair, scenes))),
                };
            };
            let is_broken = |view: &String| *view == pair.source || *view == pair.target;
            let mut broken = scene.left_out.iter().flat_map(|group| &group.views);
            if broken.any(is_broken) {
                return Ok(None);
            }
            let view = |id: &str| {
                views.get(id).copied().ok_or_else(|| {
                    absent(format!(
                        "view '{id}' is not in scene '{}' of dataset '{}'",
                        pair.scene, pair.dataset
                    ))
                })
            };
            Ok(Some(ResolvedPair {
                pair,
                scene,
                source: view(&pair.source)?,
                target: view(&pair.target)?,
            }))
        };
        let rows = self.pairs.iter().zip(&self.lines);
        rows.filter_map(|row| resolve_one(row).transpose())
            .collect()
    }
}

#[derive(Debug, Clone, Copy)]
pub struct ResolvedPair<'a> {
    pub pair: &'a Pair,
    pub scene: &'a Scene,
    pub source: &'a View,
    pub target: &'a View,
}

fn absent_scene(pair: &Pair, scenes: &[Scene]) -> String {
    if scenes.iter().any(|scene| scene.dataset == pair.dataset) {
        return format!(
            "scene '{}' is not in dataset '{}'",
            pair.scene, pair.dataset
        );
    }
    let given: BTreeSet<&str> = scenes.iter().map(|s| s.dataset.as_str()).collect();
    let given: Vec<&str> = given.into_iter().collect();
    format!(
        "dataset '{}' is not given; given: {}",
        pair.dataset,
        if given.is_empty() {
            "none".to_owned()
        } else {
            given.join(", ")
        }
    )
}

#[cfg(test)]
mod tests;
