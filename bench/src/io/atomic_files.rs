//! Atomic file writes: a file appears complete or not at all.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tempfile::TempDir;

/// Name prefix of files being written.
const PARTIAL: &str = ".partial-";

/// Name prefix of folders that are removed when the process that created them ends.
const SCRATCH: &str = ".scratch-";

#[derive(Debug, thiserror::Error)]
#[error("{}: cannot {action}: {source}", path.display())]
pub struct FileError {
    pub path: PathBuf,
    pub action: &'static str,
    pub source: io::Error,
}

impl FileError {
    /// Creates an error constructor for `map_err`.
    pub fn new(path: &Path, action: &'static str) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self {
            path,
            action,
            source,
        }
    }
}

/// Writes a file atomically, creating its folder. A reader, or a restart after a kill, sees either the old or the new
/// content.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let mut file = PartialFile::create(path)?;
    file.write_all(bytes)
        .map_err(FileError::new(path, "write"))?;
    file.commit()
}

/// Like [`write_atomic`], but does not sync to disk. Meant for many small files that can be
/// regenerated. A reader, or a restart after a kill, sees the complete content or none; after a
/// power loss the file may be empty.
pub fn write_replaceable(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let mut file = PartialFile::create(path)?;
    file.write_all(bytes)
        .map_err(FileError::new(path, "write"))?;
    let persisted = file.file.persist(path);
    persisted.map_err(|error| FileError::new(path, "write")(error.error))?;
    Ok(())
}

/// Like [`write_atomic`], but overwrites only an earlier file of the same kind, recognised by
/// `mark` in its content.
pub fn write_over_own(path: &Path, bytes: &[u8], mark: &str) -> Result<(), FileError> {
    write_all_over_own(&[(path, bytes, mark)]).map(drop)
}

/// Like [`write_over_own`] for several files, each with its mark. All files are checked before the
/// first is written, so nothing is written if any existing file is of another kind. Returns the
/// paths.
pub fn write_all_over_own(
    files: &[(impl AsRef<Path>, impl AsRef<[u8]>, &str)],
) -> Result<Vec<PathBuf>, FileError> {
    for (path, _, mark) in files {
        refuse_others(path.as_ref(), |there| has_mark(there, mark))?;
    }
    let written = files.iter().map(|(path, bytes, _)| {
        let path = path.as_ref();
        write_atomic(path, bytes.as_ref()).map(|()| path.to_owned())
    });
    written.collect()
}

/// Removes a file that contains `mark`; returns false if the file does not exist.
pub fn remove_own(path: &Path, mark: &str) -> Result<bool, FileError> {
    let is_own = is_file_that(path, |there| has_mark(there, mark));
    if is_own {
        fs::remove_file(path).map_err(FileError::new(path, "remove"))?;
    }
    Ok(is_own)
}

fn has_mark(bytes: &[u8], mark: &str) -> bool {
    String::from_utf8_lossy(bytes).contains(mark)
}

/// Whether `path` is a regular file whose content passes `test`; false for devices and pipes.
fn is_file_that(path: &Path, test: impl Fn(&[u8]) -> bool) -> bool {
    path.is_file() && sharp::files::read(path).is_ok_and(|there| test(&there))
}

fn refuse_others(path: &Path, is_own: impl Fn(&[u8]) -> bool) -> Result<(), FileError> {
    if path.exists() && !is_file_that(path, is_own) {
        let reason =
            "the existing file is of another kind and is not overwritten; choose another file";
        return Err(FileError::new(path, "write")(io::Error::other(reason)));
    }
    Ok(())
}

/// Writes a value atomically as indented JSON with a final newline.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), FileError> {
    let mut bytes = serde_json::to_vec_pretty(value)
        .map_err(|error| FileError::new(path, "encode")(error.into()))?;
    bytes.push(b'\n');
    write_atomic(path, &bytes)
}

/// A file under construction, written piece by piece. The file gets its final name at
/// [`Self::commit`]; if dropped earlier, the file is removed.
#[derive(Debug)]
pub struct PartialFile {
    path: PathBuf,
    file: tempfile::NamedTempFile,
}

