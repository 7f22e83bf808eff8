//! Finds files by listed names that may differ from those on disk in case or extension, or have no extension.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::DatasetError;
use crate::files::{self, PICTURE_EXTENSIONS, Root, folded, is_picture_extension};
use crate::left_out::first_few;

/// [`folded`] stems of a folder's files, each with the files that have it, in natural order.
type Stems = BTreeMap<String, Vec<String>>;

/// Finds files by the names in a list. Each folder is read only once.
#[derive(Debug)]
pub(crate) struct FileFinder<'a> {
    root: &'a Root,
    list: PathBuf,
    listed: BTreeMap<PathBuf, Stems>,
    /// For each chosen file, the names of the candidates that were not chosen.
    passed_over: BTreeMap<PathBuf, Vec<String>>,
}

impl<'a> FileFinder<'a> {
    /// `list` is the file that contains the names.
    pub(crate) fn new(root: &'a Root, list: &Path) -> Self {
        Self {
            root,
            list: list.to_owned(),
            listed: BTreeMap::new(),
            passed_over: BTreeMap::new(),
        }
    }

    /// Finds the file called `name` below `base`. In order of preference: an exact match, the same name in another
    /// case, the same stem with one of the extensions. Among files of the last kind, the stem's own case comes first,
    /// then the order of the extensions counts. If a match of the last two kinds is ambiguous, [`Self::notes`] reports
    /// it. `None` if no file matches or the folder is missing.
    ///
    /// # Errors
    /// If the name points outside the dataset's folder; the error names the list.
    pub(crate) fn find(
        &mut self,
        base: &Path,
        name: &str,
        extensions: &[&str],
    ) -> Result<Option<PathBuf>, DatasetError> {
        let path = self.root.resolve_listed(&self.list, base, name)?;
        if path.is_file() {
            return Ok(Some(path));
        }
        let path = match path.parent() {
            Some(folder) if !folder.is_dir() => files::spelled(base, &path),
            _ => path,
        };
        let (Some(folder), Some(wanted)) = (path.parent(), path.file_name()) else {
            return Ok(None);
        };
        let wanted = wanted.to_string_lossy();
        let stem = match wanted.rsplit_once('.') {
            Some((stem, extension)) if is_picture_extension(extension) => stem,
            _ => &wanted,
        };
        let stems = self
            .listed
            .entry(folder.to_owned())
            .or_insert_with(|| stems_in(folder));
        let of_stem = |stem: &str| stems.get(&folded(stem)).into_iter().flatten();
        let is_file = |name: &&String| folder.join(name).is_file();
        let mut fitting: Vec<&String> = of_stem(split(&wanted).0)
            .filter(|name| folded(name) == folded(&wanted))
            .filter(is_file)
            .collect();
        if fitting.is_empty() {
            let mut ranked: Vec<_> = of_stem(stem)
                .filter_map(|name| {
                    let (found, extension) = split(name);
                    let extension = extension.to_ascii_lowercase();
                    let rank = extensions.iter().position(|e| *e == extension)?;
                    Some(((found != stem, rank), name))
                })
                .filter(|(_, name)| is_file(name))
                .collect();
            // The sort is stable, so files of equal rank stay in natural order.
            ranked.sort_by_key(|(rank, _)| *rank);
            fitting = ranked.into_iter().map(|(_, name)| name).collect();
        }
        let Some((chosen, others)) = fitting.split_first() else {
            return Ok(None);
        };
        let found = folder.join(chosen);
        self.root.check(&found)?;
        if !others.is_empty() {
            let others = others.iter().map(|name| (*name).clone()).collect();
            self.passed_over.insert(found.clone(), others);
        }
        Ok(Some(found))
    }

    /// Finds a picture: PNG, which is lossless, is preferred to JPEG.
    ///
    /// # Errors
    /// As for [`FileFinder::find`].
    pub(crate) fn picture(
        &mut self,
        base: &Path,
        name: &str,
    ) -> Result<Option<PathBuf>, DatasetError> {
        self.find(base, name, &PICTURE_EXTENSIONS)
    }

    /// Finds a depth map in any format.
    ///
    /// # Errors
    /// As for [`FileFinder::find`].
    pub(crate) fn map(&mut self, base: &Path, name: &str) -> Result<Option<PathBuf>, DatasetError> {
        self.find(base, name, &["png", "npy", "npz", "exr", "pfm"])
    }

