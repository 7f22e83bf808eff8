//! Quick check of scenes for contradictions at the start of a run. Scenes without contradictions are remembered by the
//! content of the checked views.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rayon::prelude::*;
use sharp_datasets::Scene;
use sharp_datasets::check::{self, advice::Units};

use super::dataset::OpenDataset;
use crate::io::atomic_files::write_atomic;
use crate::io::counts::counted;
use crate::io::fingerprints;
use crate::io::hash::sha256_hex;
use crate::io::observer::Observer;
use crate::io::view_hashes::ViewHashes;

/// Maximum number of scenes checked per dataset; they are evenly spaced.
const SCENES: usize = 64;
/// Maximum number of scenes that a warning names.
const NAMED: usize = 3;

/// Checks scenes for contradictions, except those that are known to have none. Cache files that cannot be read or written
/// are ignored.
#[derive(Debug, Default)]
pub struct SceneChecks {
    folder: Option<PathBuf>,
    hashes: ViewHashes,
}

impl SceneChecks {
    /// Results are cached next to measured overlaps, whose folder `overlaps` need not exist; `None` disables caching.
    pub fn new(overlaps: Option<PathBuf>) -> Self {
        Self {
            folder: overlaps.map(|folder| folder.join("checks")),
            ..Self::default()
        }
    }

    /// Warns about contradictions in scenes of a dataset, and adds the warnings to the scenes' notes.
    pub fn look_at(&self, dataset: &mut OpenDataset, observer: &dyn Observer) {
        let OpenDataset {
            scenes, settings, ..
        } = &*dataset;
        let stride = scenes.len().div_ceil(SCENES).max(1);
        let chosen: Vec<usize> = (0..scenes.len()).step_by(stride).collect();
        let copied: BTreeMap<usize, String> =
            check::copied_calibrations(scenes).into_iter().collect();
        let found: Vec<(usize, Vec<String>)> = chosen
            .par_iter()
            .map(|&i| {
                let mut found = self.contradictions(&scenes[i], settings, dataset.units);
                found.extend(copied.get(&i).cloned());
                (i, found)
            })
            .filter(|(_, found)| !found.is_empty())
            .collect();
        for (i, contradictions) in found.iter().take(NAMED) {
            for text in contradictions {
                observer.warn(&format!("{}/{}: {text}", dataset.name, scenes[*i].id));
            }
        }
        if found.len() > NAMED {
            observer.warn(&format!(
                "{}: {} more with contradictions (`datasets check` lists them)",
                dataset.name,
                counted(found.len() - NAMED, "scene")
            ));
        }
        for (i, contradictions) in found {
            let texts = contradictions.into_iter();
            let texts = texts.map(|text| format!("warning: {text}"));
            dataset.scenes[i].notes.extend(texts);
        }
    }

    fn contradictions(&self, scene: &Scene, settings: &str, units: Units) -> Vec<String> {
        let views: Vec<_> = check::looked_at(scene)
            .into_iter()
            .map(|i| &scene.views[i])
            .collect();
        // Skip procedural scenes, which have no files that could contradict each other.
        if views.iter().all(|view| view.content.files().is_empty()) {
            return Vec::new();
        }
        let path = self.key(scene, settings, &views).and_then(|key| {
            let folder = self.folder.as_ref()?.join(&key[..2]);
            Some((folder.join(&key), key))
        });
        if let Some((path, key)) = &path {
            let bytes = sharp::files::read(path).ok();
            if bytes.is_some_and(|bytes| bytes == key.as_bytes()) {
                return Vec::new();
            }
        }
        let contradictions = check::contradictions(scene, units);
        // The cause of a contradiction may have been found in views that the key does not contain.
        if let Some((path, key)) = path.filter(|_| contradictions.is_empty()) {
            // If this fails, the scene is merely checked again next time.
            let _ = write_atomic(&path, key.as_bytes());
        }
        contradictions
    }

    /// Cache key of a scene; `None` if a file cannot be hashed.
    fn key(
        &self,
        scene: &Scene,
        settings: &str,
        views: &[&sharp_datasets::View],
    ) -> Option<String> {
        let mut text = format!(
            "{}\n{settings}\n{:?}\n",
            fingerprints::OVERLAP,
            scene.pairing
        );
        for view in &scene.views {
            text += &format!(
                "{} {:?} {:?}\n",
                view.id, view.intrinsics, view.camera_from_world
            );
        }
        for view in views {
            text += &format!("{}\n", self.hashes.view(view).ok()?);
        }
        Some(sha256_hex(text.as_bytes()))
    }
}
