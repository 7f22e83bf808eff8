//! `pairs` and its subcommands, `cameras export`.

mod ambiguity;
mod exports;
mod lists;
mod overlap;

use crate::support::{Said, read, sharp_bench, words};
use sharp_bench::export::camera_file::CameraFile;
use sharp_datasets::DatasetSpec;
use std::path::{Path, PathBuf};

const SYNTHETIC: &str = "S:synthetic=size=96x72,views=12";

fn build(dir: &Path, out: &str, more: &[&str]) -> Said {
    let args = ["pairs", "--dataset", SYNTHETIC, "--out", out];
    sharp_bench(dir, &[&args[..], more].concat())
}

fn modified(path: &Path) -> std::time::SystemTime {
    std::fs::metadata(path).unwrap().modified().unwrap()
}

fn find(folder: &Path, name: &str) -> PathBuf {
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.file_name().unwrap() == name {
                return path;
            }
        }
    }
    panic!("no {name}");
}
