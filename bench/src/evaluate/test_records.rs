//! Records and manifests for tests.

use std::collections::BTreeMap;

use image::RgbImage;
use sharp_metrics::{Selection, Weights};

use super::manifest::Manifest;
use super::prepare::{Request, prepare};
use super::record::{Record, Status};
use crate::io::observer::Quiet;
use crate::methods::{Closure, Method, MethodError, SourceView, TargetCamera};
use crate::pairs::OpenDataset;
use crate::scoring::Scoring;

/// A manifest of a procedural scene `D_1`, a method `m` and some metrics.
pub(crate) fn manifest(metrics: &str) -> Manifest {
    let datasets = ["D_1:synthetic=size=16x12,views=4".parse().unwrap()];
    let black = |_: &SourceView, target: &TargetCamera| -> Result<_, MethodError> {
        let (width, height) = target.size();
        Ok(RgbImage::new(width, height).into())
    };
    let method: Box<dyn Method> = Box::new(Closure::new("m", "1", black));
    let selection = Selection::parse(metrics).unwrap();
    let scoring = Scoring::new(&selection, &Weights::deterministic("")).unwrap();
    let datasets = OpenDataset::open_all(&datasets, None).unwrap();
    let request = Request::new(datasets, vec![method], scoring);
    prepare(request, &Quiet).unwrap().manifest().unwrap()
}

/// Pair `number` of a scene that forms its own cluster, for method `m`, without scores.
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
        files: None,
        extras: BTreeMap::new(),
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
    }
}
