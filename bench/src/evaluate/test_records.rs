//! Records for tests.

use std::collections::BTreeMap;

use super::record::{Record, Status};

/// Pair `number` of a scene of its own cluster, by method `m`, without scores.
pub(crate) fn record(dataset: &str, scene: usize, number: usize) -> Record {
    Record {
        pair_id: format!("{dataset}/{scene}/s__{number}"),
        dataset: dataset.into(),
        scene: scene.to_string(),
        cluster: scene.to_string(),
        source: "s".into(),
        target: number.to_string(),
        method: "m".into(),
        baseline_m: 0.1,
        rotation_deg: 0.0,
        median_depth_m: None,
        overlap: None,
        status: Status::Ok,
        scores: BTreeMap::new(),
        crop: None,
        valid_share: None,
        resized_from: None,
        scale: None,
        extras: BTreeMap::new(),
    }
}
