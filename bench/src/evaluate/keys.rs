//! Keys of a unit's stages: each is a hash of exactly those inputs that can change the stage's result.
//!
//! * *predict*: the method's identity and code, the source's photograph and camera, and the files that the method
//!   reads. Also the source's depth if the method may see it, and the target's camera if the method makes pictures.
//! * *picture*: the prediction. For Gaussians, also the target's camera, the renderer with its code, and the true depth
//!   if the Gaussians are scaled to it.
//! * *score*, one per metric: the picture's pixels and region, the ground truth with its mask, and the metric with its
//!   code.
//!
//! If a file cannot be read, its error is hashed instead; the unit will fail with this error anyway.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sharp_datasets::{Scene, View};

use super::error::EvaluateError;
use super::folder::RunFolder;
use super::manifest::{MethodRecord, RendererRecord};
use super::record::{GaussiansRead, PairFiles, Record, Status};
use super::unit::{Slot, Unit};
use crate::io::fingerprints;
use crate::io::hash::StableHasher;
use crate::io::view_hashes::ViewHashes;
use crate::methods::{Approach, Method, MethodSpec, TrueDepth};
use crate::pairs::OpenDataset;
use crate::pairs::pair_list::ResolvedPair;
use crate::scoring::Region;
use crate::scoring::metrics::ScoredMetric;

/// Computes keys; hashes each file once.
pub(super) struct Keys {
    hashes: ViewHashes,
    /// [`dataset_identity`] of each dataset, keyed by its name.
    datasets: BTreeMap<String, String>,
    renderer: RendererRecord,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PictureKeys {
    pub(super) predict: String,
    pub(super) picture: String,
}

/// Hash of a dataset's reader and settings, without the path.
pub(super) fn dataset_identity(dataset: &OpenDataset) -> String {
    StableHasher::default()
        .add("settings", &dataset.settings)
        .finish()
}

impl Keys {
    pub(super) fn new(datasets: &[OpenDataset], renderer: &RendererRecord) -> Self {
        let identities = datasets
            .iter()
            .map(|d| (d.name.clone(), dataset_identity(d)));
        Self {
            hashes: ViewHashes::default(),
            datasets: identities.collect(),
            renderer: renderer.clone(),
        }
    }

    pub(super) fn slot(&self, method: &dyn Method, planned: &ResolvedPair) -> Slot {
        Slot {
            pair_id: planned.pair.pair_id.clone(),
            method: method.label().to_owned(),
            method_identity: self.method_record(method, None).hash(),
            dataset_identity: self.dataset(planned).to_owned(),
        }
    }

    pub(super) fn method_record(
        &self,
        method: &dyn Method,
        spec: Option<&MethodSpec>,
    ) -> MethodRecord {
        let mut sources = StableHasher::default();
        sources
            .add("method", method.sources())
            .add("reading", fingerprints::READING);
        if let Approach::Gaussians(_) = method.approach() {
            sources.add(
                "renderer",
                fingerprints::of_renderer(&self.renderer.backend),
            );
        }
        MethodRecord {
            label: method.label().to_owned(),
            spec: spec.cloned(),
            identity: method.identity(),
            privilege: method.privilege(),
            sources: sources.finish(),
            notes: method.notes(),
            drawn: Vec::new(),
            warnings: Vec::new(),
        }
    }

    fn dataset(&self, planned: &ResolvedPair) -> &str {
        let identity = self.datasets.get(&planned.scene.dataset);
        identity.map_or("", String::as_str)
    }

    pub(super) fn picture(&self, method: &dyn Method, planned: &ResolvedPair) -> PictureKeys {
        let pair_id = &planned.pair.pair_id;
        let approach = method.approach();
        let mut predict = StableHasher::default();
        predict
            .add("method", &method.identity().to_string())
            .add("method sources", method.sources())
            .add("reading sources", fingerprints::READING)
            .add("dataset", self.dataset(planned))
            .add("source", &self.photograph(planned.source));
        if method.privilege().depth == TrueDepth::SourceDepth {
            predict.add("source depth", &self.view(planned.source));
        }
        match method.input_files(pair_id) {
            Ok(files) => {
                for file in files {
                    let hash = self.hashes.file(&file).unwrap_or_else(|e| e.to_string());
                    predict.add("file", &hash);
                }
            }
            Err(error) => {
                predict.add("no file", &error.to_string());
            }
        }
        match &approach {
            Approach::Gaussians(gaussians) if !gaussians.needs_target() => {}
            Approach::Gaussians(_) | Approach::Pictures(_) => {
                predict.add("target camera", &camera(planned.target));
            }
            // These methods read the target's photograph, so its hash is part of the key.
            Approach::Scales(_) | Approach::Target => {
                predict.add("target", &self.view(planned.target));
            }
        }
        let predict = predict.finish();
        let mut picture = StableHasher::default();
        picture.add("prediction", &predict);
        if let Approach::Gaussians(_) = approach {
            picture
                .add("target camera", &camera(planned.target))
                .add("renderer", &self.renderer.to_string())
                .add(
                    "renderer sources",
                    fingerprints::of_renderer(&self.renderer.backend),
                );
            if method.privilege().depth == TrueDepth::DepthScale {
                picture.add("source depth", &self.view(planned.source));
            }
            if method.privilege().target_pose {
                picture.add("target", &self.view(planned.target));
            }
        }
        PictureKeys {
            predict,
            picture: picture.finish(),
        }
    }

