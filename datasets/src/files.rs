//! Access to a dataset's folder: bounded reads and ordered listings, confined to the folder.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use sharp_checkpoint::hash::reader_sha256;
use unicode_normalization_alignments::UnicodeNormalization;

use crate::format::error::FormatError;
use crate::left_out::first_few;
use crate::{DatasetError, natural_order};

/// The folder given by the user. Every file that a reader opens is resolved through it: neither
/// `..` nor a symbolic link may lead outside the folder, because file lists and JSON are not
/// trusted.
#[derive(Debug, Clone)]
pub struct Root {
    pub(crate) canonical: PathBuf,
    given: PathBuf,
    pub(crate) outside_allowed: bool,
    /// The dataset's setting, if any, that allows names and links to lead outside the folder.
    pub(crate) remedy: &'static str,
}

impl Root {
    /// Opens a folder; it may itself be a symbolic link.
    ///
    /// # Errors
    /// [`DatasetError::Io`] if the path does not exist, [`DatasetError::Malformed`] if it is a
    /// file.
    pub fn open(path: &Path) -> Result<Self, DatasetError> {
        let canonical = path.canonicalize().map_err(|e| DatasetError::io(path, e))?;
        if !canonical.is_dir() {
            return Err(DatasetError::malformed(path, "not a folder"));
        }
        Ok(Self {
            canonical,
            given: path.to_owned(),
            outside_allowed: false,
            remedy: "",
        })
    }

    /// Sets whether names and links may lead outside the folder, for files that the user trusts. Errors mention the
    /// setting that allows this.
    pub(crate) fn allowing_outside(self, outside_allowed: bool) -> Self {
        Self {
            outside_allowed,
            remedy: " (outside=allow reads such files; only for files you trust)",
            ..self
        }
    }

    /// The folder's path, as the user gave it.
    pub fn path(&self) -> &Path {
        &self.given
    }

    /// Last component of the folder's path, for scenes without another name.
    pub fn name(&self) -> String {
        self.canonical.file_name().map_or_else(
            || "scene".to_owned(),
            |name| name.to_string_lossy().into_owned(),
        )
    }

    /// Resolves a name found in a file (with `/` or `\` as separators) relative to `base`, which is inside this root.
    /// The file need not exist.
    ///
    /// # Errors
    /// [`DatasetError::Malformed`] if the name is absolute or leads outside the root, by `..` or through a symbolic
    /// link, unless the root allows this.
    pub fn resolve(&self, base: &Path, name: &str) -> Result<PathBuf, DatasetError> {
        self.resolve_listed(&self.given, base, name)
    }

    /// Like [`Root::resolve`], for a name found in the file `list`; the error names `list`.
    pub fn resolve_listed(
        &self,
        list: &Path,
        base: &Path,
        name: &str,
    ) -> Result<PathBuf, DatasetError> {
        let leaves = |name: &str| {
            DatasetError::malformed(
                list,
                format!(
                    "the path '{name}' points outside the dataset's folder{}",
                    self.remedy
                ),
            )
        };
        let name = name.replace('\\', "/");
        let relative = Path::new(&name);
        if self.outside_allowed {
            return Ok(base.join(relative));
        }
        let absolute = relative
            .components()
            .any(|c| matches!(c, Component::RootDir | Component::Prefix(_)))
            || name.as_bytes().get(1) == Some(&b':');
        if absolute || name.contains('\0') {
            return Err(leaves(&name));
        }
        let mut path = base.to_owned();
        for component in relative.components() {
            match component {
                Component::ParentDir if path == self.given || !path.pop() => {
                    return Err(leaves(&name));
                }
                Component::Normal(part) => path.push(part),
                _ => {}
            }
        }
        self.check(&path)?;
        Ok(path)
    }

    /// Checks that a path constructed by this crate does not leave the root through a symbolic link.
    ///
    /// # Errors
    /// [`DatasetError::Malformed`] if the path leaves the root.
    pub fn check(&self, path: &Path) -> Result<(), DatasetError> {
        match path.canonicalize() {
            Ok(target) if !self.outside_allowed && !target.starts_with(&self.canonical) => {
                Err(DatasetError::malformed(
                    path,
                    format!(
                        "points outside the dataset's folder {}, to {}{}",
                        self.given.display(),
                        target.display(),
                        self.remedy
                    ),
                ))
            }
            // A missing file is reported when it is opened.
            _ => Ok(()),
        }
    }

