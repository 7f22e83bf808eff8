//! Runs over time.
//!
//! A history is a folder of entries `0001.zip`, `0002.zip`, …, each the [`Bundle`] of a run with
//! its [`Occasion`]. Entries are never changed and are numbered in the order in which they were
//! added. Adding the same results again with the same label and commit has no effect.
//!
//! * [`add`] adds a run; [`read`] reads all runs as [`Series`], one per method, dataset and metric.
//! * `trend` finds change points; [`csv`], [`text`] and [`page`] write the series for programs,
//!   terminals and browsers.

pub mod csv;
pub mod page;
pub mod text;
mod trend;

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

pub use trend::{Mark, Point, Rule, Series};

use crate::evaluate::bundle::read_head;
use crate::evaluate::{Bundle, EvaluateError, Occasion};
use crate::io::atomic_files::{FileError, PartialFile};
use crate::io::calendar::{is_date, minute};
use crate::io::text::visible_line;
use trend::Trend;

/// Maximum length of a label or commit, characters.
const LONGEST: usize = 120;

/// Why a history cannot be read or extended.
#[derive(Debug, thiserror::Error)]
pub enum HistoryError {
    /// The run to add, or an entry, cannot be read.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The label, commit or date is invalid.
    #[error("{0}")]
    Occasion(String),
    /// The folder is not a history, because it has no entry, or no further entry can be added.
    #[error("{}: {reason}", dir.display())]
    NoHistory { dir: PathBuf, reason: String },
}

#[derive(Debug)]
struct Entry {
    /// Number of the entry: 1 for the entry that was added first, and so on.
    number: u32,
    occasion: Occasion,
    bundle: Bundle,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Added {
    /// File of the entry with the run.
    pub path: PathBuf,
    pub number: u32,
    pub occasion: Occasion,
    /// False if the entry already existed.
    pub is_new: bool,
    /// Why entries could not be read, one line each.
    pub damaged: Vec<String>,
}

/// All entries and series of a history.
#[derive(Debug, Clone)]
pub struct History {
    /// Number and metadata of each entry, in ascending order of numbers.
    pub entries: Vec<(u32, Occasion)>,
    /// Series by metric, dataset and method, in the order in which they first appear.
    pub series: Vec<Series>,
    /// Why entries could not be read, one line each.
    pub damaged: Vec<String>,
}

impl History {
    /// The points of all series, series by series.
    pub fn points(&self) -> impl Iterator<Item = &Point> {
        self.series.iter().flat_map(|series| &series.points)
    }

    /// Metadata of an entry; `None` if there is no such entry.
    pub fn occasion(&self, number: u32) -> Option<&Occasion> {
        let at = self.entries.binary_search_by_key(&number, |(n, _)| *n);
        at.ok().map(|at| &self.entries[at].1)
    }

