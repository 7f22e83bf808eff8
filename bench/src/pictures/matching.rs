//! Predictions and targets in two folders, matched by name.

use std::collections::BTreeMap;
use std::iter::zip;
use std::path::{Path, PathBuf};

use sharp_datasets::DatasetError;
use sharp_datasets::files::{self, composed, what_lies_in};

use crate::io::pictures;

/// Why two folders cannot be matched.
#[derive(Debug, thiserror::Error)]
pub enum MatchError {
    #[error(transparent)]
    List(#[from] DatasetError),
    #[error("{}: no picture found in it (looked for {}); {inside}", path.display(), pictures::EXTENSIONS.join(", "))]
    Empty { path: PathBuf, inside: String },
    /// A picture without a counterpart.
    #[error("{}: no picture with the same {by} in {}{more}", path.display(), other.display())]
    Unmatched {
        path: PathBuf,
        other: PathBuf,
        by: MatchBy,
        /// How many pictures of either folder have no counterpart, with some of their names, and advice. Empty for a
        /// single picture.
        more: String,
    },
    /// Two pictures that both match the same picture.
    #[error("{} and {} have the same {by}", first.display(), second.display())]
    Ambiguous {
        first: PathBuf,
        second: PathBuf,
        by: MatchBy,
    },
}

/// The part of the file name that two matching pictures share.
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

/// Number of pictures without a counterpart that an error names.
const NAMED: usize = 3;

/// A prediction and its target.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Match {
    /// The shared part of the name, preceded by the subfolders in which the picture was found; unique among the
    /// matches.
    pub key: String,
    pub prediction: PathBuf,
    pub target: PathBuf,
}

/// Pairs the pictures of two folders and their subfolders, sorted by name. Skips hidden files (and the `._` files in
/// some archives).
///
/// # Errors
/// [`MatchError`] if a picture of either folder has no counterpart in the other, or several
/// counterparts.
pub fn match_folders(
    predictions: &Path,
    targets: &Path,
    by: MatchBy,
) -> Result<Vec<Match>, MatchError> {
    let (left, right) = (index(predictions, by)?, index(targets, by)?);
    let without = |own: &BTreeMap<String, PathBuf>, other: &BTreeMap<String, PathBuf>| {
        let lacking = own.iter().filter(|(key, _)| !other.contains_key(*key));
        lacking.map(|(_, path)| path.clone()).collect::<Vec<_>>()
    };
    let [alone, unpredicted] = [without(&left, &right), without(&right, &left)];
    if let Some(path) = alone.first().or(unpredicted.first()) {
        let other = if alone.is_empty() {
            predictions
        } else {
            targets
        };
        let named = |of: &[PathBuf]| {
            let names = of.iter().take(NAMED).filter_map(|path| path.file_name());
            let names: Vec<_> = names.map(|name| name.to_string_lossy()).collect();
            match names[..] {
                [] => "none".to_owned(),
                _ => format!("{} ({})", of.len(), names.join(", ")),
            }
        };
        let more = format!(
            "; predictions without a target: {}; targets without a prediction: {}; rename the files so that the names of \
             each picture and its target match",
            named(&alone),
            named(&unpredicted)
        );
        return Err(unmatched(path.clone(), other, by, more));
    }
    let pairs = zip(left, right.into_values());
    let pairs = pairs.map(|((key, prediction), target)| Match {
        key,
        prediction,
        target,
    });
    Ok(pairs.collect())
}

/// The picture in `folder` that matches `picture`, whose [`Match::key`] is `key`.
///
/// # Errors
/// If no picture or more than one picture matches.
pub fn partner(
    key: &str,
    picture: &Path,
    folder: &Path,
    by: MatchBy,
) -> Result<PathBuf, MatchError> {
    let found = index(folder, by)?.remove(key);
    found.ok_or_else(|| unmatched(picture.to_owned(), folder, by, String::new()))
}

/// The part of a picture's name used for matching, with composed accents.
pub fn shared_part(path: &Path, by: MatchBy) -> String {
    let part = match by {
        MatchBy::Stem => path.file_stem(),
        MatchBy::Name => path.file_name(),
    };
    composed(&part.unwrap_or_default().to_string_lossy())
}

fn unmatched(path: PathBuf, other: &Path, by: MatchBy, more: String) -> MatchError {
    MatchError::Unmatched {
        path,
        other: other.to_owned(),
        by,
        more,
    }
}

fn index(folder: &Path, by: MatchBy) -> Result<BTreeMap<String, PathBuf>, MatchError> {
    let mut found = BTreeMap::new();
    add_to_index(folder, "", by, &mut found)?;
    if found.is_empty() {
        return Err(MatchError::Empty {
            path: folder.to_owned(),
            inside: what_lies_in(folder),
        });
    }
    Ok(found)
}

/// Adds the pictures of a folder and its subfolders to `found`.
fn add_to_index(
    folder: &Path,
    prefix: &str,
    by: MatchBy,
    found: &mut BTreeMap<String, PathBuf>,
) -> Result<(), MatchError> {
    for (name, path) in files::list(folder)? {
        // Skip links, which could form a cycle.
        if path.is_dir() && !path.is_symlink() {
            let prefix = format!("{prefix}{}/", composed(&name));
            add_to_index(&path, &prefix, by, found)?;
        }
        if !(path.is_file() && pictures::is_picture(&path)) {
            continue;
        }
        let name = prefix.to_owned() + &shared_part(&path, by);
        if let Some(first) = found.insert(name, path.clone()) {
            let (first, second) = if first < path {
                (first, path)
            } else {
                (path, first)
            };
            return Err(MatchError::Ambiguous { first, second, by });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use sharp_tests::holds;

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
        assert!(pairs[0].prediction.ends_with("x.png") && pairs[0].target.ends_with("x.exr"));
        assert!(match_folders(a.path(), b.path(), MatchBy::Name).is_err());
    }

    #[test]
    fn pictures_without_partner_are_errors_on_both_sides() {
        let (one, two) = (folder(&["x.png"]), folder(&["x.png", "y.png"]));
        for (a, b) in [(&one, &two), (&two, &one)] {
            let error = match_folders(a.path(), b.path(), MatchBy::Stem).unwrap_err();
            let told = error.to_string();
            holds(&told, &["y.png: no picture", ": 1 (y.png)", ": none"]);
        }
        let two_found = partner("y", &one.path().join("y.jpg"), two.path(), MatchBy::Stem).unwrap();
        assert!(two_found.ends_with("y.png"));
        assert!(partner("y", &two_found, one.path(), MatchBy::Stem).is_err());
        let twice = folder(&["x.png", "x.jpg"]);
        let error = match_folders(twice.path(), one.path(), MatchBy::Stem).unwrap_err();
        assert!(matches!(error, MatchError::Ambiguous { .. }));
        let empty = folder(&[]);
        assert!(match_folders(empty.path(), one.path(), MatchBy::Stem).is_err());
    }
}
