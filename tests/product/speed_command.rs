//! `speed` and `report --methods-text`: what a paper reports in addition to its scores.

use std::path::Path;

use crate::support::{read, sharp_bench, words};

const DATA: [&str; 4] = [
    "--dataset",
    "S:synthetic=size=48x36,views=20",
    "--method",
    "depth-splat:resolution=64",
];

fn run(dir: &Path) {
    let more = words("run --method copy --metrics psnr --limit 2 --out r");
    sharp_bench(dir, &[&more[..], &DATA].concat()).ends_with(0);
}

#[test]
fn speed_measures_methods_apart_and_sums_up_runs() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir);
    let options = [
        "--limit", "2", "--warmup", "0", "--repeat", "3", "--out", "s", "--json",
    ];
    let args = [&["speed", "r", "--method", "mean"], &DATA[..], &options].concat();
    let json = sharp_bench(dir, &args).ends_with(0).json();
    let measured = json["measured"].as_array().unwrap();
    let of = |method: &str| {
        measured
            .iter()
            .find(|speed| speed["method"] == method)
            .unwrap()
    };
    let rounds = |method: &str, what: &str| of(method)[what].as_array().unwrap().len();
    let splat = "depth-splat";
    assert_eq!(
        (
            rounds(splat, "inference_secs"),
            rounds(splat, "render_secs")
        ),
        (6, 6)
    );
    assert_eq!(
        (
            rounds("mean", "inference_secs"),
            rounds("mean", "render_secs")
        ),
        (6, 0)
    );
    let drawn = &of(splat)["splats"][0];
    let number = |name: &str| drawn[name].as_u64().unwrap();
    assert!(number("visible") > 0 && number("visible") <= number("count"));
    assert!(number("tiles") >= number("visible") && number("picture_tiles") == 3 * 3);
    assert_eq!(of(splat)["sizes"], serde_json::json!([[48, 36]]));
    let hours = json["compute"]["rows"].as_array().unwrap();
    assert_eq!((hours.len(), &hours[2][5]), (3, &"4".into()));
    let md = read(dir.join("s/speed.md"));
    assert!(
        md.contains("## Compute") && md.contains("3 rounds of each pair"),
        "{md}"
    );
    assert!(read(dir.join("s/speed.csv")).contains("\ndepth-splat,S,synthetic,render_secs,6,"));

    sharp_bench(dir, &["speed", "--out", "s"]).ends_with(2);
    let none = [&["speed", "--repeat", "0", "--out", "s"], &DATA[..]].concat();
    sharp_bench(dir, &none).is_usage_error_with(&["--repeat"]);
    sharp_bench(dir, &["bundle", "r", "--out", "r.zip"]).ends_with(0);
    sharp_bench(dir, &["speed", "r.zip", "--out", "s"]).is_error_with(&["r.zip", "no times"]);
    std::fs::write(dir.join("speed.md"), "mine").unwrap();
    sharp_bench(dir, &["speed", "r", "--out", "."]).is_error_with(&["speed.md", "of another kind"]);
}

#[test]
fn a_run_describes_itself_for_a_paper() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir);
    let json = sharp_bench(dir, &["report", "r", "--methods-text", "--json"])
        .ends_with(0)
        .json();
    let latex = json["latex"].as_str().unwrap();
    let list = crate::support::read(dir.join("r/manifest.json"));
    let list: serde_json::Value = serde_json::from_str(&list).unwrap();
    let sha256 = list["pairs"]["sha256"].as_str().unwrap();
    for part in [
        "S ($n=2$, 48$\\times$36 pixels)",
        &sha256[..12],
        "\\texttt{psnr}",
        "depth-splat saw the true depth",
    ] {
        assert!(latex.contains(part), "{part}: {latex}");
    }
    sharp_bench(dir, &["report", "r", "--methods-text", "--out", "t"]).ends_with(0);
    assert!(read(dir.join("t/methods.tex")).ends_with(&format!("{latex}\n")));
    assert!(read(dir.join("t/methods.bib")).ends_with(json["bibtex"].as_str().unwrap()));
    assert!(!dir.join("r/report").exists());
    std::fs::create_dir(dir.join("u")).unwrap();
    std::fs::write(dir.join("u/methods.bib"), "mine").unwrap();
    sharp_bench(dir, &["report", "r", "--methods-text", "--out", "u"])
        .is_error_with(&["methods.bib", "of another kind"]);
    assert!(!dir.join("u/methods.tex").exists());
}