    /// Labels of methods in order of first appearance.
    pub fn methods(&self) -> Vec<&str> {
        let mut methods: Vec<&str> = Vec::new();
        for series in &self.series {
            if !methods.contains(&series.method.as_str()) {
                methods.push(&series.method);
            }
        }
        methods
    }
}

/// Metadata of a run. The label defaults to the name of the run's folder or file, the date to now.
///
/// # Errors
/// [`HistoryError::Occasion`] if the label, the commit or the date has an invalid form.
pub fn occasion(
    run: &Path,
    label: Option<&str>,
    commit: Option<&str>,
    date: Option<&str>,
) -> Result<Occasion, HistoryError> {
    let name = || {
        // The canonical path has a name even if the given path is `.`.
        let run = fs::canonicalize(run).unwrap_or_else(|_| run.to_owned());
        let name = if run.is_dir() {
            run.file_name()
        } else {
            run.file_stem()
        };
        let name = name.map(|name| name.to_string_lossy().into_owned());
        let name: String = name.unwrap_or_default().chars().take(LONGEST).collect();
        visible_line(&name).into_owned()
    };
    let occasion = Occasion {
        label: label.map_or_else(name, str::to_owned),
        commit: commit.map(str::to_owned),
        date: date.map_or_else(|| minute(SystemTime::now()), str::to_owned),
    };
    check(&occasion).map_err(HistoryError::Occasion)?;
    Ok(occasion)
}

fn check(occasion: &Occasion) -> Result<(), String> {
    let texts = [("label", &occasion.label)].into_iter();
    for (what, text) in texts.chain(occasion.commit.iter().map(|commit| ("commit", commit))) {
        let is_plain = visible_line(text) == *text && !text.trim().is_empty();
        if !is_plain || text.chars().count() > LONGEST {
            let shown = visible_line(text);
            return Err(format!(
                "the {what} '{shown}' is not one line of 1 to {LONGEST} printable characters"
            ));
        }
    }
    if is_date(&occasion.date) {
        Ok(())
    } else {
        Err(format!(
            "the date '{}' does not exist or is not written as YYYY-MM-DD or YYYY-MM-DDTHH:MM",
            visible_line(&occasion.date)
        ))
    }
}

/// Adds a run folder or a bundle, creating the history if needed. Several processes may add
/// concurrently.
///
/// # Errors
/// If the run cannot be read, the folder has no entry but other files, or the entry cannot be
/// written. A damaged existing entry is not an error, and its number is not reused.
pub fn add(dir: &Path, run: &Path, occasion: Occasion) -> Result<Added, HistoryError> {
    let mut bundle = Bundle::read(run)?;
    bundle.occasion = Some(occasion.clone());
    let encode = || FileError::new(run, "encode");
    let bytes = bundle.bytes().map_err(encode())?;
    let encoded = |text: serde_json::Result<String>| text.map_err(|error| encode()(error.into()));
    let content = encoded(bundle.content_sha256())?;
    let is_same = |number: u32| -> Result<Option<Occasion>, EvaluateError> {
        let head = read_head(&entry_file(dir, number)?)?;
        let there = checked(dir, number, head.occasion)?;
        let same = (&there.label, &there.commit) == (&occasion.label, &occasion.commit)
            && encoded(read_entry(dir, number)?.bundle.content_sha256())? == content;
        Ok(same.then_some(there))
    };
    let no_history = |reason: String| HistoryError::NoHistory {
        dir: dir.to_owned(),
        reason,
    };
    let (mut seen, mut damaged) = (0, Vec::new());
    loop {
        let (numbers, foreign) = match names(dir) {
            Err(error) if error.source.kind() == io::ErrorKind::NotFound => Default::default(),
            other => other?,
        };
        // After a mistyped path, do not mix entries with other files.
        if let (true, Some(name)) = (numbers.is_empty(), foreign) {
            let reason =
                format!("it contains {name} but no entry of a history; choose another folder");
            return Err(no_history(reason));
        }
        for &number in numbers.iter().filter(|number| **number > seen) {
            match is_same(number) {
                Ok(None) => {}
                Ok(Some(there)) => {
                    return Ok(Added {
                        path: entry_path(dir, number),
                        number,
                        occasion: there,
                        is_new: false,
                        damaged,
                    });
                }
                Err(error) => damaged.push(error.to_string()),
            }
        }
        seen = numbers.last().copied().unwrap_or(0);
        let number = seen.checked_add(1);
        let number =
            number.ok_or_else(|| no_history("no number is left for another entry".to_owned()))?;
        let path = entry_path(dir, number);
        let mut file = PartialFile::create(&path)?;
        file.write_all(&bytes)
            .map_err(FileError::new(&path, "write"))?;
        // Another process may have written an entry with this number first, possibly from the same
        // run. If so, try again.
        if file.commit_new()? {
            return Ok(Added {
                path,
                number,
                occasion,
                is_new: true,
                damaged,
            });
        }
    }
}

/// Reads all entries. Damaged entries are listed in [`History::damaged`] and do not affect other
/// entries.
///
/// # Errors
/// If the folder cannot be read or has no entry.
pub fn read(dir: &Path) -> Result<History, HistoryError> {
    let (numbers, _) = names(dir)?;
    if numbers.is_empty() {
        return Err(HistoryError::NoHistory {
            dir: dir.to_owned(),
            reason: "it contains no entry; add one with `history add DIR RUN`".to_owned(),
        });
    }
    let (mut trend, mut entries, mut damaged) = (Trend::default(), Vec::new(), Vec::new());
    for number in numbers {
        match read_entry(dir, number) {
            Ok(entry) => {
                entries.push((number, entry.occasion.clone()));
                trend.add(entry);
            }
            Err(error) => damaged.push(error.to_string()),
        }
    }
    Ok(History {
        entries,
        series: trend.into_series(),
        damaged,
    })
}

fn entry_path(dir: &Path, number: u32) -> PathBuf {
    dir.join(format!("{number:04}.zip"))
}

/// The numbers of a folder's entries, and the name of one file or folder that is not an entry, if
/// any. Entries are recognised by name alone (see [`entry_path`]). Names that begin with a dot are
/// ignored.
fn names(dir: &Path) -> Result<(BTreeSet<u32>, Option<String>), FileError> {
    let entries = fs::read_dir(dir).map_err(FileError::new(dir, "read"))?;
    let (mut numbers, mut foreign) = (BTreeSet::new(), None);
    for entry in entries {
        let name = entry.map_err(FileError::new(dir, "read"))?.file_name();
        let name = name.to_string_lossy();
        let number = name.strip_suffix(".zip").and_then(|n| n.parse().ok());
        match number.filter(|n| entry_path(Path::new(""), *n) == Path::new(&*name)) {
            Some(number) => {
                numbers.insert(number);
            }
            None if name.starts_with('.') => {}
            None => foreign = Some(name.into_owned()),
        }
    }
    Ok((numbers, foreign))
}

/// Path of an entry's file. A link is an error, because its target may change.
fn entry_file(dir: &Path, number: u32) -> Result<PathBuf, FileError> {
    let path = entry_path(dir, number);
    let kind = fs::symlink_metadata(&path).map_err(FileError::new(&path, "read"))?;
    if kind.is_file() {
        Ok(path)
    } else {
        Err(FileError::new(&path, "read")(io::Error::other(
            "not a regular file",
        )))
    }
}

fn checked(dir: &Path, number: u32, occasion: Option<Occasion>) -> Result<Occasion, EvaluateError> {
    let no_entry = |reason: String| EvaluateError::NotKept {
        folder: entry_path(dir, number),
        reason: format!("not an entry of a history: {reason}"),
    };
    let occasion = occasion
        .ok_or_else(|| no_entry("it has no date; `history add` writes entries".to_owned()))?;
    check(&occasion).map_err(no_entry)?;
    Ok(occasion)
}

fn read_entry(dir: &Path, number: u32) -> Result<Entry, EvaluateError> {
    let bundle = Bundle::read(&entry_file(dir, number)?)?;
    Ok(Entry {
        number,
        occasion: checked(dir, number, bundle.occasion.clone())?,
        bundle,
    })
}

#[cfg(test)]
mod tests;
