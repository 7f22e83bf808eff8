//! Whole reports from small runs.

mod file_tests;
mod table_tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::{GrayImage, Luma, Rgb, RgbImage};
use sharp::camera::{Intrinsics, RigidTransform};
use sharp_datasets::{DatasetError, Pairing, Scene, View, ViewContent};
use sharp_metrics::MetricKey;

use crate::evaluate::record::{Record, Score, Status};
use crate::evaluate::results::PictureFolder;
use crate::evaluate::{Results, RunFolder, test_records};
use crate::io::hash::file_sha256;

use super::statistics::Uncertainty;
use super::tables::{Table, build};
use super::test_results::results;
use super::*;

fn record(
    dataset: &str,
    pair: &str,
    method: &str,
    baseline_m: f64,
    scores: &[(&str, f64)],
) -> Record {
    let scores = scores.iter();
    Record {
        pair_id: format!("{dataset}/{pair}"),
        source: format!("{pair} source"),
        target: format!("{pair} target"),
        method: method.into(),
        baseline_m,
        scores: scores
            .map(|(key, value)| ((*key).into(), Score::Value(*value)))
            .collect(),
        ..test_records::record(dataset, 0, 0)
    }
}

fn failed(record: Record, reason: &str) -> Record {
    Record {
        status: Status::Failed {
            reason: reason.into(),
        },
        scores: BTreeMap::new(),
        ..record
    }
}

/// Two methods, two pairs; the second prediction of `b` failed.
fn small_run() -> Vec<Record> {
    vec![
        record("d", "p2", "a", 0.2, &[("psnr", 30.0)]),
        record("d", "p1", "a", 0.1, &[("psnr", 20.0)]),
        record("d", "p1", "b", 0.1, &[("psnr", 40.0)]),
        failed(record("d", "p2", "b", 0.2, &[]), "p2.ply: truncated"),
    ]
}

fn psnr(records: Vec<Record>) -> Results {
    results(&[MetricKey::PSNR], records)
}

/// The first table of the scores under some metrics.
fn table(keys: &[MetricKey], records: &[Record]) -> Table {
    let results = results(keys, records.to_vec());
    let board = Board::of(&results).unwrap();
    build::of_scores(&board, &board.metrics).remove(0)
}

/// Every file of a report, keyed by its relative name.
fn files(
    results: &Results,
    scenes: &[Scene],
    options: &ReportOptions,
) -> BTreeMap<String, Vec<u8>> {
    let dir = tempfile::tempdir().unwrap();
    let written = report(results, scenes, dir.path(), options).unwrap();
    let name = |path: &Path| path.strip_prefix(dir.path()).unwrap().display().to_string();
    let all = written.all.iter();
    all.map(|path| (name(path), std::fs::read(path).unwrap()))
        .collect()
}

fn page(results: &Results, scenes: &[Scene], options: &ReportOptions) -> String {
    let mut files = files(results, scenes, options);
    String::from_utf8(files.remove("index.html").unwrap()).unwrap()
}

/// A photograph of 64 × 48 pixels in memory.
#[derive(Debug, Clone)]
struct Photograph {
    image: RgbImage,
    valid: Option<GrayImage>,
    file: Option<PathBuf>,
}

impl ViewContent for Photograph {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Ok(self.image.clone())
    }

    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        Ok(self.valid.clone())
    }

    fn image_file(&self) -> Option<&Path> {
        self.file.as_deref()
    }
}

/// A photograph that is different for each view.
fn plain(view: &str) -> Photograph {
    let level = view
        .bytes()
        .fold(0_u8, |sum, byte| sum.wrapping_mul(31) ^ byte);
    Photograph {
        image: RgbImage::from_fn(64, 48, |x, y| Rgb([x as u8, y as u8, level])),
        valid: None,
        file: None,
    }
}

/// A white photograph whose left half is excluded from scoring.
fn half_masked(_view: &str) -> Photograph {
    let level = |x: u32| if x < 32 { 254 } else { 255 };
    Photograph {
        image: RgbImage::from_pixel(64, 48, Rgb([255; 3])),
        valid: Some(GrayImage::from_fn(64, 48, |x, _| Luma([level(x)]))),
        file: None,
    }
}

/// The scenes of records.
fn scenes(records: &[Record], photograph: impl Fn(&str) -> Photograph) -> Vec<Scene> {
    let mut scenes: BTreeMap<&str, Vec<View>> = BTreeMap::new();
    for record in records {
        let views = scenes.entry(&record.dataset).or_default();
        for id in [&record.source, &record.target] {
            if !views.iter().any(|view| view.id == *id) {
                views.push(View {
                    id: id.clone(),
                    intrinsics: Intrinsics::new((64.0, 64.0), (32.0, 24.0), (64, 48)).unwrap(),
                    camera_from_world: RigidTransform::IDENTITY,
                    content: Arc::new(photograph(id)),
                });
            }
        }
    }
    let scene = |(dataset, views): (&str, Vec<View>)| Scene {
        dataset: dataset.to_owned(),
        id: "0".to_owned(),
        cluster: "0".to_owned(),
        views,
        pairing: Pairing::MultiView,
        notes: Vec::new(),
        warnings: Vec::new(),
        left_out: Vec::new(),
    };
    scenes.into_iter().map(scene).collect()
}

/// Keeps predictions in a run folder.
fn keep(results: &mut Results, root: &Path, prediction: impl Fn(&Record) -> Option<RgbImage>) {
    std::fs::create_dir_all(root).unwrap();
    std::fs::write(root.join("manifest.json"), "").unwrap();
    let folder = RunFolder::open(root).unwrap();
    let mut sha256 = BTreeMap::new();
    for record in &results.records {
        if let Some(picture) = prediction(record) {
            let path = folder.prediction_path(&record.method, &record.pair_id, "png");
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            picture.save(&path).unwrap();
            let unit = (record.pair_id.clone(), record.method.clone());
            sha256.insert(unit, file_sha256(&path).unwrap());
        }
    }
    let labels = results.manifest.methods.iter().map(|m| m.label.clone());
    results.pictures.push(PictureFolder {
        folder,
        labels: labels.map(|label| (label.clone(), label)).collect(),
        sha256,
        float_sha256: BTreeMap::new(),
    });
}
