//! SHA-256 as 64 lower-case hexadecimal digits.

use std::fmt::Write;
use std::io::{self, Read};
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::bytes::OpenFile;
use crate::error::CheckpointError;

/// Hexadecimal digits of a finished digest.
pub fn hex(digest: impl AsRef<[u8]>) -> String {
    digest
        .as_ref()
        .iter()
        .fold(String::new(), |mut text, byte| {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
            text
        })
}

/// SHA-256 of bytes in memory.
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(Sha256::digest(bytes))
}

/// SHA-256 of all data from a reader.
///
/// # Errors
/// Any error of the reader.
pub fn reader_sha256(mut reader: impl Read) -> io::Result<String> {
    let mut hasher = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match reader.read(&mut buffer)? {
            0 => return Ok(hex(hasher.finalize())),
            read => hasher.update(&buffer[..read]),
        }
    }
}

/// SHA-256 of a regular file, read in pieces.
///
/// # Errors
/// [`CheckpointError::Io`] if the file is not regular or cannot be read.
pub fn file_sha256(path: &Path) -> Result<String, CheckpointError> {
    let hash = OpenFile::open(path).and_then(|file| file.sha256());
    hash.map_err(|source| CheckpointError::Io {
        path: path.to_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_and_bytes_hash_alike() {
        let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(file_sha256(file.path()).unwrap(), empty);
        std::fs::write(file.path(), b"abc").unwrap();
        assert_eq!(file_sha256(file.path()).unwrap(), sha256_hex(b"abc"));
        assert!(file_sha256(Path::new("/nowhere")).is_err());
    }
}
