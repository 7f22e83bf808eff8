//! Checking a list against someone's files.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use sharp::camera::baseline_m;
use sharp_datasets::{Scene, View};

use super::{PairList, absent_scene};
use crate::pairs::build::Pair;

/// Poses that agree to this are the same, metres: far below any calibration, far above rounding.
const SAME_BASELINE_M: f64 = 1e-9;

/// Rotations likewise, degrees. The angle comes from an arc cosine or sine of rounded numbers.
const SAME_ROTATION_DEG: f64 = 1e-6;

/// What became of a list's photographs and cameras in someone's files.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Verification {
    pub photographs: usize,
    pub equal: usize,
    pub unhashed: usize,
    pub different: Vec<HashMismatch>,
    /// Photographs that cannot be read: `dataset/scene/view` and the reason.
    pub unreadable: Vec<(String, String)>,
    /// Datasets, scenes and views that are not there, each once.
    pub absent: Vec<String>,
    pub moved: Vec<MovedCamera>,
}

impl Verification {
    /// True if every photograph with a hash is the list's and every camera stands where it did.
    pub fn is_good(&self) -> bool {
        self.different.is_empty()
            && self.unreadable.is_empty()
            && self.absent.is_empty()
            && self.moved.is_empty()
    }
}

/// A photograph that is not the one that a list was made from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HashMismatch {
    pub dataset: String,
    pub scene: String,
    pub view: String,
    pub expected: String,
    pub found: String,
}

/// A pair whose cameras stand otherwise than in the list.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedCamera {
    pub pair_id: String,
    /// Baseline and rotation in the list, metres and degrees.
    pub expected: (f64, f64),
    pub found: (f64, f64),
}

impl PairList {
    /// Compares photographs, by sha256, and cameras, by baseline and rotation, with the list's, and says what is not
    /// there. Every problem is found, not only the first.
    pub fn verify(&self, scenes: &[Scene]) -> Verification {
        let mut report = Verification::default();
        let mut absent = BTreeSet::new();
        let mut photographs: BTreeMap<(&str, &str, &str), Photograph> = BTreeMap::new();
        for pair in &self.pairs {
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
                report.moved.extend(moved(pair, source, target));
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
    /// What the list says; more than one where its rows disagree.
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
                let name = format!("{dataset}/{scene}/{view}");
                report.unreadable.push((name, error.to_string()));
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

fn moved(pair: &Pair, source: &View, target: &View) -> Option<MovedCamera> {
    let (s, t) = (&source.camera_from_world, &target.camera_from_world);
    let found = (baseline_m(s, t), t.after(&s.inverse()).rotation_deg());
    let expected = (pair.baseline_m, pair.rotation_deg);
    let same = (found.0 - expected.0).abs() <= SAME_BASELINE_M
        && (found.1 - expected.1).abs() <= SAME_ROTATION_DEG;
    (!same).then(|| MovedCamera {
        pair_id: pair.pair_id.clone(),
        expected,
        found,
    })
}
