//! The run folder.
//!
//! ```text
//! RUN/manifest.json                         facts about the run
//! RUN/run.toml                              the configuration, by option names
//! RUN/plan.json                             planned pairs by method; with `run --plan-only` also the cost
//! RUN/pairs.csv                             the pair list
//! RUN/units/ab/abcdef….json                 one file per unit, named by its slot
//! RUN/predictions/METHOD/<pair_id>.png      kept pictures (and .exr with --keep float)
//! RUN/gaussians/<predict key>.safetensors   kept predictions of sources (--keep-gaussians)
//! RUN/common-region/…                       units scored on the region common to all methods (--common-region)
//! RUN/scores.csv                            a table of the units
//! RUN/timings.csv                           seconds, separate from the scores
//! RUN/.lock                                 locked by the writing process, or shared by the processes of shards
//! RUN/.scratch-…                            temporary files of the writing process
//! RUN/logs/METHOD.log                       standard error of an external program; logs/I-of-N/ for shards
//! ```

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use serde::Deserialize;
use sharp::files::read;

use super::error::EvaluateError;
use super::manifest::{FORMAT, Manifest};
use super::plan::RunPlan;
use super::shard::Shard;
use super::unit::{Slot, Unit};
use crate::config::RunConfig;
use crate::io::atomic_files::{FileError, remove_leftovers, write_atomic, write_json};
use crate::io::hash::file_sha256;
use crate::pairs::pair_id::path_of;

#[derive(Debug, Clone)]
pub struct RunFolder {
    root: PathBuf,
    /// The open lock file; holds the folder's lock until it is dropped. `None` for reading.
    _lock: Option<Arc<File>>,
}

impl RunFolder {
    /// Opens or creates a run folder for writing, and removes partial files of a killed process. Rejects other folders
    /// that are not empty, so that a mistyped path does not mix results with other files.
    ///
    /// # Errors
    /// The error names the folder and why it cannot be used.
    pub fn create(root: &Path) -> Result<Self, FileError> {
        let (folder, is_locked) = Self::created(root, File::try_lock)?;
        if is_locked {
            remove_leftovers(root, &WRITTEN, Duration::ZERO);
        }
        Ok(folder)
    }

    /// Like [`Self::create`], but other processes with the same plan may use the folder at the same time.
    ///
    /// # Errors
    /// Those of [`Self::create`].
    pub(super) fn create_shared(root: &Path) -> Result<Self, FileError> {
        Ok(Self::created(root, File::try_lock_shared)?.0)
    }

    fn created(
        root: &Path,
        take: fn(&File) -> Result<(), TryLockError>,
    ) -> Result<(Self, bool), FileError> {
        fs::create_dir_all(root).map_err(FileError::new(root, "create"))?;
        let entries = fs::read_dir(root).map_err(FileError::new(root, "read"))?;
        // The program writes dot files (the lock, and partial files of a killed process), so they do not make a folder
        // foreign.
        let foreign = entries
            .filter_map(Result::ok)
            .any(|entry| !entry.file_name().to_string_lossy().starts_with('.'));
        let started = ["manifest.json", "units"].map(|name| root.join(name));
        // A run that was killed before its first unit leaves only the lock file.
        let is_ours = || {
            let lock = root.join(".lock");
            lock.is_file() && read(&lock).is_ok_and(|text| text.starts_with(MARK.as_bytes()))
        };
        if foreign && !started.iter().any(|path| path.exists()) && !is_ours() {
            return Err(FileError {
                path: root.to_owned(),
                action: "use as run folder",
                source: std::io::Error::other("it holds other files but no manifest.json"),
            });
        }
        let (lock, is_locked) = lock(root, take)?;
        // Write before truncating, so that the file is never empty: another process may be checking for the mark.
        let mark = || -> std::io::Result<()> {
            (&lock).write_all(MARK.as_bytes())?;
            lock.set_len(MARK.len() as u64)
        };
        mark().map_err(FileError::new(&root.join(".lock"), "write"))?;
        let folder = Self {
            root: root.to_owned(),
            _lock: Some(Arc::new(lock)),
        };
        Ok((folder, is_locked))
    }

