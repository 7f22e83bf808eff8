//! Whole reports from small runs.

mod file_tests;
mod record_tests;
mod table_tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use image::{GrayImage, Luma, Rgb, RgbImage};
use sharp_metrics::MetricKey;

use crate::evaluate::record::{Record, Score, Status};

use super::board::Board;
use super::tables::{Table, build};
use super::*;

fn record(
    dataset: &str,
    pair: &str,
    method: &str,
    baseline_m: f64,
    scores: &[(&str, f64)],
) -> Record {
    Record {
        pair_id: format!("{dataset}/{pair}"),
        dataset: dataset.into(),
        scene: "scene".into(),
        cluster: "scene".into(),
        source: "0".into(),
        target: "1".into(),
        method: method.into(),
        baseline_m,
        rotation_deg: 1.0,
        median_depth_m: None,
        overlap: Some(0.8),
        status: Status::Ok,
        scores: scores
            .iter()
            .map(|(k, v)| ((*k).into(), Score::Value(*v)))
            .collect(),
        crop: None,
        valid_share: None,
        resized_from: None,
        scale: None,
        files: None,
        extras: BTreeMap::new(),
        warnings: BTreeMap::new(),
    }
}

fn failed(mut record: Record, reason: &str) -> Record {
    record.status = Status::Failed {
        reason: reason.into(),
    };
    record.scores.clear();
    record
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

fn input(records: &[Record]) -> ReportInput<'_> {
    ReportInput {
        title: "A run".into(),
        summary: "Two methods.".into(),
        records,
        metrics: vec![MetricKey::PSNR.into()],
        extras: Vec::new(),
        datasets: Vec::new(),
        methods: Vec::new(),
        facts: Vec::new(),
        published: PublishedNumbers::Matching,
        comparison: None,
        pictures: &NoPictures,
        options: ReportOptions::default(),
    }
}

fn psnr_table(records: &[Record]) -> Table {
    let board = Board::new(records, &[], &[]).unwrap();
    build::of_scores(&board, &[MetricKey::PSNR.into()]).remove(0)
}

/// Every file of a report by its relative name.
fn files(input: &ReportInput<'_>) -> BTreeMap<String, Vec<u8>> {
    let dir = tempfile::tempdir().unwrap();
    let written = write_report(input, dir.path()).unwrap();
    let name = |path: &Path| path.strip_prefix(dir.path()).unwrap().display().to_string();
    written
        .all
        .iter()
        .map(|path| (name(path), std::fs::read(path).unwrap()))
        .collect()
}

/// A picture that depends on the record; all pixels are scored.
struct Plain;

/// Predictions that no encoder makes small.
struct Noise;

impl ReportPictures for Noise {
    fn prediction(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        let mut state = record
            .pair_id
            .bytes()
            .fold(1_u32, |a, b| a * 31 + u32::from(b));
        Ok(RgbImage::from_fn(640, 480, |_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            Rgb([(state >> 24) as u8, (state >> 16) as u8, (state >> 8) as u8])
        }))
    }
}

/// White truths, black predictions that were kept in a folder; the left half of every target is excluded.
struct HalfMasked(PathBuf);

impl ReportPictures for HalfMasked {
    fn target(&self, _record: &Record) -> Result<RgbImage, MissingPicture> {
        Ok(RgbImage::from_pixel(64, 48, Rgb([255; 3])))
    }

    fn valid_pixels(&self, _record: &Record) -> Result<Option<GrayImage>, MissingPicture> {
        let level = |x: u32| if x < 32 { 254 } else { 255 };
        Ok(Some(GrayImage::from_fn(64, 48, |x, _| Luma([level(x)]))))
    }

    fn prediction(&self, _record: &Record) -> Result<RgbImage, MissingPicture> {
        Ok(RgbImage::new(64, 48))
    }

    fn kept(&self, record: &Record) -> Option<PathBuf> {
        Some(self.0.join(format!("{} 1.png", record.method)))
    }

    fn photographs(&self, _record: &Record) -> [Option<PathBuf>; 2] {
        [None, Some(self.0.join("im 1.png"))]
    }
}

impl ReportPictures for Plain {
    fn source(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        Ok(RgbImage::from_fn(64, 48, |x, y| {
            Rgb([x as u8, y as u8, (record.baseline_m * 100.0) as u8])
        }))
    }

    fn target(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        self.source(record)
    }

    fn prediction(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        match record.method.as_str() {
            "a" => self.source(record),
            _ => Err(MissingPicture::NotKept),
        }
    }
}
