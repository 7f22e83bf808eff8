//! Stores predicted Gaussians, so that all pairs of a source, and methods that share a network, use one prediction.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::TempDir;

use super::prediction_file::{read_prediction, write_prediction};
use crate::io::atomic_files::{FileError, scratch_folder};
use crate::methods::{GaussianPrediction, MethodError};

/// Predictions by key. Those that do not fit into the memory limit are on disk until the run ends.
pub(in crate::evaluate) struct GaussianStore {
    /// Folder for predictions that are kept after the run, if any.
    kept: Option<PathBuf>,
    limit_bytes: u64,
    memory: BTreeMap<String, Timed>,
    /// Keys of the predictions in memory, from oldest to newest.
    order: Vec<String>,
    spill: Option<(TempDir, BTreeSet<String>)>,
    spill_in: PathBuf,
    /// Name of the source of all predictions in memory. Pairs are sorted, so that all pairs of a source are
    /// consecutive.
    source: String,
}

/// A prediction and its wall time, in seconds.
pub(in crate::evaluate) type Timed = (Arc<GaussianPrediction>, f64);

#[derive(Debug)]
pub(in crate::evaluate) enum StoreError {
    Method(MethodError),
    File(FileError),
}

impl GaussianStore {
    /// Holds up to `limit_bytes` in memory and moves the rest into a temporary folder in
    /// `spill_in`.
    pub(in crate::evaluate) fn new(
        kept: Option<PathBuf>,
        spill_in: &Path,
        limit_bytes: u64,
    ) -> Self {
        Self {
            kept,
            limit_bytes,
            memory: BTreeMap::new(),
            order: Vec::new(),
            spill: None,
            spill_in: spill_in.to_owned(),
            source: String::new(),
        }
    }

    /// The prediction of a key, with the wall time of the original prediction. If it is neither in memory nor on disk,
    /// calls `predict`, or returns `None` without `predict`.
    pub(in crate::evaluate) fn get(
        &mut self,
        key: &str,
        source: &str,
        predict: Option<&dyn Fn() -> Result<(GaussianPrediction, f64), MethodError>>,
    ) -> Result<Option<Timed>, StoreError> {
        if self.source != source {
            source.clone_into(&mut self.source);
            self.memory.clear();
            self.order.clear();
            self.spill = None;
        }
        if let Some(known) = self.memory.get(key) {
            return Ok(Some(known.clone()));
        }
        let kept = self.kept.as_ref().map(|folder| file(folder, key));
        let spilled = self.spill.as_ref().filter(|(_, keys)| keys.contains(key));
        let spilled = spilled.map(|(folder, _)| file(folder.path(), key));
        // If a file is damaged, the prediction is made again and replaces it.
        let read = [&kept, &spilled].into_iter().flatten();
        let found = read.filter_map(|path| read_prediction(path).ok()).next();
        let (prediction, secs) = match (found, predict) {
            (Some(found), _) => found,
            (None, None) => return Ok(None),
            (None, Some(predict)) => {
                let (prediction, secs) = predict().map_err(StoreError::Method)?;
                if let Some(path) = &kept {
                    write_prediction(path, &prediction, secs).map_err(StoreError::File)?;
                }
                (prediction, secs)
            }
        };
        let timed = (Arc::new(prediction), secs);
        self.memory.insert(key.to_owned(), timed.clone());
        self.order.push(key.to_owned());
        self.shrink().map_err(StoreError::File)?;
        Ok(Some(timed))
    }

    /// Moves the oldest predictions to disk until the rest fits the limit. The newest prediction always stays in
    /// memory.
    fn shrink(&mut self) -> Result<(), FileError> {
        while self.order.len() > 1 && self.bytes() > self.limit_bytes {
            let key = self.order.remove(0);
            let Some((prediction, secs)) = self.memory.remove(&key) else {
                continue;
            };
            if self.kept.is_some() {
                continue;
            }
            if self.spill.is_none() {
                self.spill = Some((scratch_folder(&self.spill_in)?, BTreeSet::new()));
            }
            if let Some((folder, keys)) = &mut self.spill {
                write_prediction(&file(folder.path(), &key), &prediction, secs)?;
                keys.insert(key);
            }
        }
        Ok(())
    }

    fn bytes(&self) -> u64 {
        let sizes = self.memory.values().map(|(prediction, _)| {
            let gaussians = prediction.gaussians.len() * 14 * size_of::<f32>();
            let layer = prediction.first_layer.as_ref();
            gaussians + layer.map_or(0, |layer| layer.as_raw().len() * size_of::<f32>())
        });
        sizes.sum::<usize>() as u64
    }
}

fn file(folder: &Path, key: &str) -> PathBuf {
    folder.join(format!("{key}.safetensors"))
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use sharp::gaussians::Gaussians;
    use sharp_datasets::DepthMap;

    use super::*;
    use crate::methods::GaussianSpace;

    fn prediction(z: f32) -> GaussianPrediction {
        let gaussians = Gaussians::new(
            vec![[0.5, -0.25, z]],
            vec![[1.0, 0.0, 0.0, 0.0]],
            vec![[0.1; 3]],
            vec![0.5],
            vec![[0.2; 3]],
        );
        GaussianPrediction {
            rule: None,
            rule_note: None,
            gaussians: gaussians.unwrap(),
            space: GaussianSpace::Normalized,
            first_layer: DepthMap::from_vec(2, 1, vec![z, 2.0 * z]),
            extras: BTreeMap::from([("dropped_blocks".to_owned(), 3.0)]),
            reading: None,
            warnings: BTreeMap::from([("opacity".to_owned(), "odd".to_owned())]),
        }
    }

    #[test]
    fn each_key_is_predicted_once_a_source_whatever_the_limit() {
        let dir = tempfile::tempdir().unwrap();
        for limit in [0, 1 << 20] {
            let mut store = GaussianStore::new(None, dir.path(), limit);
            let calls = Cell::new(0);
            for (source, key, z) in [
                ("s", "a", 1.0),
                ("s", "b", 2.0),
                ("s", "a", 1.0),
                ("s", "b", 2.0),
                ("s", "a", 1.0),
            ] {
                let predict = || {
                    calls.set(calls.get() + 1);
                    Ok((prediction(z), f64::from(z)))
                };
                let (found, secs) = store.get(key, source, Some(&predict)).unwrap().unwrap();
                assert_eq!((&*found, secs), (&prediction(z), f64::from(z)));
            }
            assert_eq!(calls.get(), 2, "limit {limit}");
            assert!(store.get("c", "s", None).unwrap().is_none());
            drop(store);
            // Files of predictions moved to disk are removed.
            assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        }
    }

    #[test]
    fn kept_predictions_outlive_the_store_and_damaged_ones_are_made_again() {
        let dir = tempfile::tempdir().unwrap();
        let kept = dir.path().join("gaussians");
        let store = || GaussianStore::new(Some(kept.clone()), dir.path(), 1 << 20);
        let predict = || Ok((prediction(1.5), 0.1));
        store().get("a", "s", Some(&predict)).unwrap();
        let (found, secs) = store().get("a", "s", None).unwrap().unwrap();
        assert_eq!((&*found, secs), (&prediction(1.5), 0.1));
        let path = file(&kept, "a");
        let mut bytes = std::fs::read(&path).unwrap();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        std::fs::write(&path, bytes).unwrap();
        assert!(store().get("a", "s", None).unwrap().is_none());
        store().get("a", "s", Some(&predict)).unwrap();
        assert!(store().get("a", "s", None).unwrap().is_some());
    }
}