    /// Opens a planned run so that several processes can write units at the same time. Files of units are replaced
    /// atomically; if two processes compute the same unit, their results are equal.
    ///
    /// # Errors
    /// If there is no manifest, or a process holds the exclusive lock.
    pub(super) fn join(root: &Path) -> Result<Self, FileError> {
        let folder = Self::open(root)?;
        let (lock, _) = lock(root, File::try_lock_shared)?;
        Ok(Self {
            _lock: Some(Arc::new(lock)),
            ..folder
        })
    }

    /// Removes partial files older than a day; newer ones may belong to a running process.
    pub(super) fn remove_old_leftovers(&self) {
        remove_leftovers(&self.root, &WRITTEN, Duration::from_secs(24 * 3600));
    }

    /// Opens an existing run folder for reading.
    ///
    /// # Errors
    /// If there is no manifest.
    pub fn open(root: &Path) -> Result<Self, FileError> {
        let manifest = root.join("manifest.json");
        fs::metadata(&manifest).map_err(FileError::new(&manifest, "read"))?;
        Ok(Self {
            root: root.to_owned(),
            _lock: None,
        })
    }

    /// A handle to this folder for reading, which does not hold the lock.
    pub(super) fn unlocked(&self) -> Self {
        Self {
            root: self.root.clone(),
            _lock: None,
        }
    }

    /// The subfolder with the units of `--common-region`, in the same layout.
    pub(super) fn common_region(&self) -> Self {
        Self {
            root: self.root.join("common-region"),
            _lock: self._lock.clone(),
        }
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    pub fn pairs_path(&self) -> PathBuf {
        self.root.join("pairs.csv")
    }

    pub fn scores_path(&self) -> PathBuf {
        self.root.join("scores.csv")
    }

    pub fn timings_path(&self) -> PathBuf {
        self.root.join("timings.csv")
    }

    pub(super) fn logs_path(&self, shard: Shard) -> PathBuf {
        let logs = self.root.join("logs");
        match shard {
            Shard::WHOLE => logs,
            _ => logs.join(shard.to_string().replace('/', "-of-")),
        }
    }

    pub fn gaussians_path(&self) -> PathBuf {
        self.root.join("gaussians")
    }

    /// File of a method's picture for a pair; `extension` is `png` or `exr`.
    pub fn prediction_path(&self, method: &str, pair_id: &str, extension: &str) -> PathBuf {
        self.root
            .join("predictions")
            .join(method)
            .join(format!("{}.{extension}", path_of(pair_id)))
    }

    /// Reads `manifest.json`; `None` if there is none yet.
    ///
    /// # Errors
    /// If it cannot be read, is not a manifest, or has another format.
    pub fn manifest(&self) -> Result<Option<Manifest>, EvaluateError> {
        #[derive(Deserialize)]
        struct Format {
            format: u32,
        }
        let path = self.root.join("manifest.json");
        let bytes = match read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(FileError::new(&path, "read")(error).into()),
        };
        let parse_error = |error: serde_json::Error| FileError::new(&path, "parse")(error.into());
        let Format { format } = serde_json::from_slice(&bytes).map_err(parse_error)?;
        if format != FORMAT {
            return Err(EvaluateError::Format {
                folder: self.root.clone(),
                found: format,
                expected: FORMAT,
            });
        }
        let manifest: Manifest = serde_json::from_slice(&bytes).map_err(parse_error)?;
        manifest
            .check_metrics()
            .map_err(|reason| EvaluateError::NotKept {
                folder: self.root.clone(),
                reason,
            })?;
        Ok(Some(manifest))
    }

