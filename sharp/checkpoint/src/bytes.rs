//! Random access to the bytes of a file.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::error::Fault;
use crate::hash::reader_sha256;

/// Random access to the bytes of a checkpoint, through which its table of contents and its tensors
/// are read.
pub(crate) trait Bytes {
    /// Length of the file when it was opened.
    fn len(&self) -> usize;

    /// Fills `out` with the bytes from offset `at`.
    ///
    /// # Errors
    /// [`Fault::Io`], including when the file has become shorter since it was opened.
    fn read_into(&self, at: usize, out: &mut [u8]) -> Result<(), Fault>;

    /// Returns the bytes of `range`, which must lie within [`Self::len`].
    ///
    /// # Errors
    /// As for [`Self::read_into`].
    fn get(&self, range: Range<usize>) -> Result<Vec<u8>, Fault> {
        let mut bytes = vec![0; range.len()];
        self.read_into(range.start, &mut bytes)?;
        Ok(bytes)
    }

    /// Returns the first `len` bytes, or all bytes if the file is shorter.
    ///
    /// # Errors
    /// As for [`Self::read_into`].
    fn start(&self, len: usize) -> Result<Vec<u8>, Fault> {
        self.get(0..len.min(self.len()))
    }
}

/// An open file. The file is read rather than memory-mapped, because accessing a mapped file that
/// someone truncates kills the process.
#[derive(Debug)]
pub(crate) struct OpenFile {
    file: Mutex<File>,
    len: usize,
}

impl OpenFile {
    /// Opens a regular file. Pipes and devices are refused, because they may never end.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        let meta = path.metadata()?;
        if meta.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if !meta.is_file() {
            return Err(io::Error::other("not a regular file"));
        }
        let file = File::open(path)?;
        let len = usize::try_from(file.metadata()?.len()).map_err(io::Error::other)?;
        Ok(Self {
            file: Mutex::new(file),
            len,
        })
    }

    /// SHA-256 of the whole current file.
    pub(crate) fn sha256(&self) -> io::Result<String> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.rewind()?;
        reader_sha256(&mut *file)
    }
}

impl Bytes for OpenFile {
    fn len(&self) -> usize {
        self.len
    }

    fn read_into(&self, at: usize, out: &mut [u8]) -> Result<(), Fault> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let read = file
            .seek(SeekFrom::Start(at as u64))
            .and_then(|_| file.read_exact(out));
        read.map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => Fault::Io(io::Error::new(
                error.kind(),
                "the file became shorter while it was being read",
            )),
            _ => Fault::Io(error),
        })
    }
}

#[cfg(test)]
impl Bytes for [u8] {
    fn len(&self) -> usize {
        <[u8]>::len(self)
    }

    fn read_into(&self, at: usize, out: &mut [u8]) -> Result<(), Fault> {
        out.copy_from_slice(&self[at..at + out.len()]);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_cut_off_after_it_was_opened_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        std::fs::write(&path, vec![7; 10_000]).unwrap();
        let file = OpenFile::open(&path).unwrap();
        assert_eq!(file.get(9_998..10_000).unwrap(), [7, 7]);
        let writer = File::options().write(true).open(&path).unwrap();
        writer.set_len(5_000).unwrap();
        assert_eq!(file.get(0..1).unwrap(), [7]);
        let Err(Fault::Io(error)) = file.get(4_999..5_001) else {
            panic!("read beyond the end");
        };
        assert!(error.to_string().contains("shorter"));
    }

    #[test]
    fn only_regular_files_are_opened() {
        assert!(OpenFile::open(&std::env::temp_dir()).is_err());
        #[cfg(unix)]
        {
            let error = OpenFile::open(Path::new("/dev/zero")).unwrap_err();
            assert!(error.to_string().contains("not a regular file"));
        }
    }
}
