//! Predictions and targets in two folders, matched by name.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::io::pictures;

/// Two folders that do not match up.
#[derive(Debug, thiserror::Error)]
pub enum MatchError {
    #[error("{}: {source}", path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{}: no picture in it (looked for {})", path.display(), pictures::EXTENSIONS.join(", "))]
    Empty { path: PathBuf },
    /// A picture without a partner.
    #[error("{}: no picture of the same {by} in {}", path.display(), other.display())]
    Unmatched {
        path: PathBuf,
        /// Where a partner was sought.
        other: PathBuf,
        by: MatchBy,
    },
    /// Two pictures that match the same one.
    #[error("{} and {} have the same {by}", first.display(), second.display())]
    Ambiguous {
        first: PathBuf,
        second: PathBuf,
        by: MatchBy,
    },
}

/// What two pictures must share to be a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum MatchBy {
    /// The file name without its extension: `a.png` and `a.jpg` match
    #[default]
    Stem,
    /// The whole file name
    Name,
}

impl std::fmt::Display for MatchBy {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Self::Stem => "stem",
            Self::Name => "name",
        })
    }
}

/// Pairs the pictures of two folders, sorted by name. Hidden files (and the `._` files that some archives carry) are
/// skipped.
///
/// # Errors
/// [`MatchError`]: every picture of either folder needs exactly one partner.
pub fn match_folders(
    predictions: &Path,
    targets: &Path,
    by: MatchBy,
) -> Result<Vec<(PathBuf, PathBuf)>, MatchError> {
    let left = index(predictions, by)?;
    let mut right = index(targets, by)?;
    let mut pairs = Vec::with_capacity(left.len());
    for (name, path) in left {
        match right.remove(&name) {
            Some(partner) => pairs.push((path, partner)),
            None => return Err(unmatched(path, targets, by)),
        }
    }
    match right.into_values().next() {
        Some(path) => Err(unmatched(path, predictions, by)),
        None => Ok(pairs),
    }
}

/// The picture in a folder that matches a picture elsewhere.
///
/// # Errors
/// When there is none, or more than one.
pub fn partner(picture: &Path, folder: &Path, by: MatchBy) -> Result<PathBuf, MatchError> {
    let found = index(folder, by)?.remove(&shared_part(picture, by));
    found.ok_or_else(|| unmatched(picture.to_owned(), folder, by))
}

/// What a picture shares with its partner.
fn shared_part(path: &Path, by: MatchBy) -> String {
    let part = match by {
        MatchBy::Stem => path.file_stem(),
        MatchBy::Name => path.file_name(),
    };
    part.map(|part| part.to_string_lossy().into_owned())
        .unwrap_or_default()
}

fn unmatched(path: PathBuf, other: &Path, by: MatchBy) -> MatchError {
    MatchError::Unmatched {
        path,
        other: other.to_owned(),
        by,
    }
}

fn index(folder: &Path, by: MatchBy) -> Result<BTreeMap<String, PathBuf>, MatchError> {
    let io = |source| MatchError::Io {
        path: folder.to_owned(),
        source,
    };
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = shared_part(&path, by);
        if name.starts_with('.') || !path.is_file() || !pictures::is_picture(&path) {
            continue;
        }
        if let Some(first) = found.insert(name, path.clone()) {
            let (first, second) = if first < path {
                (first, path)
            } else {
                (path, first)
            };
            return Err(MatchError::Ambiguous { first, second, by });
        }
    }
    if found.is_empty() {
        return Err(MatchError::Empty {
            path: folder.to_owned(),
        });
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for name in names {
            std::fs::write(dir.path().join(name), b"").unwrap();
        }
        dir
    }

    #[test]
    fn stems_match_across_extensions_and_hidden_files_do_not_count() {
        let a = folder(&["x.png", "y.JPG", "._x.png", "notes.txt"]);
        let b = folder(&["y.png", "x.exr"]);
        let pairs = match_folders(a.path(), b.path(), MatchBy::Stem).unwrap();
        assert_eq!(pairs.len(), 2);
        assert!(pairs[0].0.ends_with("x.png") && pairs[0].1.ends_with("x.exr"));
        assert!(match_folders(a.path(), b.path(), MatchBy::Name).is_err());
    }

    #[test]
    fn pictures_without_partner_are_errors_on_both_sides() {
        let (one, two) = (folder(&["x.png"]), folder(&["x.png", "y.png"]));
        for (a, b) in [(&one, &two), (&two, &one)] {
            let error = match_folders(a.path(), b.path(), MatchBy::Stem).unwrap_err();
            assert!(error.to_string().contains("y.png: no picture"), "{error}");
        }
        let two_found = partner(&one.path().join("y.jpg"), two.path(), MatchBy::Stem).unwrap();
        assert!(two_found.ends_with("y.png"));
        assert!(partner(&two_found, one.path(), MatchBy::Stem).is_err());
        let twice = folder(&["x.png", "x.jpg"]);
        let error = match_folders(twice.path(), one.path(), MatchBy::Stem).unwrap_err();
        assert!(matches!(error, MatchError::Ambiguous { .. }));
        let empty = folder(&[]);
        assert!(match_folders(empty.path(), one.path(), MatchBy::Stem).is_err());
    }
}