    /// Writes `manifest.json`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_manifest(&self, manifest: &Manifest) -> Result<(), FileError> {
        write_json(&self.root.join("manifest.json"), manifest)
    }

    /// Reads `plan.json`; an empty plan if there is none.
    ///
    /// # Errors
    /// The error names the file and the mistake.
    pub fn plan(&self) -> Result<RunPlan, FileError> {
        let path = self.root.join("plan.json");
        match read(&path) {
            Ok(bytes) => serde_json::from_slice(&bytes)
                .map_err(|error| FileError::new(&path, "parse")(error.into())),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(RunPlan::default()),
            Err(error) => Err(FileError::new(&path, "read")(error)),
        }
    }

    /// Writes `plan.json`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_plan(&self, plan: &RunPlan) -> Result<(), FileError> {
        write_json(&self.root.join("plan.json"), plan)
    }

    /// Path of the configuration of the latest `run` into this folder.
    pub fn config_path(&self) -> PathBuf {
        self.root.join("run.toml")
    }

    /// Writes `run.toml` with absolute paths.
    pub(super) fn write_config(&self, config: &RunConfig) -> Result<(), FileError> {
        let path = self.config_path();
        let here = std::env::current_dir().map_err(FileError::new(&path, "write"))?;
        let text = config.clone().rooted(&here).to_toml();
        let text =
            text.map_err(|error| FileError::new(&path, "write")(std::io::Error::other(error)))?;
        let text = format!(
            "# The requested options; `sharp-bench run --config FILE --out OTHER` uses them \
             again.\n{text}"
        );
        write_atomic(&path, text.as_bytes())
    }

    fn unit_path(&self, slot: &Slot) -> PathBuf {
        let stem = slot.file_stem();
        let (folder, _) = stem.split_at(2);
        self.root
            .join("units")
            .join(folder)
            .join(format!("{stem}.json"))
    }

    /// The stored result of a unit; `None` if it is missing, damaged or belongs to another unit, so
    /// that the unit is redone.
    ///
    /// # Errors
    /// If a file exists but cannot be read.
    pub fn load(&self, slot: &Slot) -> Result<Option<Unit>, FileError> {
        let path = self.unit_path(slot);
        let bytes = match read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(FileError::new(&path, "read")(error)),
        };
        Ok(parse_unit(&bytes).filter(|unit| unit.slot == *slot))
    }

    /// Stores a unit's result.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, unit: Unit) -> Result<Unit, FileError> {
        let unit = unit.sealed();
        write_json(&self.unit_path(&unit.slot), &unit)?;
        Ok(unit)
    }

    /// All undamaged units in the order of their slots, and the paths of damaged files.
    ///
    /// # Errors
    /// If the folder or a file cannot be read.
    pub fn units(&self) -> Result<(Vec<Unit>, Vec<PathBuf>), FileError> {
        let root = self.root.join("units");
        let (mut units, mut damaged) = (Vec::new(), Vec::new());
        for folder in entries(&root)? {
            for path in entries(&folder)? {
                if path.extension().is_none_or(|extension| extension != "json") {
                    continue;
                }
                let bytes = read(&path).map_err(FileError::new(&path, "read"))?;
                let stem = path.file_stem().unwrap_or_default();
                match parse_unit(&bytes).filter(|unit| stem == unit.slot.file_stem().as_str()) {
                    Some(unit) => units.push(unit),
                    None => damaged.push(path),
                }
            }
        }
        units.sort_by(|a: &Unit, b| a.slot.cmp(&b.slot));
        damaged.sort();
        Ok((units, damaged))
    }

    /// The modification time of each unit's file.
    pub(super) fn unit_times(&self) -> Result<Vec<SystemTime>, FileError> {
        let mut times = Vec::new();
        for folder in entries(&self.root.join("units"))? {
            let files = entries(&folder)?.into_iter();
            let changed = files.map(|path| fs::metadata(path).and_then(|file| file.modified()));
            // Skip files that were removed in the meantime or have no modification time.
            times.extend(changed.flatten());
        }
        Ok(times)
    }

    /// Whether the picture was kept and its file still has the bytes that were scored.
    pub fn has_picture(&self, unit: &Unit) -> bool {
        let sha256 = unit.picture.as_ref().and_then(|p| p.file_sha256.as_ref());
        self.has_file(unit, "png", sha256)
    }

    /// Whether the linear picture was kept and its file still has the recorded bytes.
    pub(super) fn has_float(&self, unit: &Unit) -> bool {
        let sha256 = unit.picture.as_ref().and_then(|p| p.float_sha256.as_ref());
        self.has_file(unit, "exr", sha256)
    }

    fn has_file(&self, unit: &Unit, extension: &str, sha256: Option<&String>) -> bool {
        let path = self.prediction_path(&unit.slot.method, &unit.slot.pair_id, extension);
        sha256.is_some_and(|sha256| file_sha256(&path).is_ok_and(|found| found == *sha256))
    }

    /// Removes `scores.csv` and `timings.csv` before results change. A folder without these files
    /// is an unfinished run.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub(super) fn remove_tables(&self) -> Result<(), FileError> {
        for path in [self.scores_path(), self.timings_path()] {
            match fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(FileError::new(&path, "remove")(error));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

fn parse_unit(bytes: &[u8]) -> Option<Unit> {
    let unit: Unit = serde_json::from_slice(bytes).ok()?;
    (unit.format == FORMAT && unit.is_whole() && unit.is_consistent()).then_some(unit)
}

/// The entries of a folder, sorted; empty if it does not exist.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let read = match fs::read_dir(folder) {
        Err(error)
            if matches!(
                error.kind(),
                std::io::ErrorKind::NotFound | std::io::ErrorKind::NotADirectory
            ) =>
        {
            return Ok(Vec::new());
        }
        read => read.map_err(FileError::new(folder, "read"))?,
    };
    let mut paths: Vec<PathBuf> = read
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .collect();
    paths.sort();
    Ok(paths)
}

