//! Pairs as a file that can be published, verified against local files and compared.
//!
//! CSV with one header line and `\n` line endings; rows are sorted bytewise by `pair_id`. Numbers have the shortest
//! form that parses back to the same value, unknown values are empty fields, and `selected` is `true` or `false`.
//!
//! The SHA-256 of a list is computed from the file as read. It therefore changes if an editor changes the byte order
//! mark, line endings or order of rows.

mod csv_form;
mod diff;
mod verify;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use sharp_datasets::{Scene, View};

pub use self::csv_form::COLUMNS;

/// Start of a pair list's first line.
pub const LIST_MARK: &str = "pair_id,dataset,";

use self::csv_form::{SPREADSHEET, parse_row, to_csv};
pub use self::diff::{ChangedPair, ListDiff};
pub use self::verify::{HashMismatch, MovedCamera, Unreadable, Verification};
use super::dataset::OpenDataset;
use super::{Pair, PairError};
use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::hash::sha256_hex;

/// A list of pairs with its file.
#[derive(Debug, Clone, PartialEq)]
pub struct PairList {
    pub path: PathBuf,
    /// The rows in file order.
    pub pairs: Vec<Pair>,
    /// SHA-256 of the file, 64 lower-case hexadecimal digits.
    pub sha256: String,
    lines: Vec<u64>,
    bytes: Vec<u8>,
}

impl PairList {
    /// Creates a list of new pairs, to be written with [`Self::write`].
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
    /// [`PairError::File`] if the file cannot be read; [`PairError::List`] with the line of the first mistake: a
    /// missing column, an invalid number, an id that contradicts its row, a repeated pair.
    pub fn read(path: &Path) -> Result<Self, PairError> {
        let bytes = sharp::files::read(path).map_err(FileError::new(path, "read"))?;
        Self::parse(path, &bytes)
    }

    /// Like [`Self::read`], but from bytes; `path` is only used in errors.
    ///
    /// # Errors
    /// [`PairError::List`] with the line of the first mistake.
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
            let separators = [(";", "semicolons"), ("\t", "tabs")].into_iter();
            let mut separators = separators.filter(|(by, _)| {
                let columns = header.iter().flat_map(|field| field.split(by));
                columns.eq(COLUMNS)
            });
            let cause = separators.next().map_or_else(String::new, |(_, name)| {
                format!("; here, {name} separate them instead of commas: {SPREADSHEET}")
            });
            let columns = COLUMNS.join(",");
            return Err(wrong(1, format!("the columns must be {columns}{cause}")));
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

    /// The union of this list and a newer one. For a pair in both lists, keeps the newer row and marks it as selected
    /// if either row is.
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
            // If the older list adds nothing, keep the bytes of the newer list.
            return newer.clone();
        }
        for (id, mut pair) in new_pairs {
            pair.selected |= joined.get(&id).is_some_and(|before| before.selected);
            joined.insert(id, pair);
        }
        Self::new("pairs.csv", joined.into_values().collect())
    }

    /// The bytes of the file, which [`Self::sha256`] is computed from.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Writes the list to its path atomically.
    pub fn write(&self) -> Result<(), PairError> {
        Ok(write_atomic(&self.path, &self.bytes)?)
    }

    /// Finds the views of the pairs, including pairs that are not selected.
    ///
    /// # Errors
    /// [`PairError::List`] names the line and what is missing from the scenes.
    pub fn resolve<'a>(&'a self, scenes: &'a [Scene]) -> Result<Vec<ResolvedPair<'a>>, PairError> {
        self.resolve_readable(scenes, &[])
    }

    /// Like [`Self::resolve`], but skips a pair if its scene or one of its views could not be read.
    ///
    /// # Errors
    /// [`PairError::List`] names the line, and what is missing from the scenes or which scene a setting of its dataset
    /// excludes.
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
                        "scene '{}' of dataset '{}' is excluded: {}",
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
        "dataset '{}' is not given (given: {})",
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
