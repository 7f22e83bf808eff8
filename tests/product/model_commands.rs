//! `predict`, `parity`, `record`, `gaussians`, `weights` and the methods that take Gaussians, on the tiny network.

use std::path::{Path, PathBuf};

use crate::support::{Said, sharp_bench};

fn golden(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/model");
    path.join(name).display().to_string()
}

fn run(dir: &Path, args: &[&str]) -> Said {
    sharp_bench(dir, args)
}

fn tiny() -> [String; 4] {
    [
        "--checkpoint".into(),
        golden("tiny_model.pt"),
        "--config".into(),
        golden("tiny_config.json#tiny"),
    ]
}

/// The photograph that the tiny network was recorded on, with its focal length.
fn recorded_input() -> (String, String) {
    (golden("inputs/main_640x480.png"), "500".into())
}

#[test]
fn parity_with_the_official_recording_and_its_absence() {
    let dir = tempfile::tempdir().unwrap();
    let (image, focal) = recorded_input();
    let golden_file = golden("golden_tiny.safetensors");
    let tiny = tiny();
    let mut args = vec![
        "parity",
        "--image",
        &image,
        "--focal-px",
        &focal,
        "--golden",
        &golden_file,
        "--json",
    ];
    args.extend(tiny.iter().map(String::as_str));
    args.extend(["--prefix", "tiny"]);
    let json = run(dir.path(), &[&args[..], &["--tolerance", "5e-6"]].concat())
        .ends_with(0)
        .json();
    assert!(json["first_divergence"].is_null());
    let stages = json["stages"].as_array().unwrap();
    assert!(stages.len() > 60, "{}", stages.len());
    assert!(stages.iter().all(|s| s["values"].as_u64().unwrap() > 0));
    // Another focal length is another prediction: the first stage that it touches is named.
    let at = args.iter().position(|a| *a == focal).unwrap();
    args[at] = "77";
    let said = run(dir.path(), &args).ends_with(1);
    assert_eq!(said.json()["first_divergence"], "disparity_factor");
    assert!(
        said.err
            .contains("diverges first at stage disparity_factor")
    );
}

#[test]
fn a_recording_of_ours_is_reproduced() {
    let dir = tempfile::tempdir().unwrap();
    let (image, _) = recorded_input();
    let tiny = tiny();
    let model: Vec<&str> = tiny.iter().map(String::as_str).collect();
    let record = [
        "record",
        "--image",
        &image,
        "--focal-px",
        "400",
        "--out",
        "rec.safetensors",
    ];
    run(dir.path(), &[&record[..], &model].concat()).ends_with(0);
    let parity = [
        "parity",
        "--image",
        &image,
        "--focal-px",
        "400",
        "--golden",
        "rec.safetensors",
    ];
    let tolerance = ["--tolerance", "0"];
    run(dir.path(), &[&parity[..], &model, &tolerance].concat()).ends_with(0);
}