/// Contents of the lock file of a run folder.
const MARK: &str = "sharp-bench run\n";

/// Subfolders that runs write into.
const WRITTEN: [&str; 4] = ["units", "predictions", "gaussians", "common-region"];

/// Opens the lock file and locks it with `take`. Also returns whether the file system supports locks; if not, the file
/// is not locked.
pub(crate) fn lock(
    root: &Path,
    take: fn(&File) -> Result<(), TryLockError>,
) -> Result<(File, bool), FileError> {
    let path = root.join(".lock");
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false);
    // Do not follow links or wait for pipes: a planted link could create a file elsewhere, and a
    // planted pipe would wait for a reader.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(
        &mut options,
        libc::O_NOFOLLOW | libc::O_NONBLOCK,
    );
    let file = options.open(&path);
    let file = file.map_err(FileError::new(&path, "create"))?;
    match take(&file) {
        Err(TryLockError::WouldBlock) => {
            let reason = std::io::Error::other("another process is writing into it");
            Err(FileError::new(root, "use as run folder")(reason))
        }
        taken => Ok((file, taken.is_ok())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_folder_has_one_writer() {
        let dir = tempfile::tempdir().unwrap();
        let folder = RunFolder::create(dir.path()).unwrap();
        let error = RunFolder::create(dir.path()).unwrap_err().to_string();
        assert!(error.contains("another process"), "{error}");
        drop(folder);
        #[cfg(unix)]
        {
            let elsewhere = tempfile::tempdir().unwrap();
            std::fs::remove_file(dir.path().join(".lock")).unwrap();
            let target = elsewhere.path().join("made");
            std::os::unix::fs::symlink(&target, dir.path().join(".lock")).unwrap();
            assert!(RunFolder::create(dir.path()).is_err());
            assert!(!target.exists());
            std::fs::remove_file(dir.path().join(".lock")).unwrap();
        }
        RunFolder::create(dir.path()).unwrap();
    }

    #[test]
    fn folders_of_an_earlier_format_are_refused_with_what_to_do() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("manifest.json"), "{\"format\": 1}").unwrap();
        let folder = RunFolder::open(dir.path()).unwrap();
        let error = folder.manifest().unwrap_err();
        assert!(matches!(error, EvaluateError::Format { found: 1, .. }));
        assert!(error.to_string().contains("with a new folder"), "{error}");
    }
}
