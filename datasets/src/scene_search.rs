//! Searches a dataset's folder for scenes, and records what could not be searched.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::DatasetError;
use crate::files::{Root, list};
use crate::found_scenes::{LeftOutScene, Why};
use crate::left_out::LeftOut;

const LINK_OUT: &str = "a symbolic link points outside the dataset's folder";
const LINK_NOWHERE: &str = "broken symbolic link";
const UNREADABLE: &str = "the folder cannot be listed";

#[derive(Debug)]
pub(crate) struct FoundFolders {
    /// Folders of the scenes, in natural order.
    pub(crate) folders: Vec<PathBuf>,
    /// Folders that could not be searched.
    pub(crate) unsearched: Vec<LeftOutScene>,
}

impl Root {
    /// Finds the folders for which `is_scene` returns true, in natural order, at most `depth`
    /// levels below the root; the root itself is included. Folders inside a scene are not searched.
    /// Records what could not be searched: broken links, links that lead outside the root, and
    /// folders that cannot be listed. A folder that several links lead to is found once, under its
    /// first name.
    ///
    /// # Errors
    /// [`DatasetError::Io`] if the root cannot be listed.
    pub(crate) fn find_folders(
        &self,
        depth: usize,
        is_scene: &dyn Fn(&Path) -> bool,
    ) -> Result<FoundFolders, DatasetError> {
        let mut search = Search {
            root: self,
            is_scene,
            seen: BTreeSet::new(),
            found: FoundFolders {
                folders: Vec::new(),
                unsearched: Vec::new(),
            },
        };
        search.walk(self.path(), depth)?;
        Ok(search.found)
    }

    /// Files of a folder, keyed by name, without hidden ones; empty if the folder does not exist. Links that lead
    /// outside the root are excluded and added to `left_out`, as is a folder that cannot be read. Only symbolic links
    /// need a system call each.
    pub(crate) fn files_in(
        &self,
        folder: &Path,
        left_out: &mut LeftOut,
    ) -> BTreeMap<String, PathBuf> {
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) => {
                if error.kind() != ErrorKind::NotFound {
                    left_out.add(UNREADABLE, format!("{} ({error})", self.id_of(folder)));
                }
                return BTreeMap::new();
            }
        };
        let mut files = BTreeMap::new();
        for entry in entries.flatten() {
            let (name, path) = (
                entry.file_name().to_string_lossy().into_owned(),
                entry.path(),
            );
            if name.starts_with('.') {
                continue;
            }
            let is_link = entry.file_type().is_ok_and(|kind| kind.is_symlink());
            if is_link && self.check(&path).is_err() {
                left_out.add(format!("{LINK_OUT}{}", self.remedy), self.id_of(&path));
            } else {
                files.insert(name, path);
            }
        }
        files
    }
}

struct Search<'a> {
    root: &'a Root,
    is_scene: &'a dyn Fn(&Path) -> bool,
    seen: BTreeSet<PathBuf>,
    found: FoundFolders,
}

impl Search<'_> {
    fn pass_over(&mut self, id: String, reason: &str) {
        let error = DatasetError::malformed(self.root.path(), reason);
        self.found.unsearched.push(LeftOutScene {
            id,
            why: Why::Fault(error),
        });
    }

    fn walk(&mut self, folder: &Path, depth: usize) -> Result<(), DatasetError> {
        let canonical = folder
            .canonicalize()
            .map_err(|e| DatasetError::io(folder, e))?;
        if !self.root.outside_allowed && !canonical.starts_with(&self.root.canonical) {
            let name = self.root.id_of(folder);
            self.pass_over(name, &format!("{LINK_OUT}{}", self.root.remedy));
            return Ok(());
        }
        if !self.seen.insert(canonical) {
            return Ok(());
        }
        if (self.is_scene)(folder) {
            self.found.folders.push(folder.to_owned());
            return Ok(());
        }
        if depth == 0 {
            return Ok(());
        }
        for (_, path) in list(folder)? {
            match std::fs::metadata(&path) {
                Ok(found) if found.is_dir() => {
                    // A nested folder that cannot be read must not prevent finding the scenes next
                    // to it.
                    if let Err(error) = self.walk(&path, depth - 1) {
                        self.found.unsearched.push(LeftOutScene {
                            id: self.root.id_of(&path),
                            why: Why::Fault(error),
                        });
                    }
                }
                // The folder was deleted after its parent was listed.
                Err(error) if error.kind() == ErrorKind::NotFound => {
                    self.pass_over(self.root.id_of(&path), LINK_NOWHERE);
                }
                _ => {}
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn folders_and_files_that_links_put_elsewhere_are_counted() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let set = folder.path().join("set");
        for name in ["set/a/scene", "elsewhere/scene"] {
            std::fs::create_dir_all(folder.path().join(name)).unwrap();
        }
        std::fs::write(set.join("a/scene/1.png"), "").unwrap();
        symlink(folder.path().join("elsewhere"), set.join("b")).unwrap();
        symlink(folder.path().join("not there"), set.join("a/c")).unwrap();
        symlink(
            folder.path().join("elsewhere/2.png"),
            set.join("a/scene/2.png"),
        )
        .unwrap();
        std::fs::write(folder.path().join("elsewhere/2.png"), "").unwrap();
        let is_scene = |p: &Path| p.ends_with("scene");
        let root = Root::open(&set).unwrap();
        let found = root.find_folders(9, &is_scene).unwrap();
        assert_eq!(found.folders, [set.join("a/scene")]);
        let said = |scene: &LeftOutScene| format!("{}: {}", scene.id, scene.why);
        let said: Vec<String> = found.unsearched.iter().map(said).collect();
        let set_path = set.display();
        assert_eq!(
            said,
            [
                format!("a/c: {set_path}: {LINK_NOWHERE}"),
                format!("b: {set_path}: {LINK_OUT}"),
            ]
        );
        let mut linked = LeftOut::of("file");
        let files = root.files_in(&set.join("a/scene"), &mut linked);
        assert_eq!(files.keys().collect::<Vec<_>>(), ["1.png"]);
        assert_eq!(
            linked.notes(Path::new("set")),
            [format!(
                "set: 1 file(s) left out (a/scene/2.png): {LINK_OUT}"
            )]
        );
        let root = root.allowing_outside(true);
        let found = root.find_folders(9, &is_scene).unwrap();
        assert_eq!(found.folders, [set.join("a/scene"), set.join("b/scene")]);
    }
}
