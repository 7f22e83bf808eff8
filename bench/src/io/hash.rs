//! SHA-256 of bytes and files, in hexadecimal.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use sha2::{Digest, Sha256};
use sharp::files::open_regular;
use sharp_checkpoint::hash::reader_sha256;

use super::atomic_files::FileError;

pub use sharp_checkpoint::hash::{hex, sha256_hex};

/// SHA-256 of a regular file, read in chunks.
pub fn file_sha256(path: &Path) -> Result<String, FileError> {
    let hash = open_regular(path).and_then(reader_sha256);
    hash.map_err(FileError::new(path, "read"))
}

/// A hashed file that can be checked for changes.
#[derive(Debug)]
pub struct HashedFile {
    path: PathBuf,
    sha256: String,
    /// The file's stamp when its hash was last confirmed; `None` after a check found another hash.
    stamp: Mutex<Option<FileStamp>>,
}

/// Metadata of a file, which change when the file's content changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileStamp {
    len: u64,
    modified: Option<SystemTime>,
    /// Inode of the file; 0 on systems without inodes.
    inode: u64,
}

impl FileStamp {
    /// # Errors
    /// If the file does not exist.
    pub fn of(path: &Path) -> Result<Self, FileError> {
        let file = path.metadata().map_err(FileError::new(path, "read"))?;
        #[cfg(unix)]
        let inode = std::os::unix::fs::MetadataExt::ino(&file);
        #[cfg(not(unix))]
        let inode = 0;
        Ok(Self {
            len: file.len(),
            modified: file.modified().ok(),
            inode,
        })
    }
}

impl HashedFile {
    /// # Errors
    /// If the file cannot be read.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let stamp = FileStamp::of(path)?;
        Ok(Self::new(path, file_sha256(path)?, stamp))
    }

    /// A file that the caller has hashed. `stamp` must have been taken before hashing.
    pub fn new(path: &Path, sha256: String, stamp: FileStamp) -> Self {
        Self {
            path: path.to_owned(),
            sha256,
            stamp: Mutex::new(Some(stamp)),
        }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// Whether the file still has the hashed content. Reads the file only if the file's stamp has
    /// changed.
    pub fn is_unchanged(&self) -> bool {
        let mut stamp = self.stamp.lock().unwrap_or_else(PoisonError::into_inner);
        let now = FileStamp::of(&self.path).ok();
        if now.is_none() || stamp.is_none() {
            *stamp = None;
        } else if *stamp != now {
            let same = file_sha256(&self.path).is_ok_and(|sha256| sha256 == self.sha256);
            *stamp = now.filter(|_| same);
        }
        stamp.is_some()
    }
}

/// Hashes named values, in order. Names and values are length-prefixed, so that different lists of
/// names and values never give the same bytes.
#[derive(Debug, Clone, Default)]
pub struct StableHasher(Sha256);

impl StableHasher {
    pub fn add(&mut self, name: &str, value: &str) -> &mut Self {
        for part in [name, value] {
            self.0.update((part.len() as u64).to_le_bytes());
            self.0.update(part.as_bytes());
        }
        self
    }

    /// SHA-256 of all values, 64 hexadecimal digits.
    pub fn finish(&self) -> String {
        hex(self.0.clone().finalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_the_file() {
        let error = file_sha256(Path::new("no/such/file")).unwrap_err();
        assert!(error.to_string().starts_with("no/such/file: cannot read"));
    }

    #[test]
    fn a_changed_file_is_noticed_and_a_touched_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("w.pt");
        std::fs::write(&path, "one").unwrap();
        let file = HashedFile::read(&path).unwrap();
        assert!(file.is_unchanged());
        // Another file with the same bytes is not a change.
        std::fs::write(folder.path().join("new"), "one").unwrap();
        std::fs::rename(folder.path().join("new"), &path).unwrap();
        assert!(file.is_unchanged());
        std::fs::write(&path, "two!").unwrap();
        assert!(!file.is_unchanged());
        // A change is final: a reader in between may have used other content.
        std::fs::write(&path, "one").unwrap();
        assert!(!file.is_unchanged());
    }

    #[test]
    fn facts_cannot_be_split_otherwise() {
        let hash = |facts: &[(&str, &str)]| {
            let mut hasher = StableHasher::default();
            for (name, value) in facts {
                hasher.add(name, value);
            }
            hasher.finish()
        };
        assert_ne!(hash(&[("a", "bc")]), hash(&[("ab", "c")]));
        assert_ne!(hash(&[("a", "b"), ("c", "d")]), hash(&[("a", "bcd")]));
        assert_ne!(
            hash(&[("a", "1"), ("b", "2")]),
            hash(&[("b", "2"), ("a", "1")])
        );
        assert_eq!(hash(&[("a", "1")]), hash(&[("a", "1")]));
    }
}
