//! A unit of a run: one pair predicted by one method, with the keys of its stages.
//!
//! A unit's *slot* identifies it: pair, method with its identity, dataset with its settings. Its *keys* hash the inputs
//! of its stages, so that only stages whose inputs changed are redone.

use std::collections::BTreeMap;

use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::record::{Record, Score, Status};
use crate::io::hash::{StableHasher, sha256_hex};
use crate::io::text::reason_line;
use crate::methods::spec::check_label;
use crate::pairs::pair_id::PairName;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Unit {
    /// [`super::manifest::FORMAT`] of the writer.
    pub format: u32,
    /// SHA-256 over all other fields.
    pub checksum: String,
    /// The unit's identity.
    pub slot: Slot,
    /// Hash of all inputs of prediction and rendering.
    pub picture_key: String,
    /// The pair, the outcome and reported values, without scores; see [`Self::scores`].
    pub record: Record,
    /// The scored picture; `None` for a failure.
    pub picture: Option<ScoredPicture>,
    /// Scores by metric key.
    pub scores: BTreeMap<String, StoredScore>,
    /// Times of the stages, which are not part of the result.
    pub timing: Timing,
}

/// Identity of a unit: equal slots denote the same unit, whatever its result.
#[derive(
    Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
pub struct Slot {
    /// `dataset/scene/source__target`.
    pub pair_id: String,
    /// Label of the method.
    pub method: String,
    /// Hash of the method's identity and privilege.
    pub method_identity: String,
    /// Hash of the dataset's reader and settings.
    pub dataset_identity: String,
}

impl Slot {
    /// The name of the unit's file.
    pub fn file_stem(&self) -> String {
        StableHasher::default()
            .add("pair", &self.pair_id)
            .add("method", &self.method)
            .add("method identity", &self.method_identity)
            .add("dataset identity", &self.dataset_identity)
            .finish()
    }
}

/// The 8-bit picture that was scored.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ScoredPicture {
    /// SHA-256 of its size and pixels.
    pub sha256: String,
    /// SHA-256 of the PNG in the run folder; `None` if the picture was not kept.
    pub file_sha256: Option<String>,
    /// SHA-256 of the EXR next to the PNG (linear RGB and alpha); `None` if no EXR was kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub float_sha256: Option<String>,
}

/// A score with the key of its inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StoredScore {
    /// Hash of metric, picture, ground truth and region.
    pub key: String,
    /// Hash of the metric's convention, weights and code.
    pub metric_identity: String,
    pub score: Score,
}

/// Times of a unit, and the machine it ran on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Timing {
    /// Wall time of inference in seconds, without reading files, measured while an earlier pair was being scored. For
    /// methods that predict Gaussians, it is the time for the source, repeated for every target and method that uses
    /// this inference. For other methods, it is the time for the pair.
    pub predict_secs: f64,
    /// Wall time of placing and rendering the Gaussians; 0 for methods that make pictures.
    #[serde(default)]
    pub render_secs: f64,
    /// Key of the inference, equal for all units that share it; `None` if each unit has its own inference.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inference: Option<String>,
    /// The unit's share of the wall time of the pair's metrics, measured while the next pair was
    /// being predicted.
    pub score_secs: f64,
    /// Processor and number of threads of the prediction, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<String>,
    /// Peak memory of the process up to the end of the prediction, bytes; excludes programs that it started.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_bytes: Option<u64>,
}

impl Timing {
    /// Time from the source's photograph in memory to the picture, in seconds.
    pub fn synthesis_secs(&self) -> f64 {
        self.predict_secs + self.render_secs
    }
}

impl Unit {
    #[must_use]
    pub fn sealed(mut self) -> Self {
        self.checksum = self.computed_checksum();
        self
    }

    /// Whether the checksum matches the other fields, so that the file is undamaged.
    pub fn is_whole(&self) -> bool {
        self.checksum == self.computed_checksum()
    }

    /// Whether the record matches the slot, and the slot's names cannot form a path outside the folder.
    pub(super) fn is_consistent(&self) -> bool {
        let Record {
            pair_id,
            dataset,
            scene,
            source,
            target,
            method,
            ..
        } = &self.record;
        PairName::decode(pair_id).is_ok_and(|name| {
            [&name.dataset, &name.scene, &name.source, &name.target]
                == [dataset, scene, source, target]
        }) && (pair_id, method) == (&self.slot.pair_id, &self.slot.method)
            && check_label(method).is_ok()
    }

    /// The unit with its status set to success, so that failed scoring is retried; `None` if it has no picture.
    pub(super) fn scorable(mut self) -> Option<Self> {
        self.picture.as_ref()?;
        self.record.status = Status::Ok;
        Some(self)
    }

