//! Published pair lists, matched with datasets that can be read here.
//!
//! * `forms`: a parser per format.

mod forms;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde::Serialize;
use sharp_datasets::{Scene, View};

use self::forms::Entry;
use super::Pair;
use super::build::scene::row;
use super::dataset::OpenDataset;
use super::error::PairError;
use super::pair_list::PairList;
use crate::io::atomic_files::FileError;

/// Format of a list, named after a project that uses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ListForm {
    /// pixelSplat, MVSplat, DepthSplat, LVSM: JSON that maps each scene to null or to the positions of its context and
    /// target views
    Index,
    /// Flash3D: one line `key source +5 +10 random` of positions per source
    Flash3d,
    /// MINE: one JSON object per line, with frames given by time stamp
    Mine,
    /// UniSHARP: lines `scene|source|target,…`, with one or two more fields in some datasets
    Unisharp,
    /// Stable Virtual Camera: JSON with the positions train_ids and test_ids of one scene
    Seva,
}

/// Which of a scene's context (input) views is the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Context {
    /// The first input view
    #[default]
    #[value(name = "0")]
    First,
    /// The second input view
    #[value(name = "1")]
    Second,
    /// For each target, the input view at the nearest position; of two equally near views, the first
    Nearest,
}

/// Which of a line's three targets is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum TargetSlot {
    /// The target five frames after the source
    #[default]
    #[value(name = "5")]
    Five,
    /// The target ten frames after the source
    #[value(name = "10")]
    Ten,
    /// The line's third target, a random frame
    Random,
}

#[derive(Debug, Clone, PartialEq)]
pub struct ForeignList {
    path: PathBuf,
    form: ListForm,
    entries: Vec<Entry>,
}

/// A view as named in a list.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::pairs) enum FrameName {
    /// Index in the scene's frames, from 0.
    Position(u32),
    /// A file's name with or without extension, a frame's number, or a time stamp.
    Name(String),
}

/// Numbers of entries and targets in a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ForeignCounts {
    /// Number of scenes or, in formats with one entry per line, lines.
    pub entries: usize,
    /// Entries with at least one target.
    pub with_pairs: usize,
    pub targets: usize,
    /// Number of targets that are also inputs.
    pub targets_that_are_inputs: usize,
}

/// A published list converted to pairs.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedPairs {
    pub pairs: Vec<Pair>,
    /// Scenes of the list that are in no dataset, each once.
    pub absent: Vec<String>,
    /// Number of pairs that were dropped because they occur earlier in the list.
    pub repeated: usize,
}

impl ForeignList {
    /// Reads a list.
    ///
    /// # Errors
    /// [`PairError::File`] if the file cannot be read; [`PairError::List`] with the line of the first mistake.
    pub fn read(path: &Path, form: ListForm) -> Result<Self, PairError> {
        let bytes = sharp::files::read(path).map_err(FileError::new(path, "read"))?;
        let entries = forms::parse(form, &bytes).map_err(|(line, reason)| PairError::List {
            path: path.to_owned(),
            line,
            reason,
        })?;
        Ok(Self {
            path: path.to_owned(),
            form,
            entries,
        })
    }

    pub fn counts(&self) -> ForeignCounts {
        forms::counts(&self.entries)
    }