impl PartialFile {
    /// Creates a file and its folder. The first call for a folder also removes partial files of killed processes.
    pub fn create(path: &Path) -> Result<Self, FileError> {
        let create = || -> io::Result<tempfile::NamedTempFile> {
            let folder = folder_of(path);
            fs::create_dir_all(folder)?;
            remove_abandoned(folder);
            let mut builder = tempfile::Builder::new();
            builder.prefix(PARTIAL);
            // Temporary files are private by default; results get the permissions that the umask allows.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            loop {
                let file = builder.tempfile_in(folder)?;
                // The lock marks the file as in use. Until the lock is taken, another process may
                // remove the file as abandoned; in that case, try again.
                let locked = file.as_file().lock();
                if locked.is_err() || file.path().exists() {
                    return Ok(file);
                }
            }
        };
        Ok(Self {
            path: path.to_owned(),
            file: create().map_err(FileError::new(path, "write"))?,
        })
    }

    /// Path of the unfinished file, for another program to write to.
    pub fn temporary_path(&self) -> &Path {
        self.file.path()
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn commit(self) -> Result<(), FileError> {
        let Self { path, file } = self;
        let commit = || -> io::Result<()> {
            file.as_file().sync_all()?;
            file.persist(&path).map_err(|error| error.error)?;
            sync_folder(folder_of(&path))
        };
        commit().map_err(FileError::new(&path, "write"))
    }

    /// Like [`Self::commit`], but returns false and keeps the existing file if a file of that name
    /// exists, even if another process has just created it.
    pub fn commit_new(self) -> Result<bool, FileError> {
        let Self { path, file } = self;
        let commit = || -> io::Result<bool> {
            file.as_file().sync_all()?;
            match file.persist_noclobber(&path) {
                Ok(_) => sync_folder(folder_of(&path)).map(|()| true),
                Err(error) if error.error.kind() == io::ErrorKind::AlreadyExists => Ok(false),
                Err(error) => Err(error.error),
            }
        };
        commit().map_err(FileError::new(&path, "write"))
    }
}

impl Write for PartialFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Removes partial files that are not locked, because their processes have ended. Runs once per folder and process;
/// does nothing on file systems without locks.
fn remove_abandoned(folder: &Path) {
    static SEEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let is_new = |seen: &mut BTreeSet<PathBuf>| match fs::canonicalize(folder) {
        Ok(folder) => seen.insert(folder),
        Err(_) => false,
    };
    if !is_new(&mut SEEN.lock().unwrap_or_else(PoisonError::into_inner)) {
        return;
    }
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_partial = entry.file_name().to_string_lossy().starts_with(PARTIAL);
        // Do not follow links or open pipes, which would wait for a writer.
        if is_partial && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            // Hold the lock during removal. Files that cannot be removed are harmless and stay.
            if let Ok(file) = File::open(entry.path())
                && file.try_lock().is_ok()
            {
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

/// The parent folder of a file, which need not exist.
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Creates a folder if needed and checks that files can be created in it.
pub fn check_writable(folder: &Path) -> Result<(), FileError> {
    let check = || -> io::Result<()> {
        fs::create_dir_all(folder)?;
        tempfile::Builder::new()
            .prefix(PARTIAL)
            .tempfile_in(folder)?;
        Ok(())
    };
    check().map_err(FileError::new(folder, "write into"))
}

/// A folder that is removed when dropped, or by [`remove_leftovers`] if the process was killed. Its path is absolute.
pub fn scratch_folder(within: &Path) -> Result<TempDir, FileError> {
    let made = tempfile::Builder::new().prefix(SCRATCH).tempdir_in(within);
    made.map_err(FileError::new(within, "write into"))
}

/// Removes leftovers of killed processes in `folder`, and recursively in its subfolders named in
/// `below` (in all subfolders if `below` is empty). Only entries unchanged for longer than `age`
/// are removed. An age of zero removes all leftovers, so use zero only for folders in which no
/// other process writes. Entries that cannot be removed are harmless and stay.
pub fn remove_leftovers(folder: &Path, below: &[&str], age: Duration) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        let name = name.to_string_lossy();
        let is_old = || {
            let changed = entry.metadata().and_then(|file| file.modified());
            age.is_zero() || changed.is_ok_and(|time| time.elapsed().is_ok_and(|since| since > age))
        };
        // Do not follow links.
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        let _ = match is_folder {
            false if name.starts_with(PARTIAL) && is_old() => fs::remove_file(&path),
            true if name.starts_with(SCRATCH) && is_old() => fs::remove_dir_all(&path),
            true if below.is_empty() || below.contains(&&*name) => {
                remove_leftovers(&path, &[], age);
                Ok(())
            }
            _ => Ok(()),
        };
    }
}

