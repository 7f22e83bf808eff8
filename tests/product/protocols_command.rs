//! Evaluations by other projects' protocols, from importing their pair list to the report.

use std::path::Path;

use serde_json::Value;

use crate::support::{Said, holds, read, sharp_bench, words};

const DATASET: &str = "S:synthetic=size=64x48,views=6,scenes=2";

fn run(dir: &Path, more: &[&str]) -> Said {
    sharp_bench(
        dir,
        &[&["run", "--dataset", DATASET, "--method", "copy"], more].concat(),
    )
}

/// Writes a list in the other project's format, with two targets for one source in each scene, and
/// imports it.
fn import(dir: &Path) {
    let line = format!("pairs --dataset {DATASET} --pair-options threshold=0");
    let args = words(&line);
    sharp_bench(dir, &[&args[..], &["--out", "all.csv"]].concat()).ends_with(0);
    let list = read(dir.join("all.csv"));
    let scenes: std::collections::BTreeSet<&str> = list
        .lines()
        .skip(1)
        .filter_map(|row| row.split(',').nth(2))
        .collect();
    let entries = scenes.iter();
    let entries = entries.map(|s| format!(r#""{s}": {{"context": [0, 3], "target": [1, 2]}}"#));
    let entries: Vec<String> = entries.collect();
    let theirs = format!("{{{}, \"gone\": null}}", entries.join(", "));
    std::fs::write(dir.join("theirs.json"), &theirs).unwrap();
    let import = ["pairs", "import", "theirs.json", "--form", "index"];
    let with = |more: &[&str]| sharp_bench(dir, &[&import[..], more].concat());
    let said = with(&["--dataset", DATASET, "--out", "pairs.csv", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(
        (&said["pairs"], &said["counts"]["entries"]),
        (&Value::from(4), &Value::from(3))
    );
    with(&["--dataset", DATASET, "--out", "theirs.json"])
        .is_error_with(&["theirs.json", "not overwritten"]);
}

/// A method's score on the first pair.
fn scored(dir: &Path, folder: &str, method: &str, metric: &str) -> f64 {
    let mut rows = csv::Reader::from_path(dir.join(folder).join("scores.csv")).unwrap();
    let column = rows
        .headers()
        .unwrap()
        .iter()
        .position(|name| name == metric)
        .unwrap();
    let mut of_method = rows
        .records()
        .map(Result::unwrap)
        .filter(|row| &row[5] == method);
    of_method.next().unwrap()[column].parse().unwrap()
}

#[test]
fn a_protocol_is_followed_recorded_and_not_mixed_with_others() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    import(dir);
    let with_list = |more: &[&str]| run(dir, &[&["--pairs", "pairs.csv"], more].concat());
    let unisharp = ["--protocol", "unisharp", "--method", "target", "--out", "u"];
    let said = with_list(&unisharp).ends_with(0);
    holds(&said.err, &["differs from unisharp: quantisation"]);
    let manifest: Value = serde_json::from_str(&read(dir.join("u/manifest.json"))).unwrap();
    assert_eq!(manifest["aggregation"], "sources");
    assert_eq!(manifest["rules"]["mask"], "source_bounds");
    assert_eq!(manifest["protocol"]["name"], "unisharp");
    let scores = read(dir.join("u/scores.csv"));
    let header = scores.lines().next().unwrap();
    for key in ["psnr[floor=1e-8]@mask", "ssim[gauss11,zero,eps=1e-8]@mask"] {
        assert!(header.contains(key), "{header}");
    }
    assert_eq!(scored(dir, "u", "target", "psnr[floor=1e-8]@mask"), 80.0);
    assert!(scored(dir, "u", "copy", "lpips[alex,v0.1,box-paste]@mask") > 0.0);
    sharp_bench(dir, &["report", "u"]).ends_with(0);
    let report = read(dir.join("u/report/report.md"));
    for part in [
        "mean of the source views' means",
        "1e-8 in SSIM's denominator",
        "5263322553d3e6eff405976dc900bc5de36b7ba8",
    ] {
        assert!(report.contains(part), "{part}");
    }
    // Metrics added later follow the same rules.
    sharp_bench(dir, &["score", "u", "--metrics", "psnr@mask"]).ends_with(0);
    with_list(&["--metrics", "psnr@mask", "--out", "plain"]).ends_with(0);
    let masked = |folder: &str| scored(dir, folder, "copy", "psnr@mask");
    assert_ne!(masked("u"), masked("plain"), "the masks differ");
    let join = ["report", "plain", "u", "--out", "both"];
    sharp_bench(dir, &join).is_error_with(&["the protocol", "unisharp"]);
    let again = with_list(&["--metrics", "psnr@mask", "--out", "u"]);
    again.is_error_with(&["the protocol", "unisharp", "choose another folder"]);
    // A mean that differs from that of the runs' tables is reported.
    let compared = sharp_bench(dir, &["compare", "u", "u"]).ends_with(0);
    let note = "the runs' own tables use the mean of the source views' means";
    assert!(compared.err.contains(note), "{}", compared.err);
    // A report can be requested with other means.
    let over = ["report", "plain", "--aggregate", "scenes", "--out", "over"];
    sharp_bench(dir, &over).ends_with(0);
    assert!(read(dir.join("over/report.md")).contains("mean of the scenes' means"));
}

#[test]
fn pictures_are_seen_at_the_protocols_size() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    import(dir);
    let framed = format!("{DATASET},frame=cover:32x32:lanczos");
    let args = format!(
        "run --dataset {framed} --pairs pairs.csv --metrics psnr --method copy --method target --out r"
    );
    sharp_bench(dir, &words(&args)).ends_with(0);
    let manifest: Value = serde_json::from_str(&read(dir.join("r/manifest.json"))).unwrap();
    // Settings are printed in alphabetical order.
    let spec = "S:synthetic=scenes=2,size=64x48,views=6,frame=cover:32x32:lanczos";
    assert_eq!(manifest["datasets"][0]["spec"], spec);
    let mut sizes = walk(&dir.join("r"));
    sizes.dedup();
    assert_eq!(sizes, [(32, 32)]);
    // The dataset is opened with the same settings for the report's pictures and for further
    // metrics.
    sharp_bench(dir, &["score", "r", "--metrics", "ssim"]).ends_with(0);
    sharp_bench(dir, &["report", "r"]).ends_with(0);
    // 64x48 is too small for 256x256.
    run(
        dir,
        &words("--protocol pixelsplat --pairs pairs.csv --out p"),
    )
    .is_error_with(&["frame=cover:256x256", "64x48"]);
    run(dir, &["--protocol", "pixelsplat", "--out", "p"])
        .is_usage_error_with(&["pixelsplat needs --pairs", "pairs import"]);
    run(dir, &["--protocol", "bogus", "--out", "p"]).is_usage_error_with(&["no protocol 'bogus'"]);
    let list = sharp_bench(dir, &["protocols", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(list.as_array().unwrap().len(), 15);
    let one = sharp_bench(dir, &["protocols", "lvsm"]).ends_with(0);
    holds(&one.out, &["bfloat16", "cover8:256x256:lanczos"]);
}

/// Sizes of all predicted pictures below a folder.
fn walk(folder: &Path) -> Vec<(u32, u32)> {
    let mut sizes = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sizes.extend(walk(&path));
        } else if path.extension().is_some_and(|e| e == "png") {
            sizes.push(image::image_dimensions(&path).unwrap());
        }
    }
    sizes
}
