//! Datasets in which something is broken or missing: standard error, the manifest, the page and the
//! exit code report what is left out, and nothing else is affected.

use std::path::Path;

use serde_json::{Value, json};

use crate::support::{Said, read, sharp_bench};

/// Scenes of Middlebury's layout, 12 by 8 pixels each.
pub(crate) fn middlebury(folder: &Path, scenes: &[&str]) {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fuzz/datasets/middlebury/A");
    for scene in scenes {
        let target = folder.join("set").join(scene);
        std::fs::create_dir_all(&target).unwrap();
        for file in ["im0.png", "im1.png", "calib.txt", "disp0.pfm"] {
            std::fs::copy(source.join(file), target.join(file)).unwrap();
        }
    }
}

fn with_dataset(folder: &Path, command: &[&str], more: &[&str]) -> Said {
    let dataset = ["--dataset", "M:middlebury=set"];
    sharp_bench(folder, &[command, &dataset, more].concat())
}

fn run(folder: &Path, more: &[&str]) -> Said {
    let command = ["run", "--method", "copy", "--metrics", "psnr", "--out", "r"];
    with_dataset(folder, &command, more)
}

fn left_out(folder: &Path) -> Value {
    let manifest: Value = serde_json::from_str(&read(folder.join("r/manifest.json"))).unwrap();
    manifest["datasets"][0]["left_out"].clone()
}

#[test]
fn a_broken_scene_is_skipped_with_its_reason_and_can_be_avoided() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    middlebury(dir, &["A", "B", "C"]);
    run(dir, &[]).ends_with(0);
    assert_eq!(left_out(dir), Value::Null);
    std::fs::remove_file(dir.join("set/B/im1.png")).unwrap();
    std::fs::write(dir.join("set/C/calib.txt"), "cam0=[1 2 3]").unwrap();
    std::fs::remove_dir_all(dir.join("r")).unwrap();

    let said = run(dir, &[]).ends_with(4);
    let reasons = [
        "set/B: there is no im1.png",
        "set/C/calib.txt: cam0 has 3 entries instead of 9",
    ];
    for (scene, reason) in ["B", "C"].iter().zip(reasons) {
        let line = format!("warning: M: 1 scene left out ({scene}): {reason}");
        assert!(said.err.contains(&line), "{}", said.err);
    }
    let group = |scene: &str, reason: &str| json!({"reason": reason, "by_choice": false, "scenes": [scene]});
    let groups = json!([group("B", reasons[0]), group("C", reasons[1])]);
    assert_eq!(left_out(dir), groups);
    let scores = read(dir.join("r/scores.csv"));
    assert_eq!(scores.lines().count(), 2, "{scores}");
    sharp_bench(dir, &["report", "r"]).ends_with(0);
    let page = read(dir.join("r/report/index.html"));
    assert!(reasons.iter().all(|reason| page.contains(reason)));

    // Every command that reads the scenes reports it.
    with_dataset(dir, &["pairs", "--out", "p.csv"], &[]).ends_with(4);
    with_dataset(dir, &["cameras", "export", "--out", "c"], &[]).ends_with(4);
    let check = sharp_bench(dir, &["datasets", "check", "middlebury=set"]).ends_with(4);
    for part in [
        "BROKEN 1 scene left out (B): set/B",
        "2 scenes unreadable; problems: 2",
    ] {
        assert!(check.out.contains(part), "{}", check.out);
    }

    let said = run(dir, &["--scenes", "A"]).ends_with(0);
    let line = "note: M: 2 scenes left out (B, C): --scenes A";
    assert!(
        said.err.contains(line) && !said.err.contains("warning"),
        "{}",
        said.err
    );
    let ruled_out = json!([{"reason": "--scenes A", "by_choice": true, "scenes": ["B", "C"]}]);
    assert_eq!(left_out(dir), ruled_out);
    with_dataset(dir, &["pairs", "--out", "p.csv"], &["--scenes", "A"]).ends_with(0);
    // If no scene can be read, the first fault is the error.
    run(dir, &["--scenes", "C"]).is_error_with(&[reasons[1]]);
    run(dir, &["--scenes", "D"]).is_error_with(&["no scene matches --scenes D"]);
}

#[test]
fn a_list_with_a_broken_scene_is_evaluated_without_it_and_completed_later() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    middlebury(dir, &["A", "B"]);
    with_dataset(dir, &["pairs", "--out", "p.csv"], &[]).ends_with(0);
    let calibration = read(dir.join("set/B/calib.txt"));
    std::fs::write(dir.join("set/B/calib.txt"), "").unwrap();
    let said = run(dir, &["--pairs", "p.csv"]).ends_with(4);
    for part in [
        "(B): set/B/calib.txt",
        "1 of the 2 pairs in the list are not evaluated",
    ] {
        assert!(said.err.contains(part), "{}", said.err);
    }
    assert_eq!(read(dir.join("r/scores.csv")).lines().count(), 2);
    // The broken scene does not prevent scoring the others again either.
    let score = || {
        sharp_bench(
            dir,
            &["score", "r", "--metrics", "psnr,ssim-uniform7-sample"],
        )
    };
    score().ends_with(0);
    std::fs::write(dir.join("set/B/calib.txt"), calibration).unwrap();
    run(dir, &["--pairs", "p.csv"]).ends_with(0);
    assert_eq!(read(dir.join("r/scores.csv")).lines().count(), 3);
    assert_eq!(read(dir.join("r/pairs.csv")), read(dir.join("p.csv")));
    std::fs::write(dir.join("set/B/calib.txt"), "").unwrap();
    let said = score().ends_with(4);
    assert!(said.err.contains("(B): set/B/calib.txt"), "{}", said.err);
}

#[test]
fn of_two_rectifications_one_counts_and_a_list_that_names_the_other_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    middlebury(dir, &["A-perfect", "A-imperfect"]);
    let said = run(dir, &[]).ends_with(0);
    let line = "note: M: 1 scene left out (A-imperfect): rectification=one";
    assert!(said.err.contains(line), "{}", said.err);
    assert_eq!(left_out(dir)[0]["by_choice"], true);
    assert_eq!(read(dir.join("r/scores.csv")).lines().count(), 2);
    let both = "M:middlebury=set,rectification=any";
    let list = ["pairs", "--dataset", both, "--out", "p.csv"];
    sharp_bench(dir, &list).ends_with(0);
    let refused = [
        "p.csv:2",
        "'A-imperfect'",
        "excluded: rectification=one",
        "any reads both",
    ];
    run(dir, &["--pairs", "p.csv"]).is_error_with(&refused);
}