/// Makes a rename survive a power loss, on systems where folders can be synced.
fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) {
        File::open(folder)?.sync_all()
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_replaced_whole_and_leave_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a/b/c.txt");
        write_atomic(&path, b"one").unwrap();
        write_atomic(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        let names: Vec<_> = fs::read_dir(path.parent().unwrap())
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        assert_eq!(names, ["c.txt"]);

        let mut dropped = PartialFile::create(&path).unwrap();
        dropped.write_all(b"thr").unwrap();
        drop(dropped);
        let taken = PartialFile::create(&path).unwrap();
        assert!(!taken.commit_new().unwrap());
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        let new = dir.path().join("new/folder");
        check_writable(&new).unwrap();
        assert_eq!(fs::read_dir(&new).unwrap().count(), 0);
        assert!(check_writable(&path.join("below a file")).is_err());
    }

    #[test]
    fn what_a_killed_process_left_goes_with_the_first_file_and_what_another_writes_stays() {
        let dir = tempfile::tempdir().unwrap();
        let abandoned = dir.path().join(".partial-abandoned");
        fs::write(&abandoned, "x").unwrap();
        let held = dir.path().join(".partial-held");
        let other = File::create(&held).unwrap();
        other.lock().unwrap();
        let file = PartialFile::create(&dir.path().join("file")).unwrap();
        assert!(!abandoned.exists() && held.exists() && file.temporary_path().exists());
        assert!(
            File::open(file.temporary_path())
                .unwrap()
                .try_lock()
                .is_err()
        );
    }

    #[test]
    fn one_file_of_somebody_else_keeps_all_from_being_written() {
        let dir = tempfile::tempdir().unwrap();
        let [ours, new, theirs] = ["ours", "new", "theirs"].map(|name| dir.path().join(name));
        fs::write(&ours, "mark 1").unwrap();
        fs::write(&theirs, "x").unwrap();
        let all = [&ours, &new, &theirs].map(|path| (path, b"mark 2", "mark"));
        let error = write_all_over_own(&all).unwrap_err().to_string();
        assert!(error.contains("theirs: cannot write"), "{error}");
        assert_eq!(fs::read(&ours).unwrap(), b"mark 1");
        assert!(!new.exists());
        assert_eq!(write_all_over_own(&all[..2]).unwrap(), [&*ours, &*new]);
        assert!(remove_own(&new, "mark").unwrap() && !new.exists());
        assert!(!remove_own(&theirs, "mark").unwrap() && theirs.exists());
    }

    #[test]
    fn leftovers_go_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let scratch = scratch_folder(dir.path()).unwrap().keep();
        write_atomic(&scratch.join("source.png"), b"x").unwrap();
        let partial = [".partial-a", "ours/deep/.partial-b"].map(|name| dir.path().join(name));
        let others = [".partial.txt", "ours/x.json", "theirs/.partial-c"];
        let others = others.map(|name| dir.path().join(name));
        for path in partial.iter().chain(&others) {
            write_atomic(path, b"x").unwrap();
        }
        let removed = || !scratch.exists() && !partial.iter().any(|path| path.exists());
        remove_leftovers(dir.path(), &["ours"], Duration::from_secs(3600));
        assert!(scratch.exists() && partial.iter().all(|path| path.exists()));
        remove_leftovers(dir.path(), &["ours"], Duration::ZERO);
        assert!(removed());
        assert!(others.iter().all(|path| path.exists()));
    }
}