    /// Converts a path below the root to an identifier: its components joined by `/`, or the root's own name for the
    /// root itself.
    pub fn id_of(&self, path: &Path) -> String {
        let parts: Vec<_> = path
            .strip_prefix(&self.given)
            .unwrap_or(path)
            .components()
            .filter_map(|c| match c {
                Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
                _ => None,
            })
            .collect();
        if parts.is_empty() {
            self.name()
        } else {
            parts.join("/")
        }
    }
}

/// Names and paths in a folder in natural order, without files left by operating systems: hidden
/// files, `__MACOSX`, AppleDouble `._*`. Names that are not UTF-8 are converted lossily.
///
/// # Errors
/// If the folder cannot be listed.
pub fn list(folder: &Path) -> Result<Vec<(String, PathBuf)>, DatasetError> {
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| DatasetError::io(folder, e))? {
        let entry = entry.map_err(|e| DatasetError::io(folder, e))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if !name.starts_with('.') && name != "__MACOSX" {
            entries.push((name, entry.path()));
        }
    }
    entries.sort_by(|a, b| natural_order::compare(&a.0, &b.0).then_with(|| a.1.cmp(&b.1)));
    Ok(entries)
}

/// Names and paths of the pictures in a folder, recognised by their extensions, in the order of
/// [`list`].
pub(crate) fn pictures(folder: &Path) -> Result<Vec<(String, PathBuf)>, DatasetError> {
    let mut entries = list(folder)?;
    entries.retain(|(name, _)| {
        let extension = name.rsplit_once('.');
        extension.is_some_and(|(_, extension)| is_picture_extension(extension))
    });
    Ok(entries)
}

/// A name in Unicode's NFC, so that names that differ only in how accents are composed are equal.
pub fn composed(name: &str) -> String {
    name.nfc().map(|(c, _)| c).collect()
}

/// A name in lower case and in NFC, see [`composed`].
pub fn folded(name: &str) -> String {
    composed(name).to_lowercase()
}

/// The files in a folder with the given stem and one of the given lower-case extensions, in the
/// order of `extensions`. If there are none, the files whose stem equals `stem` once both are
/// [`folded`], in the folder's order. Empty if the folder does not exist.
pub fn of_stem(folder: &Path, stem: &str, extensions: &[&str]) -> Vec<PathBuf> {
    let exact = extensions
        .iter()
        .map(|extension| folder.join(format!("{stem}.{extension}")));
    let exact: Vec<PathBuf> = exact.filter(|path| path.is_file()).collect();
    if !exact.is_empty() {
        return exact;
    }
    let stem = folded(stem);
    let fits = |name: &str| {
        let parts = name.rsplit_once('.');
        parts.is_some_and(|(found, extension)| {
            extensions.contains(&extension.to_ascii_lowercase().as_str()) && folded(found) == stem
        })
    };
    let there = list(folder).unwrap_or_default().into_iter();
    let fitting = there.filter(|(name, path)| fits(name) && path.is_file());
    fitting.map(|(_, path)| path).collect()
}

/// The folder on disk whose path equals `path` once both are [`folded`], or `path` itself if no
/// folder matches. Only names below `base` may differ.
pub(crate) fn spelled(base: &Path, path: &Path) -> PathBuf {
    let Ok(relative) = path.strip_prefix(base) else {
        return path.to_owned();
    };
    relative.iter().fold(base.to_owned(), |folder, part| {
        let exact = folder.join(part);
        if exact.exists() {
            return exact;
        }
        let wanted = folded(&part.to_string_lossy());
        let mut there = list(&folder).unwrap_or_default().into_iter();
        let found = there.find(|(name, path)| path.is_dir() && folded(name) == wanted);
        found.map_or(exact, |(_, path)| path)
    })
}

/// Describes the first entries of a folder, or of its nearest existing ancestor.
pub fn what_lies_in(folder: &Path) -> String {
    let there = folder.ancestors().find(|folder| folder.is_dir());
    let Some(folder) = there else {
        return format!("{} does not exist", folder.display());
    };
    let names: Vec<String> = list(folder)
        .unwrap_or_default()
        .into_iter()
        .map(|(name, path)| if path.is_dir() { name + "/" } else { name })
        .collect();
    if names.is_empty() {
        format!("{} is empty", folder.display())
    } else {
        format!("{} contains {}", folder.display(), first_few(&names))
    }
}

/// Reads a whole regular file. Pipes and devices are refused, because they may never end.
///
/// # Errors
/// [`DatasetError::Io`]; [`DatasetError::Malformed`] if it is not a regular file.
pub fn read(path: &Path) -> Result<Vec<u8>, DatasetError> {
    let mut file = open(path)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)
        .map_err(|e| DatasetError::io(path, e))?;
    Ok(bytes)
}