    /// A note on the names that match several files; empty if there are none.
    pub(crate) fn notes(&self) -> Vec<String> {
        if self.passed_over.is_empty() {
            return Vec::new();
        }
        let choices: Vec<String> = self
            .passed_over
            .iter()
            .map(|(chosen, others)| {
                let name = self.root.id_of(chosen);
                format!("{name} is read, not {}", others.join(", "))
            })
            .collect();
        vec![format!(
            "{}: {} name(s) match several files that differ in case or extension: {}",
            self.list.display(),
            choices.len(),
            first_few(&choices)
        )]
    }
}

fn stems_in(folder: &Path) -> Stems {
    let mut stems = Stems::new();
    for (name, _) in files::list(folder).unwrap_or_default() {
        let stem = folded(split(&name).0);
        stems.entry(stem).or_default().push(name);
    }
    stems
}

/// Splits a name at its last dot.
fn split(name: &str) -> (&str, &str) {
    name.rsplit_once('.').unwrap_or((name, ""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_builder::frame_id;

    #[test]
    fn names_are_found_in_another_case_and_without_extension() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("images")).unwrap();
        std::fs::write(folder.path().join("images/DSC_1.JPG"), "").unwrap();
        std::fs::write(folder.path().join("images/r_0.png"), "").unwrap();
        let root = Root::open(folder.path()).unwrap();
        let mut finder = FileFinder::new(&root, Path::new("list.txt"));
        for (name, found) in [
            ("images/DSC_1.JPG", Some("images/DSC_1.JPG")),
            ("./images/dsc_1.jpg", Some("images/DSC_1.JPG")),
            ("images/DSC_1.png", Some("images/DSC_1.JPG")),
            ("./images/r_0", Some("images/r_0.png")),
            ("images\\r_0.png", Some("images/r_0.png")),
            ("images/r_00", None),
            ("nowhere/r_0", None),
        ] {
            let path = finder.picture(root.path(), name).unwrap();
            assert_eq!(path, found.map(|f| folder.path().join(f)), "{name}");
        }
        assert!(finder.picture(root.path(), "../r_0.png").is_err());
        assert_eq!(frame_id("./images/a.b.JPG"), "images/a.b");
        assert_eq!(frame_id("images\\r_0"), "images/r_0");
    }

    #[test]
    fn of_several_files_the_closest_name_is_found_and_the_others_are_noted() {
        let folder = tempfile::tempdir().unwrap();
        let files = [
            "a.jpg", "a.png", "b.JPG", "b.png", "C.png", "c.jpeg", "d.PNG", "d.Png",
        ];
        for file in files {
            std::fs::write(folder.path().join(file), "").unwrap();
        }
        std::fs::create_dir(folder.path().join("e.png")).unwrap();
        std::fs::write(folder.path().join("e.jpg"), "").unwrap();
        let root = Root::open(folder.path()).unwrap();
        for (name, found, others) in [
            // An exact match.
            ("a.jpg", "a.jpg", None),
            // A name that differs only in case is preferred to one with another extension.
            ("b.jpg", "b.JPG", None),
            ("A.JPG", "a.jpg", None),
            // PNG is preferred to JPEG if the name has no extension.
            ("a", "a.png", Some("a.jpg")),
            ("a.jpeg", "a.png", Some("a.jpg")),
            // The stem's own case is preferred.
            ("c", "c.jpeg", Some("C.png")),
            ("c.jpg", "c.jpeg", Some("C.png")),
            ("d.png", "d.PNG", Some("d.Png")),
            // A folder is not a picture.
            ("e", "e.jpg", None),
        ] {
            let mut finder = FileFinder::new(&root, Path::new("list.txt"));
            let path = finder.picture(root.path(), name).unwrap();
            assert_eq!(path, Some(folder.path().join(found)), "{name}");
            let notes = finder.notes();
            match others {
                None => assert!(notes.is_empty(), "{name}: {notes:?}"),
                Some(other) => assert_eq!(
                    notes,
                    [format!(
                        "list.txt: 1 name(s) match several files that differ in case or extension: {found} is \
                         read, not {other}"
                    )]
                ),
            }
        }
    }
}