    /// Hashes of the files that a prediction was made from; `None` if one cannot be read.
    pub(super) fn pair_files(
        &self,
        method: &dyn Method,
        planned: &ResolvedPair,
    ) -> Option<PairFiles> {
        let pair_id = &planned.pair.pair_id;
        let hash = self.method_files(method, pair_id);
        let (gaussians, pictures) = match method.approach() {
            Approach::Gaussians(_) => {
                let files = method.input_files(pair_id).unwrap_or_default();
                let read = |(hash, path): (String, &PathBuf)| GaussiansRead {
                    file: last_parts(path),
                    hash,
                };
                (hash.zip(files.first()).map(read), None)
            }
            _ => (None, hash),
        };
        Some(PairFiles {
            source: self.hashes.short(planned.source).ok()?,
            target: self.hashes.short(planned.target).ok()?,
            pictures,
            gaussians,
        })
    }

    /// Hash of the files that a method reads for a pair; `None` if the method reads no file, or a file cannot be read.
    fn method_files(&self, method: &dyn Method, pair_id: &str) -> Option<String> {
        let files = method.input_files(pair_id).ok()?;
        let mut hash = StableHasher::default();
        for file in &files {
            hash.add("file", &self.hashes.file(file).ok()?);
        }
        let mut hash = hash.finish();
        hash.truncate(16);
        (!files.is_empty()).then_some(hash)
    }

    /// Compares the input files of stored units, by hash, with those on disk. Skips failed units, and units of datasets
    /// or methods that are not given.
    ///
    /// # Errors
    /// [`EvaluateError::NotKept`] for the first unit made from other files; `fix` is the advice at the end of its
    /// message.
    pub(super) fn check_files<'u>(
        &self,
        folder: &RunFolder,
        units: impl IntoIterator<Item = &'u Unit>,
        scenes: &[Scene],
        methods: &[Box<dyn Method>],
        fix: &str,
    ) -> Result<(), EvaluateError> {
        let refused = |record: &Record, what: &str| EvaluateError::NotKept {
            folder: folder.root().to_owned(),
            reason: format!(
                "{what} has changed since method '{}' was evaluated on {}; {fix}",
                record.method, record.pair_id
            ),
        };
        let scenes: BTreeMap<(&str, &str), &Scene> = scenes
            .iter()
            .map(|s| ((s.dataset.as_str(), s.id.as_str()), s))
            .collect();
        let mut now: BTreeMap<(&str, &str, &str), Option<String>> = BTreeMap::new();
        for Unit { record, .. } in units {
            let (Status::Ok, Some(files)) = (&record.status, &record.files) else {
                continue;
            };
            for (view, before) in [
                (&record.source, &files.source),
                (&record.target, &files.target),
            ] {
                let (dataset, scene) = (record.dataset.as_str(), record.scene.as_str());
                let hash = now.entry((dataset, scene, view)).or_insert_with(|| {
                    let view = scenes
                        .get(&(dataset, scene))?
                        .views
                        .iter()
                        .find(|v| v.id == *view)?;
                    self.hashes.short(view).ok()
                });
                if hash.as_ref().is_some_and(|hash| hash != before) {
                    let what = format!("the photograph, mask, depth or camera of view '{view}'");
                    return Err(refused(record, &what));
                }
            }
            let method = methods.iter().find(|m| m.label() == record.method);
            let gaussians = files.gaussians.as_ref().map(|read| &read.hash);
            let before = gaussians.or(files.pictures.as_ref());
            if let (Some(method), Some(before)) = (method, before)
                && let Some(now) = self.method_files(method.as_ref(), &record.pair_id)
                && now != *before
            {
                return Err(refused(record, "an input file of the method"));
            }
        }
        Ok(())
    }

    /// Why a pair's keys are out of date: a file of the pair or of `method` changed after it was hashed. `None` if no
    /// file changed.
    pub(super) fn changed(
        &self,
        method: Option<&dyn Method>,
        planned: &ResolvedPair,
    ) -> Option<String> {
        let views = [planned.source, planned.target];
        let of_views = views.iter().flat_map(|view| view.content.files_by_role());
        let own = method.and_then(|method| method.input_files(&planned.pair.pair_id).ok());
        let files = of_views.map(|(_, path)| path);
        let changed = self.hashes.changed(files.chain(own.unwrap_or_default()));
        changed.map(|path| format!("{} changed during the run", path.display()))
    }

    pub(super) fn score(
        &self,
        metric: &ScoredMetric,
        picture_sha256: &str,
        region: Option<Region>,
        planned: &ResolvedPair,
    ) -> String {
        let mut key = StableHasher::default();
        key.add("metric", &metric.identity)
            .add("picture", picture_sha256)
            .add("reading sources", fingerprints::READING)
            .add("dataset", self.dataset(planned))
            .add("truth", &self.photograph(planned.target));
        if let Some(region) = region {
            key.add("region", &region.to_string());
        }
        if metric.key.is_masked() {
            key.add("mask depth", &self.view(planned.target))
                .add("mask source", &camera(planned.source));
        }
        key.finish()
    }

    fn photograph(&self, view: &View) -> String {
        let hash = self.hashes.photograph(view);
        hash.unwrap_or_else(|error| error.to_string())
    }

    fn view(&self, view: &View) -> String {
        let hash = self.hashes.view(view);
        hash.unwrap_or_else(|error| error.to_string())
    }
}

/// The file's name and its two parent folders.
fn last_parts(path: &Path) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    parts[parts.len().saturating_sub(3)..].join("/")
}

fn camera(view: &View) -> String {
    format!("{:?} {:?}", view.intrinsics, view.camera_from_world)
}
