//! Verifies a list against local files.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use serde::Serialize;
use sharp::camera::baseline_m;
use sharp_datasets::{Scene, View};

use super::{PairList, absent_scene};
use crate::pairs::Pair;

/// Largest difference of baselines that count as equal, in metres: far below any calibration error, far above rounding.
const SAME_BASELINE_M: f64 = 1e-9;

/// Largest difference of rotations that count as equal, in degrees. It allows for rounding errors, amplified by the arc
/// cosine or arc sine that gives the angle.
const SAME_ROTATION_DEG: f64 = 1e-6;

/// Result of comparing a list's photographs and cameras with local files.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Verification {
    /// Distinct photographs in the list.
    pub photographs: usize,
    /// Photographs that were read and match the list.
    pub equal: usize,
    /// Photographs without a hash in the list.
    #[serde(rename = "without_hash")]
    pub unhashed: usize,
    pub different: Vec<HashMismatch>,
    pub unreadable: Vec<Unreadable>,
    /// Datasets, scenes and views that are missing, each once.
    pub absent: Vec<String>,
    /// Pairs whose cameras differ from the list.
    pub moved: Vec<MovedCamera>,
}

impl Verification {
    /// Whether every hashed photograph and every camera matches the list.
    pub fn is_good(&self) -> bool {
        self.different.is_empty()
            && self.unreadable.is_empty()
            && self.absent.is_empty()
            && self.moved.is_empty()
    }
}

/// A photograph that differs from the one in the list.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct HashMismatch {
    pub dataset: String,
    pub scene: String,
    pub view: String,
    pub expected: String,
    pub found: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Unreadable {
    /// `dataset/scene/view`.
    pub view: String,
    pub reason: String,
}

/// A pair whose cameras differ from the list. In arrays of two, the list's value comes first, then that of the files.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MovedCamera {
    /// Line in the list's file.
    pub line: u64,
    pub pair_id: String,
    pub baseline_m: [f64; 2],
    pub rotation_deg: [f64; 2],
}

impl PairList {
    /// Compares photographs (by SHA-256) and cameras (by baseline and rotation) with the list's, and reports missing
    /// scenes and views. Collects every problem, not just the first.
    pub fn verify(&self, scenes: &[Scene]) -> Verification {
        let mut report = Verification::default();
        let mut absent = BTreeSet::new();
        let mut photographs: BTreeMap<(&str, &str, &str), Photograph> = BTreeMap::new();
        for (pair, &line) in self.pairs.iter().zip(&self.lines) {
            let Some(scene) = scenes
                .iter()
                .find(|s| s.dataset == pair.dataset && s.id == pair.scene)
            else {
                absent.insert(absent_scene(pair, scenes));
                continue;
            };
            let mut found = Vec::new();
            for (id, hash) in [
                (&pair.source, &pair.source_sha256),
                (&pair.target, &pair.target_sha256),
            ] {
                let Some(view) = scene.views.iter().find(|v| v.id == *id) else {
                    absent.insert(format!(
                        "view '{id}' is not in scene '{}' of dataset '{}'",
                        pair.scene, pair.dataset
                    ));
                    continue;
                };
                let key = (pair.dataset.as_str(), pair.scene.as_str(), id.as_str());
                let photograph = photographs.entry(key).or_insert_with(|| Photograph {
                    view,
                    hashes: BTreeSet::new(),
                });
                if !hash.is_empty() {
                    photograph.hashes.insert(hash);
                }
                found.push(view);
            }
            if let [source, target] = found.as_slice() {
                report.moved.extend(moved(pair, line, source, target));
            }
        }
        report.absent = absent.into_iter().collect();
        report.photographs = photographs.len();
        compare(photographs, &mut report);
        report
    }
}

struct Photograph<'a> {
    view: &'a View,
    /// Hashes in the list; several if its rows contradict each other.
    hashes: BTreeSet<&'a str>,
}

fn compare(photographs: BTreeMap<(&str, &str, &str), Photograph>, report: &mut Verification) {
    let photographs: Vec<_> = photographs.into_iter().collect();
    let found: Vec<_> = photographs
        .par_iter()
        .map(|(_, photograph)| {
            let hashed = !photograph.hashes.is_empty();
            hashed.then(|| photograph.view.content.image_sha256())
        })
        .collect();
    for (((dataset, scene, view), photograph), found) in photographs.into_iter().zip(found) {
        let found = match found {
            None => {
                report.unhashed += 1;
                continue;
            }
            Some(Err(error)) => {
                report.unreadable.push(Unreadable {
                    view: format!("{dataset}/{scene}/{view}"),
                    reason: error.to_string(),
                });
                continue;
            }
            Some(Ok(found)) => found,
        };
        let before = report.different.len();
        for expected in photograph.hashes.into_iter().filter(|hash| **hash != found) {
            report.different.push(HashMismatch {
                dataset: dataset.to_owned(),
                scene: scene.to_owned(),
                view: view.to_owned(),
                expected: expected.to_owned(),
                found: found.clone(),
            });
        }
        report.equal += usize::from(report.different.len() == before);
    }
}

fn moved(pair: &Pair, line: u64, source: &View, target: &View) -> Option<MovedCamera> {
    let (s, t) = (&source.camera_from_world, &target.camera_from_world);
    let baseline_m = [pair.baseline_m, baseline_m(s, t)];
    let rotation_deg = [pair.rotation_deg, t.after(&s.inverse()).rotation_deg()];
    let same = |[listed, found]: [f64; 2], tolerance| (listed - found).abs() <= tolerance;
    let unmoved = same(baseline_m, SAME_BASELINE_M) && same(rotation_deg, SAME_ROTATION_DEG);
    (!unmoved).then(|| MovedCamera {
        line,
        pair_id: pair.pair_id.clone(),
        baseline_m,
        rotation_deg,
    })
}