    fn computed_checksum(&self) -> String {
        let open = Self {
            checksum: String::new(),
            ..self.clone()
        };
        // These are ordered maps of plain values: serialising cannot fail, and equal units give equal bytes.
        sha256_hex(&serde_json::to_vec(&open).unwrap_or_default())
    }

    /// The record, with scores for `metrics` (keys and identities). A score with another identity
    /// counts as missing.
    pub fn record_with(&self, metrics: &[(String, String)]) -> Record {
        let scores = metrics.iter().filter_map(|(key, identity)| {
            let stored = self.scores.get(key)?;
            (stored.metric_identity == *identity).then(|| (key.clone(), stored.score.clone()))
        });
        let mut record = Record {
            scores: scores.collect(),
            ..self.record.clone()
        };
        // Earlier versions stored reasons of any length; shorten them.
        if let Status::Failed { reason } = &mut record.status {
            *reason = reason_line(reason);
        }
        record
    }

    /// The unit's progress. `lacks_scores` states whether scores of requested metrics are missing.
    pub(super) fn progress(&self, lacks_scores: bool) -> UnitProgress {
        match (&self.record.status, lacks_scores) {
            (Status::Failed { .. }, _) => UnitProgress::Failed,
            (Status::Ok, true) => UnitProgress::Unscored,
            (Status::Ok, false) => UnitProgress::Done,
        }
    }

    pub(super) fn is_failure(&self) -> bool {
        self.record.status != Status::Ok
    }

    /// Whether the unit has scores or is a recorded failure.
    pub(super) fn is_done(&self) -> bool {
        self.progress(self.scores.is_empty()) != UnitProgress::Unscored
    }
}

/// Progress of a planned unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum UnitProgress {
    /// No result, or a result made from other files or by another method.
    Missing,
    Failed,
    Unscored,
    Done,
}

/// SHA-256 of a picture's size and pixels.
pub(super) fn picture_sha256(picture: &RgbImage) -> String {
    StableHasher::default()
        .add("size", &format!("{:?}", picture.dimensions()))
        .add("pixels", &sha256_hex(picture.as_raw()))
        .finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(in crate::evaluate) fn unit(pair_id: &str, method: &str, psnr: f64) -> Unit {
        let slot = Slot {
            pair_id: pair_id.to_owned(),
            method: method.to_owned(),
            method_identity: "m".to_owned(),
            dataset_identity: "d".to_owned(),
        };
        let record = Record {
            pair_id: pair_id.to_owned(),
            dataset: "D".to_owned(),
            scene: "s".to_owned(),
            cluster: "s".to_owned(),
            source: "a".to_owned(),
            target: "b".to_owned(),
            method: method.to_owned(),
            baseline_m: 0.1,
            rotation_deg: 1.0 / 3.0,
            median_depth_m: None,
            overlap: Some(0.7),
            status: Status::Ok,
            scores: BTreeMap::new(),
            crop: None,
            valid_share: None,
            resized_from: None,
            scale: None,
            files: None,
            extras: BTreeMap::from([("mean_alpha".to_owned(), 0.1 + 0.2)]),
            warnings: BTreeMap::new(),
            change: None,
            shows: None,
            camera: None,
            in_world: None,
            wrong_cells: None,
            shift: None,
            far_shift: None,
            tone: None,
            masked: None,
            filled: None,
            rule_note: None,
        };
        let score = StoredScore {
            key: "k".to_owned(),
            metric_identity: "i".to_owned(),
            score: Score::Value(psnr),
        };
        Unit {
            format: 2,
            checksum: String::new(),
            slot,
            picture_key: "p".to_owned(),
            record,
            picture: None,
            scores: BTreeMap::from([("psnr".to_owned(), score)]),
            timing: Timing::default(),
        }
        .sealed()
    }

    #[test]
    fn one_changed_digit_is_noticed_after_reading_back() {
        for psnr in [17.33, f64::INFINITY, 1e-300, 0.1 + 0.2] {
            let whole = unit("D/s/a__b", "copy", psnr);
            let text = serde_json::to_string_pretty(&whole).unwrap();
            let read: Unit = serde_json::from_str(&text).unwrap();
            assert!(read.is_whole(), "{psnr}");
            assert_eq!(read, whole);
        }
        let text = serde_json::to_string(&unit("D/s/a__b", "copy", 17.33)).unwrap();
        let changed: Unit = serde_json::from_str(&text.replace("17.33", "17.34")).unwrap();
        assert!(!changed.is_whole());
    }

    #[test]
    fn scores_of_another_identity_are_missing() {
        let unit = unit("D/s/a__b", "copy", 3.0);
        let with = |identity: &str| {
            let metrics = [("psnr".to_owned(), identity.to_owned())];
            unit.record_with(&metrics).scores.len()
        };
        assert_eq!((with("i"), with("other")), (1, 0));
    }
}
