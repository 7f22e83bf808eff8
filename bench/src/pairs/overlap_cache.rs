//! Content-addressed cache of measured overlaps.
//!
//! A scene's table is keyed by a hash of everything that its numbers depend on: this program's sources, the reader's
//! settings, every view's camera and files, the source of depth, and the measuring options. All sets, thresholds and
//! samplings share one table, which grows as more views are requested.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sharp_datasets::Scene;

use super::depth::DepthSource;
use super::overlap::OverlapOptions;
use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::fingerprints;
use crate::io::hash::sha256_hex;
use crate::io::view_hashes::{ViewHashes, lock};

const FORMAT: u32 = 3;

/// The two overlaps of views a and b, where a < b are their indices in the scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Overlaps {
    /// Share of a's pixels visible in b.
    pub(super) a_in_b: f64,
    /// Share of b's pixels visible in a.
    pub(super) b_in_a: f64,
}

/// Facts about a view's depth at its full size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct DepthFacts {
    /// Median of the valid depths, in metres.
    pub(super) median_m: f64,
    /// The map's [density](crate::pairs::valid_depth::density).
    pub(super) density: f64,
}

/// Measurements of a scene under one set of measuring options.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct SceneOverlaps {
    /// Facts about depth, keyed by view; `None` for a view without valid depth.
    pub(super) depths: BTreeMap<usize, Option<DepthFacts>>,
    /// Overlaps of views a < b with valid depth, keyed by a, then by b.
    couples: BTreeMap<usize, BTreeMap<usize, Option<Overlaps>>>,
    /// Views whose depth could not be read. Not stored, because the file may be fixed later.
    #[serde(skip)]
    pub(super) failed: BTreeSet<usize>,
}

impl SceneOverlaps {
    pub(super) fn insert(&mut self, (a, b): (usize, usize), overlaps: Option<Overlaps>) {
        self.couples.entry(a).or_default().insert(b, overlaps);
    }

    fn couple(&self, a: usize, b: usize) -> Option<&Option<Overlaps>> {
        self.couples.get(&a.min(b))?.get(&a.max(b))
    }

    /// Whether measuring views `a` and `b` would add nothing: their overlaps are known, or a view is known to have no
    /// depth.
    pub(super) fn knows(&self, a: usize, b: usize) -> bool {
        self.couple(a, b).is_some() || self.has_none(a) || self.has_none(b)
    }

    /// The share of the target that is visible in the source, and the share of the source that is visible in the
    /// target; `None` if either is unknown.
    pub(super) fn overlaps(&self, source: usize, target: usize) -> Option<(f64, f64)> {
        let found = (*self.couple(source, target)?)?;
        Some(if target < source {
            (found.a_in_b, found.b_in_a)
        } else {
            (found.b_in_a, found.a_in_b)
        })
    }

    /// Whether it is known that the view's depth is missing or cannot be read.
    pub(super) fn has_none(&self, view: usize) -> bool {
        self.failed.contains(&view) || self.depths.get(&view) == Some(&None)
    }

    fn sha256(&self) -> Option<String> {
        Some(sha256_hex(&serde_json::to_vec(self).ok()?))
    }

    /// Whether all indices are valid in a scene with this number of views.
    fn fits(&self, views: usize) -> bool {
        let couples = self.couples.iter();
        let mut couples = couples.flat_map(|(a, of_a)| of_a.keys().map(move |b| (*a, *b)));
        self.depths.keys().all(|view| *view < views) && couples.all(|(a, b)| a < b && b < views)
    }
}

#[derive(Serialize, Deserialize)]
struct TableFile {
    format: u32,
    key: String,
    /// SHA-256 of the content's JSON, to detect damaged files.
    sha256: String,
    content: SceneOverlaps,
}

/// Measured overlaps of scenes, in memory and optionally in files. Files that cannot be read or written are skipped
/// with a warning.
#[derive(Debug, Default)]
pub struct OverlapCache {
    folder: Option<PathBuf>,
    tables: Mutex<BTreeMap<String, SceneOverlaps>>,
    hashes: ViewHashes,
    warnings: Mutex<Vec<String>>,
}

