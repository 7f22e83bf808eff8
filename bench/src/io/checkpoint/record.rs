//! Size and SHA-256 of a release, recorded at its first use.
//!
//! No hash is published, so the first file used is trusted and recorded, and later files must be identical. The record
//! is in sharp-bench's cache folder, wherever the file is.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use sharp_metrics::weights::cache_folder;

use crate::io::atomic_files::{FileError, write_json};
use crate::io::calendar::day;

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CheckpointRecord {
    pub address: String,
    pub bytes: u64,
    pub sha256: String,
    /// UTC day of the first use, `2026-01-31`.
    pub recorded: String,
}

/// Result of comparing a file with the record of its first use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Standing {
    /// There was no earlier record to compare with, so a record was written to this file.
    Unverified(PathBuf),
    Matches(String),
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unverified(file) => write!(
                f,
                "unverified, because no hash is published; size and sha256 are recorded in {} from now on",
                file.display()
            ),
            Self::Matches(day) => write!(f, "matches the checkpoint recorded on {day}"),
        }
    }
}

/// Why a file cannot be compared with the record, or does not match it.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("{}: not a record of a checkpoint: {reason}", path.display())]
    Damaged { path: PathBuf, reason: String },
    #[error(
        "{}: {bytes} bytes, sha256 {sha256}, but the checkpoint recorded on {} had {} bytes, \
         sha256 {}; if it was replaced on purpose, delete {}",
        checkpoint.display(), expected.recorded, expected.bytes, expected.sha256, record.display()
    )]
    Other {
        checkpoint: PathBuf,
        bytes: u64,
        sha256: String,
        expected: Box<CheckpointRecord>,
        record: PathBuf,
    },
}

/// Path of the record of a release's file; `None` if there is no cache folder.
pub fn record_file(file: &str) -> Option<PathBuf> {
    Some(cache_folder()?.join(format!("{file}.json")))
}

/// Reads a record; `None` if the file does not exist.
pub fn read(file: &Path) -> Result<Option<CheckpointRecord>, RecordError> {
    match std::fs::read(file) {
        Ok(bytes) => {
            serde_json::from_slice(&bytes)
                .map(Some)
                .map_err(|error| RecordError::Damaged {
                    path: file.to_owned(),
                    reason: error.to_string(),
                })
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(FileError::new(file, "read")(error).into()),
    }
}

/// Compares a checkpoint of known SHA-256, published at `address`, with the record in `file`, or creates the record.
///
/// # Errors
/// [`RecordError`] if the checkpoint differs from the record, or the record cannot be read or written.
pub fn compare_or_record(
    checkpoint: &Path,
    address: &str,
    sha256: &str,
    file: &Path,
) -> Result<Standing, RecordError> {
    let metadata = std::fs::metadata(checkpoint).map_err(FileError::new(checkpoint, "read"))?;
    let found = CheckpointRecord {
        address: address.to_owned(),
        bytes: metadata.len(),
        sha256: sha256.to_owned(),
        recorded: day(SystemTime::now()),
    };
    match read(file)? {
        Some(record) if (record.bytes, &record.sha256) == (found.bytes, &found.sha256) => {
            Ok(Standing::Matches(record.recorded))
        }
        Some(expected) => Err(RecordError::Other {
            checkpoint: checkpoint.to_owned(),
            bytes: found.bytes,
            sha256: found.sha256,
            expected: Box::new(expected),
            record: file.to_owned(),
        }),
        None => {
            write_json(file, &found)?;
            Ok(Standing::Unverified(file.to_owned()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_file_is_taken_at_its_word_and_every_later_one_compared() {
        let dir = tempfile::tempdir().unwrap();
        let (checkpoint, file) = (dir.path().join("w.pt"), dir.path().join("cache/w.json"));
        std::fs::write(&checkpoint, b"12345").unwrap();
        assert_eq!(read(&file).unwrap(), None);
        let first = compare_or_record(&checkpoint, "http://a", "aa", &file).unwrap();
        assert_eq!(first, Standing::Unverified(file.clone()));
        assert!(first.to_string().starts_with("unverified"));
        let record = read(&file).unwrap().unwrap();
        assert_eq!((record.bytes, record.sha256.as_str()), (5, "aa"));
        let again = compare_or_record(&checkpoint, "http://a", "aa", &file).unwrap();
        assert_eq!(
            again.to_string(),
            format!("matches the checkpoint recorded on {}", record.recorded)
        );
        for (content, hash) in [(&b"12345"[..], "bb"), (b"1234", "aa")] {
            std::fs::write(&checkpoint, content).unwrap();
            let error = compare_or_record(&checkpoint, "http://a", hash, &file).unwrap_err();
            let text = error.to_string();
            assert!(text.contains("w.pt") && text.contains("w.json"), "{text}");
        }
        std::fs::write(&file, b"{}").unwrap();
        let error = compare_or_record(&checkpoint, "http://a", "aa", &file).unwrap_err();
        assert!(error.to_string().contains("not a record"), "{error}");
    }
}
