//! `sharp-bench metrics` as used in scripts.

use crate::support::{sharp_bench, words};
use image::{Rgb, RgbImage};

fn picture(seed: u32, width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let v = (x * 7 + y * 13 + seed * 29) % 251;
        Rgb([v as u8, (v / 2) as u8, 255 - v as u8])
    })
}

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (side, seed) in [("p", 0), ("t", 1)] {
        std::fs::create_dir(dir.path().join(side)).unwrap();
        for name in ["a", "b"] {
            let path = dir.path().join(side).join(format!("{name}.png"));
            picture(seed + u32::from(name == "b"), 40, 30)
                .save(path)
                .unwrap();
        }
    }
    dir
}

#[test]
fn two_pictures_and_their_json() {
    let dir = folder();
    let said = sharp_bench(
        dir.path(),
        &words("metrics p/a.png t/a.png --metrics psnr,ssim-gauss11-valid --json"),
    )
    .ends_with(0);
    let json = said.json();
    let pair = &json["pairs"][0];
    assert_eq!(pair["prediction"], "p/a.png");
    assert_eq!(pair["target"], "t/a.png");
    let psnr = pair["scores"]["psnr"].as_f64().unwrap();
    // The same value, computed from the definition in integers.
    let (p, t) = (picture(0, 40, 30), picture(1, 40, 30));
    let sse: u64 = p
        .as_raw()
        .iter()
        .zip(t.as_raw())
        .map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2))
        .sum();
    let mse = sse as f64 / (40.0 * 30.0 * 3.0 * 255.0 * 255.0);
    assert!((psnr + 10.0 * mse.log10()).abs() < 1e-9);
    assert!(pair["scores"]["ssim[gauss11,valid]"].is_f64());
    assert_eq!(json["mean"]["psnr"], pair["scores"]["psnr"]);
}

#[test]
fn identical_pictures_score_inf_as_text() {
    let dir = folder();
    let args = words("metrics p/a.png p/a.png --metrics psnr --json");
    let json = sharp_bench(dir.path(), &args).ends_with(0).json();
    assert_eq!(json["pairs"][0]["scores"]["psnr"], "inf");
    assert_eq!(json["mean"]["psnr"], "inf");
}

#[test]
fn folders_are_matched_by_stem_and_averaged() {
    let dir = folder();
    let args = ["metrics", "p", "t", "--metrics", "psnr", "--json"];
    let json = sharp_bench(dir.path(), &args).ends_with(0).json();
    let scores: Vec<f64> = json["pairs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|pair| pair["scores"]["psnr"].as_f64().unwrap())
        .collect();
    assert_eq!(scores.len(), 2);
    let mean = json["mean"]["psnr"].as_f64().unwrap();
    assert!((mean - (scores[0] + scores[1]) / 2.0).abs() < 1e-12);

    std::fs::remove_file(dir.path().join("t/b.png")).unwrap();
    sharp_bench(dir.path(), &args).is_error_with(&["p/b.png", "no picture with the same stem"]);
}

#[test]
fn metrics_without_weights_are_an_error_by_name_and_listed_within_a_group() {
    let dir = folder();
    let run = |metrics| {
        let line = format!("metrics p/a.png t/a.png --metrics {metrics} --json");
        sharp_bench(dir.path(), &words(&line))
    };
    let key = "lpips[squeeze,v0.1]";
    run("lpips-squeeze").is_error_with(&[key, "--weights squeezenet1_1="]);
    let json = run("all").ends_with(0).json();
    let pair = &json["pairs"][0];
    let reason = pair["unavailable"][key].as_str().unwrap();
    assert!(reason.contains("weights fetch squeezenet1_1"), "{reason}");
    assert!(pair["scores"].get(key).is_none());
    assert!(json["mean"].get(key).is_none());
    assert!(json["mean"]["dists"].is_f64());
}

#[test]
fn bad_pictures_are_one_line_that_names_the_file() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    picture(0, 41, 30).save(at("wide.png")).unwrap();
    let png = std::fs::read(at("p/a.png")).unwrap();
    std::fs::write(at("truncated.png"), &png[..png.len() / 2]).unwrap();
    std::fs::write(at("empty.png"), b"").unwrap();
    std::fs::write(at("page.jpg"), b"<!DOCTYPE html><html></html>").unwrap();
    for (file, reason) in [
        ("wide.png", "41x30"),
        ("truncated.png", "truncated.png"),
        ("empty.png", "empty.png"),
        ("page.jpg", "HTML"),
        ("absent.png", "absent.png"),
    ] {
        let args = ["metrics", file, "t/a.png", "--metrics", "psnr"];
        sharp_bench(dir.path(), &args).is_error_with(&[file, reason]);
    }
    let args = ["metrics", "p", "t/a.png"];
    sharp_bench(dir.path(), &args).is_error_with(&["two pictures or two folders"]);
    let args = ["metrics", "absent", "t"];
    sharp_bench(dir.path(), &args).is_error_with(&["absent: does not exist"]);
}

#[test]
fn usage_errors_end_with_2_and_unknown_metrics_say_what_is_known() {
    let dir = folder();
    assert_eq!(sharp_bench(dir.path(), &["metrics", "p/a.png"]).code, 2);
    assert_eq!(sharp_bench(dir.path(), &["nonsense"]).code, 2);
    let args = words("metrics p/a.png t/a.png --metrics psnr,lpips[alex,v0.0]");
    sharp_bench(dir.path(), &args).is_usage_error_with(&["v0.0"]);
}

#[test]
fn float_pictures_are_read_and_checked() {
    let dir = folder();
    let values: Vec<f32> = picture(0, 40, 30)
        .as_raw()
        .iter()
        .map(|&v| f32::from(v) / 255.0)
        .collect();
    let write = |name: &str, values: &[f32]| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view =
            safetensors::tensor::TensorView::new(safetensors::Dtype::F32, vec![30, 40, 3], &bytes)
                .unwrap();
        let file = safetensors::serialize([("image", view)], None).unwrap();
        std::fs::write(dir.path().join(name), file).unwrap();
    };
    write("good.safetensors", &values);
    let args = words("metrics good.safetensors p/a.png --metrics psnr --json");
    let json = sharp_bench(dir.path(), &args).ends_with(0).json();
    // f32(v / 255) differs from v / 255, so the score is finite, but higher than that of any real
    // prediction.
    let psnr = &json["pairs"][0]["scores"]["psnr"];
    assert!(psnr == "inf" || psnr.as_f64().unwrap() > 140.0, "{psnr}");

    let mut bad = values.clone();
    bad[17] = f32::NAN;
    write("nan.safetensors", &bad);
    bad[17] = 2.0;
    write("range.safetensors", &bad);
    for (file, reason) in [("nan.safetensors", "finite"), ("range.safetensors", "0..1")] {
        let args = ["metrics", file, "p/a.png", "--metrics", "psnr"];
        sharp_bench(dir.path(), &args).is_error_with(&[file, reason]);
    }
}
