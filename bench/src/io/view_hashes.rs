//! Hashes of a view's files. A file shared by many views (a laser scan, a list of cameras) is read
//! once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use sharp_datasets::required_files::FileRole;
use sharp_datasets::{DatasetError, View, ViewContent};

use crate::io::atomic_files::FileError;
use crate::io::hash::{HashedFile, sha256_hex};

/// A file with its hash, or `None` before the hash is computed; locked while it is computed.
type HashSlot = Arc<Mutex<Option<HashedFile>>>;

/// Hashes of procedural views, keyed by the address of their content. The `Arc` is kept so that the
/// address is not reused.
type ProceduralHashes = BTreeMap<usize, (Arc<dyn ViewContent>, String)>;

/// Computes each file's hash once and keeps it. A kept hash is not updated if the file changes;
/// [`changed`](Self::changed) finds such files.
#[derive(Debug, Default)]
pub(crate) struct ViewHashes {
    files: Mutex<BTreeMap<PathBuf, HashSlot>>,
    procedural: Mutex<ProceduralHashes>,
}

impl ViewHashes {
    /// SHA-256 of a file's bytes, 64 lower-case hexadecimal digits.
    pub(crate) fn file(&self, path: &Path) -> Result<String, FileError> {
        let slot = Arc::clone(lock(&self.files).entry(path.to_owned()).or_default());
        let mut known = lock(&slot);
        let file = match &mut *known {
            Some(file) => file,
            none => none.insert(HashedFile::read(path)?),
        };
        Ok(file.sha256().to_owned())
    }

    /// The first of `paths` whose content has changed since it was hashed.
    pub(crate) fn changed(&self, paths: impl IntoIterator<Item = PathBuf>) -> Option<PathBuf> {
        paths.into_iter().find(|path| {
            let slot = lock(&self.files).get(path).map(Arc::clone);
            slot.is_some_and(|slot| {
                let file = lock(&slot);
                file.as_ref().is_some_and(|file| !file.is_unchanged())
            })
        })
    }

    /// Hash of a view's camera, photograph, depth and mask.
    pub(crate) fn view(&self, view: &View) -> Result<String, DatasetError> {
        self.of_roles(view, |_| true)
    }

    /// Hash of a view's camera, of its photograph, and of everything else that changes the
    /// photograph's pixels (lens, mask), without depth.
    pub(crate) fn photograph(&self, view: &View) -> Result<String, DatasetError> {
        self.of_roles(view, |role| role != FileRole::Depth)
    }

    /// Hash of a view's camera and of the bytes of its photograph, mask and depth, 16 hexadecimal
    /// digits. Independent of the files' location and names, and of other views' entries in a
    /// shared camera list.
    pub(crate) fn short(&self, view: &View) -> Result<String, DatasetError> {
        let mut text = format!("{:?} {:?}\n", view.intrinsics, view.camera_from_world);
        let mut files = view.content.files_by_role();
        if files.is_empty() {
            text += &self.procedural(view)?;
        }
        files.retain(|(role, _)| !matches!(role, FileRole::Camera | FileRole::List));
        files.sort();
        files.dedup();
        for (role, path) in files {
            let hash = self
                .file(&path)
                .map_err(|error| DatasetError::io(error.path, error.source))?;
            text += &format!("{role:?} {hash}\n");
        }
        let mut hash = sha256_hex(text.as_bytes());
        hash.truncate(16);
        Ok(hash)
    }

    /// Hash of a procedural view's photograph, rendered once.
    fn procedural(&self, view: &View) -> Result<String, DatasetError> {
        let address = Arc::as_ptr(&view.content).addr();
        if let Some((_, known)) = lock(&self.procedural).get(&address) {
            return Ok(known.clone());
        }
        let hash = view.content.image_sha256()?;
        let kept = (Arc::clone(&view.content), hash.clone());
        lock(&self.procedural).insert(address, kept);
        Ok(hash)
    }

    fn of_roles(
        &self,
        view: &View,
        counts: impl Fn(FileRole) -> bool,
    ) -> Result<String, DatasetError> {
        let mut text = format!("{:?} {:?}\n", view.intrinsics, view.camera_from_world);
        let mut files = view.content.files_by_role();
        if files.is_empty() {
            text += &self.procedural(view)?;
        }
        files.retain(|(role, _)| counts(*role));
        let mut paths: Vec<PathBuf> = files.into_iter().map(|(_, path)| path).collect();
        paths.sort();
        paths.dedup();
        for path in paths {
            let hash = self
                .file(&path)
                .map_err(|error| DatasetError::io(error.path, error.source))?;
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            text += &format!("{name} {hash}\n");
        }
        Ok(sha256_hex(text.as_bytes()))
    }
}

/// Locks a mutex, ignoring poisoning: no code that holds a lock panics in the middle of a change.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp_datasets::{DatasetSpec, open};

    #[test]
    fn a_file_is_read_once_and_one_that_fails_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scan.ply");
        let hashes = ViewHashes::default();
        assert!(hashes.file(&path).is_err());
        std::fs::write(&path, "one").unwrap();
        assert_eq!(hashes.file(&path).unwrap(), sha256_hex(b"one"));
        assert_eq!(hashes.changed([path.clone()]), None);
        std::fs::write(&path, "two").unwrap();
        assert_eq!(hashes.file(&path).unwrap(), sha256_hex(b"one"));
        assert_eq!(hashes.changed([path.clone()]), Some(path.clone()));
        let fresh = ViewHashes::default();
        assert_eq!(fresh.file(&path).unwrap(), sha256_hex(b"two"));
    }

    #[test]
    fn views_differ_by_camera_and_content() {
        let spec = DatasetSpec::parse("synthetic=size=32x24,views=2").unwrap();
        let views = open(&spec).unwrap().remove(0).views;
        let hashes = ViewHashes::default();
        let first = hashes.view(&views[0]).unwrap();
        assert_eq!(first, hashes.view(&views[0]).unwrap());
        assert_ne!(first, hashes.view(&views[1]).unwrap());
        let mut moved = views[0].clone();
        moved.camera_from_world.translation.x += 1e-9;
        assert_ne!(first, hashes.view(&moved).unwrap());
        let mut other = views[0].clone();
        other.content = views[1].content.clone();
        assert_ne!(first, hashes.view(&other).unwrap());
    }
}
