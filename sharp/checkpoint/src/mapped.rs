//! A read-only memory map of a file.

use std::fs::File;
use std::ops::Deref;
use std::path::Path;

use memmap2::Mmap;

use crate::error::CheckpointError;

/// The bytes of a file, mapped; an empty file is an empty slice.
#[derive(Debug)]
pub(crate) struct Mapped(Option<Mmap>);

impl Mapped {
    /// Maps `path`. The file must not be truncated while it is mapped: reading beyond its new
    /// end would end the process.
    pub(crate) fn open(path: &Path) -> Result<Self, CheckpointError> {
        let io = |source| CheckpointError::Io {
            path: path.to_path_buf(),
            source,
        };
        let file = File::open(path).map_err(io)?;
        let meta = file.metadata().map_err(io)?;
        if meta.is_dir() {
            return Err(io(std::io::ErrorKind::IsADirectory.into()));
        }
        if meta.len() == 0 {
            return Ok(Self(None));
        }
        // SAFETY: the map is private and read-only, and lives as long as `self`. What the type
        // system cannot rule out is another process that writes to the file meanwhile; every
        // access is bounds-checked against the length at opening, values are plain numbers for
        // which any bits are valid, and checkpoints are files that are replaced, not edited.
        let map = unsafe { Mmap::map(&file) }.map_err(io)?;
        Ok(Self(Some(map)))
    }
}

impl Deref for Mapped {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.0.as_deref().unwrap_or(&[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_what_was_written_and_an_empty_file_is_empty() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        std::fs::write(&path, b"abc").unwrap();
        assert_eq!(&*Mapped::open(&path).unwrap(), b"abc");
        std::fs::write(&path, b"").unwrap();
        assert_eq!(&*Mapped::open(&path).unwrap(), b"");
        assert!(matches!(
            Mapped::open(dir.path()),
            Err(CheckpointError::Io { .. })
        ));
    }
}
