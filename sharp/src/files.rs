//! Reading of user-supplied files. Only regular files are accepted, so that reading terminates.

use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Reads a whole file. Pipes and devices are refused, because they may never end.
///
/// # Errors
/// Any I/O error; also if the path is not a regular file.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let kind = fs::metadata(path)?.file_type();
    if kind.is_file() || kind.is_dir() {
        fs::read(path)
    } else {
        Err(io::Error::other("not a regular file"))
    }
}

/// Like [`read`], as UTF-8 text.
///
/// # Errors
/// As for [`read`]; also if the bytes are not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read(path)?)
        .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
}

/// Opens a regular file; pipes and devices are refused.
///
/// # Errors
/// Any I/O error; also if the path is not a regular file.
pub fn open_regular(path: &Path) -> io::Result<File> {
    // Checked before opening, because opening a pipe waits for its writer.
    if fs::metadata(path)?.is_file() {
        File::open(path)
    } else {
        Err(io::Error::other("not a regular file"))
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn what_never_ends_is_refused() {
        let zero = Path::new("/dev/zero");
        assert!(read(zero).unwrap_err().to_string().contains("regular"));
        assert!(read_text(zero).is_err() && open_regular(zero).is_err());
        assert!(open_regular(Path::new("/")).is_err());
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "text").unwrap();
        assert_eq!(read_text(file.path()).unwrap(), "text");
        assert!(open_regular(file.path()).is_ok());
    }
}
