//! `datasets check` as a library: broken files are reported, wrong poses are detected, and nothing
//! is written into a dataset.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

use std::path::Path;

use sharp_datasets::check::{DatasetReport, check};
use sharp_datasets::{DatasetSpec, bundled, files};

fn report(format: &str, folder: &Path) -> DatasetReport {
    let spec = DatasetSpec::parse(&format!("{format}={}", folder.display())).unwrap();
    check(&spec, 10, &|_, _| {}).unwrap()
}

#[test]
fn the_bundled_scene_is_sound_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = bundled::extract(folder.path()).unwrap();
    let scene = dataset.join("Motorcycle-quarter");
    let before = files::list(&scene).unwrap();
    let mut permissions = std::fs::metadata(&scene).unwrap().permissions();
    permissions.set_readonly(true);
    std::fs::set_permissions(&scene, permissions).unwrap();

    let report = report("middlebury", &dataset);
    assert_eq!(report.problems, 0, "{:?}", report.scenes[0].problems);
    let found = &report.scenes[0];
    assert_eq!((found.views, found.decoded, found.with_depth), (2, 2, 1));
    // 343,274 of 741 × 500 pixels.
    assert!((found.depth_coverage.unwrap() - 343_274.0 / 370_500.0).abs() < 1e-12);
    assert_eq!(files::list(&scene).unwrap(), before);

    #[allow(
        clippy::permissions_set_readonly_false,
        reason = "a temporary folder, about to be deleted"
    )]
    {
        let mut permissions = std::fs::metadata(&scene).unwrap().permissions();
        permissions.set_readonly(false);
        std::fs::set_permissions(&scene, permissions).unwrap();
    }
}

#[test]
fn a_broken_picture_is_a_problem_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = bundled::extract(folder.path()).unwrap();
    let path = dataset.join("Motorcycle-quarter/im1.png");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let report = report("middlebury", &dataset);
    assert_eq!(report.problems, 1);
    let problem = &report.scenes[0].problems[0];
    assert!(
        problem.contains("im1.png") && problem.contains("truncated"),
        "{problem}"
    );
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["problems"], 1);
    assert_eq!(json["readings"][1]["key"], "rectification");
    assert_eq!(json["unreadable"], serde_json::json!([]));
}
