//! sha256 of bytes and of files, in hexadecimal.

use std::fs::File;
use std::path::Path;

use sha2::{Digest, Sha256};
use sharp_datasets::files;

use super::atomic_files::FileError;

pub use sharp_checkpoint::hash::{hex, sha256_hex};

/// sha256 of a file's content, read in pieces.
pub fn file_sha256(path: &Path) -> Result<String, FileError> {
    let hash = File::open(path).and_then(files::sha256_of_reader);
    hash.map_err(FileError::new(path, "read"))
}

/// Hashes named facts. Their order counts; names and values are length-prefixed, so that no two different lists give
/// the same bytes.
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

    /// sha256 of all facts, 64 hexadecimal digits.
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
