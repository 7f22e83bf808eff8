//! The folder of a training run: created, or found and checked.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use sharp::files::read_text;
use sharp_train::config::TrainingConfig;
use toml::Value;

use super::TrainError;
use crate::evaluate::folder::lock;
use crate::io::atomic_files::{FileError, write_atomic};

/// A training folder, used by one process at a time.
pub(super) struct TrainingFolder {
    root: PathBuf,
    _lock: File,
}

const CONFIG: &str = "config.toml";

impl TrainingFolder {
    /// Creates the folder for a configuration, or opens a folder created with the same
    /// configuration. Saves the text as `config.toml`. Keys that affect no result may differ;
    /// before the first step, any key may differ.
    ///
    /// # Errors
    /// [`TrainError::OtherFolder`] if the folder contains other files, or a training run with another
    /// configuration; the error names a key that differs.
    pub(super) fn open(
        root: &Path,
        text: &str,
        config: &TrainingConfig,
    ) -> Result<Self, TrainError> {
        let refused = |reason: String| TrainError::OtherFolder {
            folder: root.to_owned(),
            reason,
        };
        fs::create_dir_all(root).map_err(FileError::new(root, "create"))?;
        let kept = root.join(CONFIG);
        if kept.exists() {
            let before = read_text(&kept).map_err(FileError::new(&kept, "read"))?;
            if before != text
                && has_begun(root)
                && TrainingConfig::load(&kept)?.sha256() != config.sha256()
            {
                let difference = difference(&before, text);
                return Err(refused(format!(
                    "it contains a training run with another configuration ({difference}); use another folder"
                )));
            }
        } else {
            let entries = fs::read_dir(root).map_err(FileError::new(root, "read"))?;
            let mut entries = entries.filter_map(Result::ok);
            // Files whose names begin with a dot are this program's own, as in a run folder.
            if entries.any(|entry| !entry.file_name().to_string_lossy().starts_with('.')) {
                return Err(refused(format!("it contains other files but no {CONFIG}")));
            }
        }
        let (lock, _) = lock(root, File::try_lock)?;
        write_atomic(&kept, text.as_bytes())?;
        Ok(Self {
            root: root.to_owned(),
            _lock: lock,
        })
    }

    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Run folder of the last validation.
    pub(super) fn validation(&self) -> PathBuf {
        self.root.join("validation")
    }
}

/// Whether the first step was made. Before that, changing the configuration (to fix a path, for
/// instance) loses nothing.
fn has_begun(root: &Path) -> bool {
    let log = read_text(&root.join("log.csv")).unwrap_or_default();
    log.lines().count() > 1 || root.join("checkpoints").exists()
}

/// The first key that differs between two files, ignoring keys that affect no result.
fn difference(before: &str, now: &str) -> String {
    let [before, now] = [before, now].map(|text| {
        let mut values = BTreeMap::new();
        if let Ok(table) = toml::from_str(text) {
            flatten("", &Value::Table(table), &mut values);
        }
        values.retain(|key, _| !key.starts_with("intervals."));
        values
    });
    let mut keys = before.keys().chain(now.keys());
    let Some(key) = keys.find(|key| before.get(*key) != now.get(*key)) else {
        return "a default value, or a file named in the configuration, has changed".to_owned();
    };
    let text = |value: Option<&String>| value.cloned().unwrap_or_else(|| "not given".to_owned());
    let (before, now) = (text(before.get(key)), text(now.get(key)));
    format!("`{key}` was {before} and is now {now}")
}

/// Flattens a table to values by dotted keys.
fn flatten(prefix: &str, value: &Value, into: &mut BTreeMap<String, String>) {
    match value {
        Value::Table(table) => {
            for (key, value) in table {
                let dot = if prefix.is_empty() { "" } else { "." };
                flatten(&format!("{prefix}{dot}{key}"), value, into);
            }
        }
        value => {
            into.insert(prefix.to_owned(), value.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: &str = "[stage1]\nsteps = 20\nbatch = 1\nschedule.warmup_steps = 5\n\
                         [stage2]\nsteps = 0\nbatch = 1\n[intervals]\ncheckpoint = 7\n";

    fn open(root: &Path, text: &str) -> Result<(), String> {
        let config = TrainingConfig::parse(text, Path::new("a.toml")).unwrap();
        let opened = TrainingFolder::open(root, text, &config);
        // A step was made.
        fs::write(root.join("log.csv"), "stage,step\n1,1\n").unwrap();
        opened.map(drop).map_err(|error| error.to_string())
    }

    #[test]
    fn a_training_is_found_by_its_configuration() {
        let dir = tempfile::tempdir().unwrap();
        open(dir.path(), PLAIN).unwrap();
        open(dir.path(), PLAIN).unwrap();
        // A key that affects no result may change at any time.
        open(
            dir.path(),
            &PLAIN.replace("checkpoint = 7", "checkpoint = 9"),
        )
        .unwrap();
        let kept = fs::read_to_string(dir.path().join(CONFIG)).unwrap();
        assert!(kept.contains("checkpoint = 9"));
        let error = open(dir.path(), &PLAIN.replace("steps = 20", "steps = 30")).unwrap_err();
        assert!(
            error.contains("`stage1.steps` was 20 and is now 30"),
            "{error}"
        );
        let clipped = PLAIN.replace("schedule", "clip_norm = inf\nschedule");
        let error = open(dir.path(), &clipped).unwrap_err();
        assert!(error.contains("was not given and is now inf"), "{error}");
        let error = open(dir.path(), &format!("initial = \"a.pt\"\n{PLAIN}")).unwrap_err();
        assert!(error.contains("`initial` was not given"), "{error}");
    }

    #[test]
    fn before_the_first_step_the_configuration_may_change() {
        let dir = tempfile::tempdir().unwrap();
        open(dir.path(), &format!("initial = \"absent\"\n{PLAIN}")).unwrap();
        fs::remove_file(dir.path().join("log.csv")).unwrap();
        open(dir.path(), PLAIN).unwrap();
        assert_eq!(fs::read_to_string(dir.path().join(CONFIG)).unwrap(), PLAIN);
    }

    #[test]
    fn other_folders_are_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("mine.txt"), "").unwrap();
        assert!(open(dir.path(), PLAIN).unwrap_err().contains("other files"));
        assert!(!dir.path().join(CONFIG).exists());
    }
}