/// Reads a regular file as UTF-8 text, without a byte order mark.
///
/// # Errors
/// As for [`read`]; [`DatasetError::Malformed`] if the text is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, DatasetError> {
    let text = String::from_utf8(read(path)?)
        .map_err(|e| DatasetError::malformed(path, format!("not UTF-8 text: {e}")))?;
    Ok(text
        .strip_prefix('\u{feff}')
        .map(str::to_owned)
        .unwrap_or(text))
}

/// Reads a whole file and parses it.
///
/// # Errors
/// As for [`read`]; [`DatasetError::Format`].
pub fn parse<T>(
    path: &Path,
    parse: impl FnOnce(&[u8]) -> Result<T, FormatError>,
) -> Result<T, DatasetError> {
    parse(&read(path)?).map_err(|error| DatasetError::format(path, error))
}

/// Like [`parse`], for text.
///
/// # Errors
/// As for [`read_text`]; [`DatasetError::Format`].
pub fn parse_text<T>(
    path: &Path,
    parse: impl FnOnce(&str) -> Result<T, FormatError>,
) -> Result<T, DatasetError> {
    parse(&read_text(path)?).map_err(|error| DatasetError::format(path, error))
}

/// Opens a regular file.
///
/// # Errors
/// As for [`read`].
pub fn open(path: &Path) -> Result<File, DatasetError> {
    sharp::files::open_regular(path).map_err(|e| DatasetError::io(path, e))
}

/// SHA-256 of a file's bytes, 64 lower-case hexadecimal digits.
///
/// # Errors
/// As for [`read`].
pub fn sha256(path: &Path) -> Result<String, DatasetError> {
    reader_sha256(open(path)?).map_err(|e| DatasetError::io(path, e))
}

/// Extensions of pictures in lower case, lossless formats first.
pub(crate) const PICTURE_EXTENSIONS: [&str; 8] =
    ["png", "tif", "tiff", "bmp", "webp", "jpg", "jpeg", "jfif"];

pub(crate) fn is_picture_extension(extension: &str) -> bool {
    let extension = extension.to_ascii_lowercase();
    PICTURE_EXTENSIONS.contains(&extension.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_the_root() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("set/images");
        std::fs::create_dir_all(&inside).unwrap();
        std::fs::write(folder.path().join("secret"), "x").unwrap();
        std::fs::write(inside.join("a.png"), "x").unwrap();
        let root = Root::open(&folder.path().join("set")).unwrap();
        let base = root.path().to_owned();
        for name in [
            "../secret",
            "/etc/hostname",
            "images/../../secret",
            "C:\\x",
            "..\\secret",
        ] {
            let error = root.resolve(&base, name).unwrap_err().to_string();
            assert!(error.contains("points outside"), "{error}");
        }
        let found = root
            .resolve(&base.join("images"), "./../images/a.png")
            .unwrap();
        assert_eq!(found, base.join("images/a.png"));
        assert_eq!(root.id_of(&found), "images/a.png");
        assert_eq!(root.id_of(&base), "set");
    }

    #[cfg(unix)]
    #[test]
    fn symbolic_links_cannot_leave_the_root_but_the_root_may_be_one() {
        let folder = tempfile::tempdir().unwrap();
        let set = folder.path().join("set");
        std::fs::create_dir_all(set.join("a")).unwrap();
        std::fs::write(folder.path().join("secret"), "x").unwrap();
        std::os::unix::fs::symlink(folder.path().join("secret"), set.join("a/link")).unwrap();
        std::os::unix::fs::symlink(&set, set.join("a/loop")).unwrap();
        std::os::unix::fs::symlink(&set, folder.path().join("alias")).unwrap();
        let root = Root::open(&folder.path().join("alias")).unwrap();
        let error = root.resolve(root.path(), "a/link").unwrap_err().to_string();
        assert!(error.contains("points outside"), "{error}");
        let found = root.find_folders(9, &|p| p.ends_with("a")).unwrap();
        assert_eq!(found.folders.len(), 1);
    }

    #[test]
    fn litter_is_not_listed_and_pipes_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        for name in [".DS_Store", "._im0.png", "im10.png", "im2.png"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        std::fs::create_dir(folder.path().join("__MACOSX")).unwrap();
        let names: Vec<_> = list(folder.path())
            .unwrap()
            .into_iter()
            .map(|e| e.0)
            .collect();
        assert_eq!(names, ["im2.png", "im10.png"]);
        let error = read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("not a regular file"), "{error}");
    }
}