impl OverlapCache {
    /// A cache without files.
    pub fn in_memory() -> Self {
        Self::default()
    }

    /// A cache with files in a folder, which need not exist.
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: Some(folder.into()),
            ..Self::default()
        }
    }

    /// The folder of measured overlaps in the user's cache; see [`sharp_metrics::weights::user_cache`].
    pub fn users_folder() -> Option<PathBuf> {
        Some(sharp_metrics::weights::user_cache()?.join("overlap"))
    }

    /// Returns and clears the warnings about files that could not be read or written.
    pub fn take_warnings(&self) -> Vec<String> {
        std::mem::take(&mut *lock(&self.warnings))
    }

    /// Key of a scene's table; `None` if a file cannot be hashed, so that nothing can be stored.
    pub(super) fn key(
        &self,
        scene: &Scene,
        settings: &str,
        depth: &dyn DepthSource,
        options: &OverlapOptions,
    ) -> Option<String> {
        let views: Option<Vec<String>> = scene
            .views
            .par_iter()
            .map(|view| {
                let mut text = format!("{} {}", view.id, self.hashes.view(view).ok()?);
                for file in depth.files(scene, view) {
                    text += &format!(" {}", self.hashes.file(&file).ok()?);
                }
                Some(text)
            })
            .collect();
        let text = format!(
            "{FORMAT} {}\n{settings}\n{}\n{options:?}\n{}",
            fingerprints::OVERLAP,
            depth.name(),
            views?.join("\n")
        );
        Some(sha256_hex(text.as_bytes()))
    }

    /// The table stored under a key; empty if there is none, or its file is unusable.
    pub(super) fn load(&self, key: &str, views: usize) -> SceneOverlaps {
        if let Some(table) = lock(&self.tables).get(key) {
            return table.clone();
        }
        let Some(path) = self.path(key) else {
            return SceneOverlaps::default();
        };
        match read(&path, key, views) {
            Ok(table) => table.unwrap_or_default(),
            Err(reason) => {
                self.warn(format!(
                    "{}: {reason}; overlaps are measured again",
                    path.display()
                ));
                SceneOverlaps::default()
            }
        }
    }

    pub(super) fn store(&self, key: &str, table: &SceneOverlaps) {
        let table = SceneOverlaps {
            failed: BTreeSet::new(),
            ..table.clone()
        };
        if let Some(path) = self.path(key)
            && let Err(reason) = write(&path, key, table.clone())
        {
            self.warn(format!("{reason}; measured overlaps are not cached"));
        }
        lock(&self.tables).insert(key.to_owned(), table);
    }

    fn path(&self, key: &str) -> Option<PathBuf> {
        let (folder, _) = key.split_at_checked(2)?;
        Some(
            self.folder
                .as_ref()?
                .join(folder)
                .join(format!("{key}.json")),
        )
    }

    fn warn(&self, warning: String) {
        let mut warnings = lock(&self.warnings);
        if !warnings.contains(&warning) {
            warnings.push(warning);
        }
    }
}

fn read(path: &Path, key: &str, views: usize) -> Result<Option<SceneOverlaps>, String> {
    let bytes = match sharp::files::read(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error.to_string()),
    };
    let file: TableFile =
        serde_json::from_slice(&bytes).map_err(|error| format!("damaged ({error})"))?;
    if file.format != FORMAT || file.key != key {
        return Err("it is the table of a different scene".to_owned());
    }
    if file.content.sha256().as_ref() != Some(&file.sha256) {
        return Err("damaged (its checksum differs)".to_owned());
    }
    if !file.content.fits(views) {
        return Err("it lists views that the scene does not have".to_owned());
    }
    Ok(Some(file.content))
}

fn write(path: &Path, key: &str, table: SceneOverlaps) -> Result<(), FileError> {
    let file = TableFile {
        format: FORMAT,
        key: key.to_owned(),
        sha256: table.sha256().unwrap_or_default(),
        content: table,
    };
    let encode = |error: serde_json::Error| FileError::new(path, "encode")(error.into());
    write_atomic(path, &serde_json::to_vec(&file).map_err(encode)?)
}
