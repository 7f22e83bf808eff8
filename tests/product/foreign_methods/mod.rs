//! External methods: programs and pictures.

mod pictures;
mod programs;
mod scale_sweep;

use crate::support::{Said, read, sharp_bench, words};
use image::imageops;
use image::{Rgb, RgbImage};
use std::collections::BTreeMap;
use std::path::Path;

const DATASET: &str = "S:synthetic=size=96x72,views=12";

fn run(dir: &Path, out: &str, more: &[&str]) -> Said {
    let line = format!("run --dataset {DATASET} --metrics psnr --out {out}");
    let args = words(&line);
    sharp_bench(dir, &[&args[..], more].concat())
}

/// Rows of scores.csv by method and pair; each row by column.
type Scores = BTreeMap<String, Vec<BTreeMap<String, String>>>;

fn scores(dir: &Path, run: &str) -> Scores {
    let mut reader = csv::Reader::from_path(dir.join(run).join("scores.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let mut scores = Scores::new();
    for row in reader.records() {
        let row = row.unwrap();
        let row: BTreeMap<String, String> = header
            .iter()
            .zip(&row)
            .map(|(k, v)| (k.to_owned(), v.to_owned()))
            .collect();
        scores.entry(row["method"].clone()).or_default().push(row);
    }
    scores
}

/// Runs the method `target` in `DIR/truth`, so that tests can modify predictions that equal the
/// targets; returns their pair ids.
fn truth(dir: &Path, limit: &str) -> Vec<String> {
    run(dir, "truth", &["--method", "target", "--limit", limit]).ends_with(0);
    let rows = scores(dir, "truth");
    rows["target"]
        .iter()
        .map(|r| r["pair_id"].clone())
        .collect()
}

fn picture(dir: &Path, id: &str) -> RgbImage {
    let path = dir.join(format!("truth/predictions/target/{id}.png"));
    image::open(path).unwrap().to_rgb8()
}

fn save(dir: &Path, folder: &str, id: &str, image: &RgbImage) {
    let path = dir.join(folder).join(format!("{id}.png"));
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    image.save(path).unwrap();
}
