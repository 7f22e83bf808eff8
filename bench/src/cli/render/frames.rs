//! A folder of frames, which can be stopped and started again.

use std::path::Path;

use anyhow::bail;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::io::atomic_files::{FileError, write_json};
use crate::rendering::Fallback;

/// What the frames of a folder have in common.
const NAME: &str = "frames.json";

#[derive(Debug, Serialize, Deserialize)]
struct FramesFile {
    settings: Value,
    /// A device that failed on the way, and the first frame that the CPU rendered instead.
    #[serde(default)]
    fallback: Option<FallbackFacts>,
}

#[derive(Debug, Serialize, Deserialize)]
struct FallbackFacts {
    reason: String,
    from_frame: usize,
}

/// Starts a folder or continues in it.
///
/// # Errors
/// When it holds something else: frames of other settings, or files that are no frames of ours.
pub(super) fn start(folder: &Path, settings: &Value) -> anyhow::Result<()> {
    let path = folder.join(NAME);
    match std::fs::read(&path) {
        Ok(bytes) => {
            let before: FramesFile = serde_json::from_slice(&bytes)
                .map_err(|error| FileError::new(&path, "parse")(error.into()))?;
            if before.settings != *settings {
                bail!(
                    "{}: it holds frames of another rendering ({NAME} says which): remove it or choose another folder",
                    folder.display()
                );
            }
            Ok(())
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let entries = std::fs::read_dir(folder);
            if entries.is_ok_and(|mut entries| entries.next().is_some()) {
                bail!(
                    "{}: it holds other files and no {NAME}: choose another folder",
                    folder.display()
                );
            }
            write(folder, settings, None)
        }
        Err(error) => Err(FileError::new(&path, "read")(error).into()),
    }
}

pub(super) fn record_fallback(
    folder: &Path,
    settings: &Value,
    fallback: &Fallback,
    from_frame: usize,
) -> anyhow::Result<()> {
    let facts = FallbackFacts {
        reason: fallback.reason.clone(),
        from_frame,
    };
    write(folder, settings, Some(facts))
}

fn write(folder: &Path, settings: &Value, fallback: Option<FallbackFacts>) -> anyhow::Result<()> {
    let file = FramesFile {
        settings: settings.clone(),
        fallback,
    };
    Ok(write_json(&folder.join(NAME), &file)?)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_folder_goes_on_only_with_its_own_settings() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("frames");
        let settings = json!({"eps2d": 0.3_f32, "near": 0.01_f32});
        start(&folder, &settings).unwrap();
        start(&folder, &settings).unwrap();
        let other = json!({"eps2d": 0.0, "near": 0.01});
        let error = start(&folder, &other).unwrap_err().to_string();
        assert!(error.contains("another rendering"), "{error}");

        let fallback = Fallback {
            reason: "device lost".to_owned(),
            from_view: 3,
        };
        record_fallback(&folder, &settings, &fallback, 7).unwrap();
        start(&folder, &settings).unwrap();
        let text = std::fs::read_to_string(folder.join(NAME)).unwrap();
        assert!(text.contains("\"from_frame\": 7"), "{text}");

        std::fs::write(dir.path().join("mine.txt"), "x").unwrap();
        let error = start(dir.path(), &settings).unwrap_err().to_string();
        assert!(error.contains("other files"), "{error}");
    }
}