#[test]
fn a_photograph_becomes_gaussians_that_can_be_looked_at_and_rendered() {
    let dir = tempfile::tempdir().unwrap();
    let (image, _) = recorded_input();
    let tiny = tiny();
    let model: Vec<&str> = tiny.iter().map(String::as_str).collect();
    let predict = [
        "predict", &image, "--out", "p.ply", "--depth", "exr", "--json",
    ];
    let said = run(dir.path(), &[&predict[..], &model].concat()).ends_with(0);
    // The photograph has no EXIF tags: the default focal length is announced.
    assert!(said.err.contains("30 mm"), "{}", said.err);
    let json = said.json();
    let count = json[0]["gaussians"].as_u64().unwrap();
    assert_eq!(count, 2 * 96 * 96);
    assert!(dir.path().join("p.depth.exr").is_file());

    let info = run(dir.path(), &["gaussians", "info", "p.ply", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(info["gaussians"].as_u64(), Some(count));
    assert_eq!(info["per_layer"].as_u64(), Some(count / 2));
    assert_eq!(info["not_finite"], 0);

    let convert = [
        "gaussians",
        "convert",
        "p.ply",
        "q.ply",
        "--min-opacity",
        "0.5",
    ];
    run(dir.path(), &convert).ends_with(0);
    let kept = run(dir.path(), &["gaussians", "info", "q.ply", "--json"])
        .ends_with(0)
        .json();
    assert!(kept["gaussians"].as_u64().unwrap() < count);
    assert!(kept["opacity"]["quantiles"][0].as_f64().unwrap() >= 0.5);
    assert!(kept["image_size"].is_null());

    let said = run(
        dir.path(),
        &["render", "p.ply", "--out", "view.png", "--json"],
    )
    .ends_with(0);
    assert!(said.json()["mean_alpha"].as_f64().unwrap() > 0.5);
    run(dir.path(), &["render", "q.ply", "--out", "view.png"])
        .is_error_with(&["q.ply", "--camera"]);
}

#[test]
fn predicted_and_imported_gaussians_are_evaluated_alike() {
    let dir = tempfile::tempdir().unwrap();
    let tiny = tiny();
    let sharp = format!("sharp:label=tiny,checkpoint={},config={}", tiny[1], tiny[3]);
    let privileged = format!("{sharp},depth=privileged").replace("label=tiny", "label=aligned");
    let args = [
        "run",
        "--dataset",
        "S:synthetic=size=96x72,views=20",
        "--limit",
        "2",
        "--metrics",
        "psnr",
        "--out",
        "r",
        "--method",
        &sharp,
        "--method",
        &privileged,
        "--json",
    ];
    let json = run(dir.path(), &args).ends_with(0).json();
    assert_eq!(json["units"], 4);
    let mut reader = csv::Reader::from_path(dir.path().join("r/scores.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let scale = header.iter().position(|c| c == "median_scale").unwrap();
    let method = header.iter().position(|c| c == "method").unwrap();
    for row in reader.records().map(Result::unwrap) {
        assert_eq!(row[scale].is_empty(), &row[method] == "tiny");
    }

    // Someone's Gaussians for the same source, here the official writer's: rendered from its poses.
    let records = std::fs::read_to_string(dir.path().join("r/records.jsonl")).unwrap();
    let record: serde_json::Value = serde_json::from_str(records.lines().next().unwrap()).unwrap();
    let source = record["pair_id"]
        .as_str()
        .unwrap()
        .split("__")
        .next()
        .unwrap()
        .to_owned();
    let file = dir.path().join("g").join(format!("{source}.ply"));
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::copy(golden("tiny_golden.ply"), &file).unwrap();
    let args = [
        "run",
        "--dataset",
        "S:synthetic=size=96x72,views=20",
        "--limit",
        "1",
        "--metrics",
        "psnr",
        "--out",
        "s",
        "--method",
        "gaussians:label=theirs,dir=g",
        "--json",
    ];
    assert_eq!(run(dir.path(), &args).ends_with(0).json()["failed"], 0);
}

#[test]
fn weights_are_made_checked_and_converted() {
    let dir = tempfile::tempdir().unwrap();
    let config = golden("tiny_config.json#tiny");
    run(
        dir.path(),
        &[
            "weights",
            "synth",
            "--config",
            &config,
            "--out",
            "a.safetensors",
        ],
    )
    .ends_with(0);
    let pt = golden("tiny_model.pt");
    run(dir.path(), &["weights", "convert", &pt, "b.safetensors"]).ends_with(0);
    let check = |file: &str| {
        run(
            dir.path(),
            &["weights", "check", file, "--config", &config, "--json"],
        )
        .ends_with(0)
        .json()
    };
    let (synthetic, converted) = (check("a.safetensors"), check("b.safetensors"));
    assert_eq!(synthetic["parameters"], converted["parameters"]);
    assert_eq!(synthetic["modules"], converted["modules"]);
    assert_eq!(converted["not_finite"], 0);

    // The release's network is another one: everything that does not fit is listed.
    let said = run(dir.path(), &["weights", "check", "a.safetensors", "--json"]).ends_with(1);
    assert!(
        said.err.contains("missing") && said.err.contains("shape"),
        "{}",
        said.err
    );
    std::fs::write(dir.path().join("page.pt"), b"<!DOCTYPE html>").unwrap();
    assert_eq!(run(dir.path(), &["weights", "check", "page.pt"]).code, 1);
}

#[test]
fn what_is_no_photograph_is_one_line() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("note.jpg"), b"hello").unwrap();
    image::RgbImage::new(1, 1)
        .save(dir.path().join("dot.png"))
        .unwrap();
    let tiny = tiny();
    let model: Vec<&str> = tiny.iter().map(String::as_str).collect();
    for file in ["note.jpg", "dot.png", "absent.png"] {
        let args = ["predict", file, "--out", "p.ply"];
        run(dir.path(), &[&args[..], &model].concat()).is_error_with(&[file]);
    }
}