    /// Finds the list's pairs in the scenes of datasets. A scene matches a name in the list if its id is the name, or
    /// ends with `/` and the name. Repeated pairs are added once. All pairs are selected; their overlaps and depths are
    /// not measured.
    ///
    /// # Errors
    /// [`PairError::List`] if a listed view is missing from its scene, a scene of the list matches several scenes, or
    /// no pairs are left.
    pub fn import(
        &self,
        context: Context,
        slot: TargetSlot,
        datasets: &[OpenDataset],
    ) -> Result<ImportedPairs, PairError> {
        let wrong = |line: u64, reason: String| PairError::List {
            path: self.path.clone(),
            line,
            reason,
        };
        let mut by_key: BTreeMap<&str, Vec<(&OpenDataset, &Scene)>> = BTreeMap::new();
        for dataset in datasets {
            for scene in &dataset.scenes {
                let ends = scene
                    .id
                    .match_indices('/')
                    .map(|(at, _)| &scene.id[at + 1..]);
                for key in std::iter::once(scene.id.as_str()).chain(ends) {
                    by_key.entry(key).or_default().push((dataset, scene));
                }
            }
        }
        let only: Vec<(&OpenDataset, &Scene)> = datasets
            .iter()
            .flat_map(|dataset| dataset.scenes.iter().map(move |scene| (dataset, scene)))
            .collect();
        let mut pairs: BTreeMap<String, Pair> = BTreeMap::new();
        let mut absent = BTreeSet::new();
        let mut repeated = 0;
        let mut hashes = BTreeMap::new();
        let mut sha256 = |view: &View, key: (&str, &str)| -> String {
            let key = (key.0.to_owned(), key.1.to_owned(), view.id.clone());
            let hash = hashes.entry(key);
            hash.or_insert_with(|| view.content.image_sha256().unwrap_or_default())
                .clone()
        };
        let named = self.entries.iter();
        let named = named.map(|entry| entry.pairs(self.form, context, slot));
        let named: Vec<_> = named
            .collect::<Result<_, _>>()
            .map_err(|(line, reason)| wrong(line, reason))?;
        for pair in named.into_iter().flatten() {
            let matching = match &pair.scene {
                Some(key) => by_key.get(key.as_str()).map_or(&[][..], Vec::as_slice),
                None => &only,
            };
            let (dataset, scene) = match (matching, &pair.scene) {
                ([one], _) => *one,
                ([], Some(key)) => {
                    absent.insert(key.clone());
                    continue;
                }
                (several, key) => {
                    let reason = format!(
                        "{} matches {} scenes of the datasets; choose one with --scenes",
                        key.as_ref().map_or(
                            "the list, which has no scene names,".to_owned(),
                            |key| format!("'{key}'")
                        ),
                        several.len()
                    );
                    return Err(wrong(pair.line, reason));
                }
            };
            let place = |frame: &FrameName| {
                let found = found(scene, frame);
                found.map_err(|reason| wrong(pair.line, format!("scene '{}': {reason}", scene.id)))
            };
            pair.last.as_ref().map(place).transpose()?;
            let (source, target) = (place(&pair.source)?, place(&pair.target)?);
            let (s, t) = (&scene.views[source], &scene.views[target]);
            let named = (scene.dataset.as_str(), scene.id.as_str());
            let row = Pair {
                source_sha256: sha256(s, named),
                target_sha256: sha256(t, named),
                selected: true,
                ..row(scene, source, target, dataset.root())
            };
            repeated += usize::from(pairs.insert(row.pair_id.clone(), row).is_some());
        }
        if pairs.is_empty() {
            let reason = match self.counts().targets {
                0 => "it has no targets: its scenes are null or their targets are empty",
                _ => "none of its scenes with targets is in the datasets",
            };
            return Err(wrong(1, reason.to_owned()));
        }
        Ok(ImportedPairs {
            pairs: pairs.into_values().collect(),
            absent: absent.into_iter().collect(),
            repeated,
        })
    }
}

impl ImportedPairs {
    /// Converts the pairs to a list to be written to `path`.
    pub fn list(self, path: &Path) -> PairList {
        PairList::new(path, self.pairs)
    }
}

/// Index, within its scene, of the view named `frame`. Errors do not name the list.
fn found(scene: &Scene, frame: &FrameName) -> Result<usize, String> {
    let count = scene.views.len();
    match frame {
        FrameName::Position(at) => {
            if (*at as usize) < count {
                Ok(*at as usize)
            } else {
                Err(format!(
                    "position {at} is beyond the last of {count} views, counted from 0"
                ))
            }
        }
        FrameName::Name(name) => {
            let stem = name
                .rsplit_once('.')
                .map_or(name.as_str(), |(stem, _)| stem);
            let number = |text: &str| -> Option<u64> {
                let digits = text.trim_start_matches(|c: char| !c.is_ascii_digit());
                digits.parse().ok()
            };
            let tests: [&dyn Fn(&View) -> bool; 3] =
                [&|view| view.id == *name, &|view| view.id == stem, &|view| {
                    stem.bytes().all(|b| b.is_ascii_digit()) && number(&view.id) == number(stem)
                }];
            let views = scene.views.iter();
            let mut found = tests.iter().filter_map(|test| views.clone().position(test));
            found.next().ok_or_else(|| format!("no view '{name}'"))
        }
    }
}
