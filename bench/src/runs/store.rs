//! The run folder.
//!
//! ```text
//! RUN/manifest.json                         what was run
//! RUN/pairs.csv                             the pair list
//! RUN/records/ab/abcdef….json               one file a unit, named by its key
//! RUN/predictions/METHOD/<pair_id>.png      kept predictions
//! RUN/records.jsonl                         the records of the last run, in order
//! RUN/scores.csv                            the same as a table
//! RUN/timings.csv                           seconds, beside the scores
//! RUN/.lock                                 held while a process writes here
//! RUN/logs/METHOD.log                       what a program that predicts wrote on its standard error
//! ```

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::unit::UnitKey;
use crate::durable::{FileError, write_atomic};
use crate::record::Record;

/// Seconds that a unit took. Kept beside its scores, never part of them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Timing {
    /// Wall time of the prediction, rendering included, while the unit before was being scored.
    pub predict_secs: f64,
    /// Wall time of all metrics, while the next unit was being predicted.
    pub score_secs: f64,
}

/// What a unit's file holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnitFile {
    /// The key again, so that a renamed or foreign file is noticed.
    pub key: String,
    /// The result.
    pub record: Record,
    /// sha256 of the kept picture that the scores are of; `None` where none was kept.
    #[serde(default)]
    pub prediction_sha256: Option<String>,
    /// How long it took.
    pub timing: Timing,
}

/// A folder of durable results.
#[derive(Debug, Clone)]
pub struct RunFolder {
    root: PathBuf,
    /// Held by the one process that writes here, as long as it lives.
    _lock: Option<Arc<File>>,
}

impl RunFolder {
    /// Opens a run folder, creating it where there is none. A folder that is neither empty nor a run is refused,
    /// so that a mistyped path never mixes results into other files.
    ///
    /// # Errors
    /// Names the folder and why it cannot be used.
    pub fn create(root: &Path) -> Result<Self, FileError> {
        fs::create_dir_all(root).map_err(FileError::new(root, "create"))?;
        let entries = fs::read_dir(root).map_err(FileError::new(root, "read"))?;
        // Names with a dot are ours: the lock, and what a killed process left half written.
        let foreign = entries
            .filter_map(Result::ok)
            .any(|entry| !entry.file_name().to_string_lossy().starts_with('.'));
        let started = ["manifest.json", "records"].map(|name| root.join(name));
        if foreign && !started.iter().any(|path| path.exists()) {
            return Err(FileError {
                path: root.to_owned(),
                action: "use as run folder",
                source: std::io::Error::other("it holds other files and no manifest.json"),
            });
        }
        Ok(Self {
            root: root.to_owned(),
            _lock: Some(Arc::new(lock(root)?)),
        })
    }

    /// Opens an existing run folder.
    ///
    /// # Errors
    /// When it holds no manifest.
    pub fn open(root: &Path) -> Result<Self, FileError> {
        let manifest = root.join("manifest.json");
        fs::metadata(&manifest).map_err(FileError::new(&manifest, "read"))?;
        Ok(Self {
            root: root.to_owned(),
            _lock: None,
        })
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// `manifest.json`.
    pub fn manifest_path(&self) -> PathBuf {
        self.root.join("manifest.json")
    }

    /// `pairs.csv`.
    pub fn pairs_path(&self) -> PathBuf {
        self.root.join("pairs.csv")
    }

    /// `records.jsonl`.
    pub fn records_path(&self) -> PathBuf {
        self.root.join("records.jsonl")
    }

    /// `scores.csv`.
    pub fn scores_path(&self) -> PathBuf {
        self.root.join("scores.csv")
    }

    /// `timings.csv`.
    pub fn timings_path(&self) -> PathBuf {
        self.root.join("timings.csv")
    }

    /// Where methods keep their logs.
    pub fn logs_path(&self) -> PathBuf {
        self.root.join("logs")
    }

    /// Where the prediction of a method for a pair is kept.
    pub fn prediction_path(&self, method: &str, pair_id: &str) -> PathBuf {
        self.root
            .join("predictions")
            .join(method)
            .join(format!("{pair_id}.png"))
    }

    fn record_path(&self, key: &UnitKey) -> PathBuf {
        let key = key.as_str();
        let (folder, _) = key.split_at(2);
        self.root
            .join("records")
            .join(folder)
            .join(format!("{key}.json"))
    }

    /// The stored result of a unit, if it is there and whole. A file that is damaged, or another unit's, is none:
    /// the unit is done again and takes its place.
    ///
    /// # Errors
    /// When a file exists but the system cannot read it.
    pub fn load(&self, key: &UnitKey) -> Result<Option<UnitFile>, FileError> {
        let path = self.record_path(key);
        let bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(FileError::new(&path, "read")(error)),
        };
        let unit = serde_json::from_slice::<UnitFile>(&bytes).ok();
        Ok(unit.filter(|unit| unit.key == key.as_str()))
    }

    /// Stores a unit's result.
    ///
    /// # Errors
    /// Names the file and what the system said.
    pub fn save(&self, key: &UnitKey, unit: &UnitFile) -> Result<(), FileError> {
        let path = self.record_path(key);
        let mut bytes = serde_json::to_vec_pretty(unit)
            .map_err(|error| FileError::new(&path, "encode")(error.into()))?;
        bytes.push(b'\n');
        write_atomic(&path, &bytes)
    }

    /// Takes away what an earlier run concluded, before a run with other settings writes its manifest: a folder
    /// without `records.jsonl` is a run that has not ended. The units stay.
    ///
    /// # Errors
    /// Names the file and what the system said.
    pub fn reopen(&self) -> Result<(), FileError> {
        for path in [self.records_path(), self.scores_path(), self.timings_path()] {
            match fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(FileError::new(&path, "remove")(error));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Writes the records of a run, a line each.
    ///
    /// # Errors
    /// Names the file and what the system said.
    pub fn write_records(&self, records: &[Record]) -> Result<(), FileError> {
        let path = self.records_path();
        let mut bytes = Vec::new();
        for record in records {
            serde_json::to_writer(&mut bytes, record)
                .map_err(|error| FileError::new(&path, "encode")(error.into()))?;
            bytes.push(b'\n');
        }
        write_atomic(&path, &bytes)
    }

    /// Reads the records of the last run.
    ///
    /// # Errors
    /// When the file is missing (the run did not finish) or a line is not a record; names the line.
    pub fn read_records(&self) -> Result<Vec<Record>, FileError> {
        let path = self.records_path();
        let text = fs::read_to_string(&path).map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => FileError::new(&self.root, "report")(
                std::io::Error::other("the run has not ended; the same `run` command goes on"),
            ),
            _ => FileError::new(&path, "read")(error),
        })?;
        text.lines()
            .enumerate()
            .map(|(at, line)| {
                serde_json::from_str(line).map_err(|error| {
                    let reason = format!("line {}: {error}", at + 1);
                    FileError::new(&path, "parse")(std::io::Error::other(reason))
                })
            })
            .collect()
    }
}

/// Takes the folder for this process. Where the file system has no locks, nothing is taken.
fn lock(root: &Path) -> Result<File, FileError> {
    let path = root.join(".lock");
    let file = File::create(&path).map_err(FileError::new(&path, "create"))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            let reason = std::io::Error::other("another process is writing this run");
            Err(FileError::new(root, "use as run folder")(reason))
        }
        _ => Ok(file),
    }
}
