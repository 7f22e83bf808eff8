//! The folder of a training run's saved states.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use sharp_checkpoint::CheckpointError;

use super::{StateError, TrainingState};
use crate::position::{Position, Stage};

/// A folder of files named `stage1-step00001000.safetensors`; other files in it are ignored.
#[derive(Debug, Clone)]
pub struct CheckpointFolder(PathBuf);

impl CheckpointFolder {
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self(path.into())
    }

    /// Path of the state at `position`.
    pub fn file(&self, position: Position) -> PathBuf {
        let Position { stage, step } = position;
        let name = format!("stage{}-step{step:08}.safetensors", stage.number());
        self.0.join(name)
    }

    /// Positions of the saved states, earliest first; empty if the folder does not exist.
    ///
    /// # Errors
    /// [`StateError::File`] if the folder cannot be read.
    pub fn positions(&self) -> Result<Vec<Position>, StateError> {
        let entries = match fs::read_dir(&self.0) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(|error| self.fault(error))?,
        };
        let mut found = Vec::new();
        for entry in entries {
            let name = entry.map_err(|error| self.fault(error))?.file_name();
            let position = name.to_str().and_then(position);
            // Ignores files whose names are not in canonical form.
            found.extend(position.filter(|at| self.file(*at) == self.0.join(&name)));
        }
        found.sort_unstable();
        Ok(found)
    }

    /// Writes a state, then removes all states but the latest `kept`.
    ///
    /// # Errors
    /// [`StateError::File`] if a file cannot be written or removed.
    pub fn save(
        &self,
        state: &TrainingState,
        config_sha256: &str,
        kept: usize,
    ) -> Result<(), StateError> {
        fs::create_dir_all(&self.0).map_err(|error| self.fault(error))?;
        state.save(&self.file(state.position), config_sha256)?;
        sync(&self.0).map_err(|error| self.fault(error))?;
        let positions = self.positions()?;
        let surplus = positions.len().saturating_sub(kept);
        for position in &positions[..surplus] {
            fs::remove_file(self.file(*position)).map_err(|error| self.fault(error))?;
        }
        Ok(())
    }

    fn fault(&self, source: io::Error) -> StateError {
        let path = self.0.clone();
        StateError::File(CheckpointError::Io { path, source })
    }
}

/// Syncs the folder, if the platform supports it, so that a rename survives a power failure.
fn sync(folder: &Path) -> io::Result<()> {
    if cfg!(unix) {
        File::open(folder)?.sync_all()
    } else {
        Ok(())
    }
}

fn position(name: &str) -> Option<Position> {
    let (stage, step) = name
        .strip_prefix("stage")?
        .strip_suffix(".safetensors")?
        .split_once("-step")?;
    Some(Position {
        stage: Stage::from_number(stage.parse().ok()?)?,
        step: step.parse().ok()?,
    })
}
