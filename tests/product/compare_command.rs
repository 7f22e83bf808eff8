//! Two runs, pair by pair.

use std::path::Path;

use crate::support::{Said, sharp_bench};

const DATASET: &str = "S:synthetic=size=96x72,views=20";

fn run(dir: &Path, out: &str, limit: &str, method: &str) {
    let args = [
        "run",
        "--dataset",
        DATASET,
        "--limit",
        limit,
        "--metrics",
        "psnr,ssim-gauss11-valid",
    ];
    let args = [&args[..], &["--method", method, "--out", out]].concat();
    sharp_bench(dir, &args).ends_with(0);
}

fn compare(dir: &Path, args: &[&str]) -> Said {
    sharp_bench(dir, &[&["compare"], args].concat())
}

#[test]
fn runs_are_compared_by_pair_and_unlike_ones_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir, "a", "4", "copy");
    run(dir, "again", "4", "copy");
    run(dir, "b", "4", "depth-splat:resolution=64");
    run(dir, "other", "3", "copy");

    // The same thing twice.
    let same = compare(dir, &["a", "again", "--json"]).ends_with(0).json();
    assert_eq!(
        (&same["schema"], &same["a"], &same["b"]),
        (&1.into(), &"a".into(), &"again".into())
    );
    let rows = same["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2);
    for row in rows {
        assert_eq!(
            (&row["verdict"], &row["difference"]),
            (&"none".into(), &0.0.into())
        );
        assert_eq!(
            (&row["p"], &row["n_pairs"], &row["dataset"]),
            (&1.0.into(), &4.into(), &"S".into())
        );
    }

    // Other methods: their only ones, or named ones of one folder.
    let json = compare(dir, &["a", "b", "--json"]).ends_with(0).json();
    let psnr = &json["rows"][0];
    assert_eq!(
        (&psnr["metric"], &psnr["method_a"], &psnr["method_b"]),
        (&"psnr".into(), &"copy".into(), &"depth-splat".into())
    );
    let number = |name: &str| psnr[name].as_f64().unwrap();
    assert!((number("mean_b") - number("mean_a") - number("difference")).abs() < 1e-9);
    let shown = compare(dir, &["a", "b"]).ends_with(0).out;
    assert!(shown.contains("psnr: copy (A), depth-splat (B)"), "{shown}");
    assert!(shown.contains("one scene does not show"), "{shown}");
    sharp_bench(dir, &["merge", "a", "b", "--out", "both"]).ends_with(0);
    let within = compare(dir, &["both", "--method", "copy=depth-splat", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(within["rows"], json["rows"]);
    // A bundle stands for its run.
    sharp_bench(dir, &["bundle", "a", "--out", "a.zip"]).ends_with(0);
    let bundled = compare(dir, &["a.zip", "b", "--json"]).ends_with(0).json();
    assert_eq!(bundled["rows"], json["rows"]);

    // What cannot be compared.
    compare(dir, &["a", "other"]).is_error_with(&["a and other cannot be compared", "only in A"]);
    compare(dir, &["a", "absent"]).is_error_with(&["absent"]);
    compare(dir, &["a"]).is_usage_error_with(&["--method OLD=NEW"]);
    compare(dir, &["both", "a", "--method", "mean=copy"])
        .is_usage_error_with(&["--method mean=copy", "run A has copy, depth-splat"]);
    let manifest = std::fs::read_to_string(dir.join("b/manifest.json")).unwrap();
    assert!(manifest.contains("\"eps2d\": 0.0"), "{manifest}");
    std::fs::write(
        dir.join("b/manifest.json"),
        manifest.replace("\"eps2d\": 0.0", "\"eps2d\": 0.3"),
    )
    .unwrap();
    compare(dir, &["a", "b"]).is_error_with(&["eps2d is \"0\" in one and \"0.3\" in the other"]);
}
