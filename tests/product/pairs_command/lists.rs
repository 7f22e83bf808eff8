//! Lists: why they are empty, how they report their choices, comparison and verification.

use super::*;

#[test]
fn lists_are_compared() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "a.csv", &[]).ends_with(0);
    build(dir.path(), "b.csv", &["--pair-options", "threshold=0.8"]).ends_with(0);
    let diff = |b: &str, more: &[&str]| {
        sharp_bench(
            dir.path(),
            &[&["pairs", "diff", "a.csv", b][..], more].concat(),
        )
    };
    let same = diff("a.csv", &["--json"]).ends_with(0).json();
    assert_eq!(same["same"], true);
    assert_eq!(same["equal"], same["first"]["pairs"]);

    let json = diff("b.csv", &["--json"]).ends_with(4).json();
    let (a, b) = (&json["first"]["pairs"], &json["second"]["pairs"]);
    assert!(b.as_u64() < a.as_u64(), "{json}");
    assert_eq!(json["only_second"].as_array().unwrap().len(), 0);
    let gone = json["only_first"].as_array().unwrap().len() as u64;
    assert_eq!(a.as_u64().unwrap() - gone, json["equal"].as_u64().unwrap());

    let list = read(dir.path().join("a.csv"));
    std::fs::write(
        dir.path().join("c.csv"),
        list.replacen(",true\n", ",false\n", 1),
    )
    .unwrap();
    let json = diff("c.csv", &["--json"]).ends_with(4).json();
    assert_eq!(json["changed"].as_array().unwrap().len(), 1);
    assert_eq!(
        json["changed"][0]["columns"]["selected"],
        serde_json::json!(["true", "false"])
    );
    let said = diff("c.csv", &[]).ends_with(4);
    assert!(said.out.contains("selected true -> false"), "{}", said.out);
    assert!(said.out.contains("1 different"), "{}", said.out);

    diff("nowhere.csv", &[]).is_error_with(&["nowhere.csv"]);
    std::fs::write(dir.path().join("d.csv"), "pair_id\nx\n").unwrap();
    diff("d.csv", &[]).is_error_with(&["d.csv:1", "columns"]);
}

#[test]
fn lists_are_verified_against_files() {
    let dir = tempfile::tempdir().unwrap();
    let data = sharp_datasets::bundled::extract(&dir.path().join("data")).unwrap();
    let dataset = format!("M:middlebury={}", data.display());
    let build = ["pairs", "--dataset", &dataset, "--out", "p.csv"];
    sharp_bench(dir.path(), &build).ends_with(0);
    let verify = |more: &[&str]| {
        let args = ["pairs", "verify", "p.csv", "--dataset", &dataset];
        sharp_bench(dir.path(), &[&args[..], more].concat())
    };
    let json = verify(&["--json"]).ends_with(0).json();
    assert_eq!(json["good"], true);
    assert_eq!(json["photographs"], 2);
    assert_eq!(json["equal"], 2);

    // Change a photograph and a calibration, which `pairs verify` must report.
    let picture = find(&data, "im1.png");
    let mut image = image::open(&picture).unwrap().to_rgb8();
    image.put_pixel(0, 0, image::Rgb([1, 2, 3]));
    image.save(&picture).unwrap();
    let calibration = find(&data, "calib.txt");
    let text = read(&calibration);
    let baseline = text.lines().find(|l| l.starts_with("baseline=")).unwrap();
    std::fs::write(&calibration, text.replace(baseline, "baseline=200")).unwrap();
    let json = verify(&["--json"]).ends_with(4).json();
    assert_eq!(json["good"], false);
    assert_eq!(json["different"][0]["view"], "im1");
    assert_eq!(json["different"].as_array().unwrap().len(), 1);
    assert_eq!(json["moved"][0]["baseline_m"][1], 0.2);
    let said = verify(&[]).ends_with(4);
    assert!(
        said.out.contains("different photograph: M/"),
        "{}",
        said.out
    );
    assert!(said.out.contains("different cameras: M/"), "{}", said.out);

    // Missing data is reported, but does not stop the command.
    let other = ["pairs", "verify", "p.csv", "--dataset", SYNTHETIC, "--json"];
    let json = sharp_bench(dir.path(), &other).ends_with(4).json();
    assert_eq!(json["absent"][0], "dataset 'M' is not given (given: S)");
}

#[test]
fn a_list_of_other_cameras_is_not_evaluated() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    build(dir, "p.csv", &["--pair-options", "limit=2"]).ends_with(0);
    let list = read(dir.join("p.csv"));
    let row: Vec<&str> = list.lines().nth(2).unwrap().split(',').collect();
    let run = |baseline: &str, rotation: &str| {
        let mut other = row.clone();
        (other[10], other[11]) = (baseline, rotation);
        let text = list.replace(&row.join(","), &other.join(","));
        std::fs::write(dir.join("q.csv"), text).unwrap();
        let run = ["run", "--dataset", SYNTHETIC, "--pairs", "q.csv", "--out"];
        let method = ["r", "--method", "copy", "--metrics", "psnr"];
        sharp_bench(dir, &[&run[..], &method].concat())
    };
    run("5", row[11]).is_error_with(&[
        "q.csv:3: the cameras in the files differ from those in the list for 1 pair, such as ",
        "but 5 m",
    ]);
    run(row[10], "179").is_error_with(&["q.csv:3", "179° in the list"]);
    run("5", "1e3").is_error_with(&["q.csv:3: rotation_deg is '1e3', not a number from 0 to 180"]);
    assert!(!dir.join("r").exists());
    let rounded = row[10].parse::<f64>().unwrap() + 1e-12;
    run(&rounded.to_string(), row[11]).ends_with(0);
}

#[test]
fn lists_of_others_are_counted_and_imported() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let list = r#"{"seed0": {"context": [4, 0], "target": [1, 2, 4, 2]}, "cup": null}"#;
    std::fs::write(dir.join("theirs.json"), list).unwrap();
    let import = |more: &[&str]| {
        let args = ["pairs", "import", "theirs.json", "--form", "index"];
        sharp_bench(dir, &[&args[..], more].concat())
    };
    let said = import(&[]).ends_with(0);
    assert_eq!(
        said.out,
        "2 scenes, 1 with targets: 4 targets in all, 1 of which are also inputs\n"
    );
    // A record of how an earlier list with this name was made does not apply to the new list.
    build(dir, "p.csv", &[]).ends_with(0);
    assert!(dir.join("p.csv.json").exists());
    let ours = ["--dataset", SYNTHETIC, "--out", "p.csv"];
    let said = import(&ours).ends_with(0);
    assert!(said.err.contains("repeats 1 pair"), "{}", said.err);
    assert_eq!(read(dir.join("p.csv")).lines().count(), 4);
    assert!(!dir.join("p.csv.json").exists());
    // A user's own file is kept.
    std::fs::write(dir.join("p.csv.json"), "{}").unwrap();
    import(&ours).ends_with(0);
    assert_eq!(read(dir.join("p.csv.json")), "{}");
    let empty = r#"{"seed0": {"context": [4, 0], "target": []}}"#;
    std::fs::write(dir.join("theirs.json"), empty).unwrap();
    import(&ours).is_error_with(&["theirs.json", "it has no targets"]);
}

#[test]
fn an_empty_list_says_why() {
    let dir = tempfile::tempdir().unwrap();
    let said = build(dir.path(), "p.csv", &["--pair-options", "threshold=2"]).ends_with(4);
    assert!(dir.path().join("p.csv").is_file());
    let warning = said
        .err
        .lines()
        .find(|line| line.starts_with("warning: S:"));
    let warning = warning.unwrap_or_else(|| panic!("{}", said.err));
    assert!(warning.contains("above threshold=2"), "{warning}");
    let more = ["--pair-options", "threshold=2", "--json"];
    let json = build(dir.path(), "p.csv", &more).ends_with(4).json();
    assert_eq!(json["warnings"].as_array().unwrap().len(), 1);
    let line = format!("run --dataset {SYNTHETIC} --method copy --metrics psnr");
    let run = words(&line);
    let run = [
        &run[..],
        &["--pair-options", "min-baseline=9", "--out", "r"],
    ]
    .concat();
    sharp_bench(dir.path(), &run).is_error_with(&["no pair to evaluate", "min-baseline=9"]);
    // If nothing is wrong, nothing is printed.
    let json = build(dir.path(), "p.csv", &["--json"]).ends_with(0).json();
    assert_eq!(json["warnings"].as_array().unwrap().len(), 0);
}

#[test]
fn choices_that_differ_from_the_paper_are_marked() {
    let dir = tempfile::tempdir().unwrap();
    let data = sharp_datasets::bundled::extract(&dir.path().join("data")).unwrap();
    let dataset = format!("M:middlebury={}", data.display());
    let run = |options: &str, out: &str| {
        let args = ["run", "--dataset", &dataset, "--pair-options", options];
        let more = ["--method", "copy", "--metrics", "psnr", "--out", out];
        sharp_bench(dir.path(), &[&args[..], &more].concat()).ends_with(0);
        sharp_bench(dir.path(), &["report", out]).ends_with(0);
        let manifest: serde_json::Value =
            serde_json::from_str(&read(dir.path().join(out).join("manifest.json"))).unwrap();
        let tables = dir.path().join(out).join("report");
        (
            manifest,
            read(find(&tables, "scores.md")),
            read(find(&tables, "report.md")),
        )
    };
    let (manifest, table, report) = run("min-baseline=0.001,seed=3", "a");
    let options = &manifest["pairs"]["lists"][0]["choices"]["M"]["options"];
    assert_eq!(options["min-baseline"], "0.001");
    assert!(table.contains("M<sup>a</sup><br>PSNR"), "{table}");
    assert!(table.contains("proxy of the paper's column"), "{table}");
    assert!(
        report.contains("| min-baseline | 0.001 (proxy: differs from the paper) |"),
        "{report}"
    );
    assert!(report.contains("| seed | 3 |"), "{report}");
    let (_, table, _) = run("seed=3", "b");
    assert!(table.contains("M<br>PSNR"), "{table}");

    build(dir.path(), "p.csv", &["--pair-options", "threshold=0.5"]).ends_with(0);
    let beside: serde_json::Value =
        serde_json::from_str(&read(dir.path().join("p.csv.json"))).unwrap();
    let choices = beside["choices"].as_object().unwrap().values().next();
    assert_eq!(choices.unwrap()["options"]["threshold"], "0.5");
}

/// A list as an editor on another system may store it.
#[test]
fn a_list_with_other_bytes_is_copied_as_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    build(dir, "p.csv", &["--pair-options", "limit=2"]).ends_with(0);
    let bytes = format!("\u{feff}{}", read(dir.join("p.csv")).replace('\n', "\r\n"));
    std::fs::write(dir.join("other.csv"), &bytes).unwrap();
    let run = || {
        let dataset = ["--dataset", SYNTHETIC, "--pairs", "other.csv", "--out", "r"];
        let method = ["run", "--method", "copy", "--metrics", "psnr", "--json"];
        sharp_bench(dir, &[&method[..], &dataset].concat())
            .ends_with(0)
            .json()
    };
    let hash = |name: &str| sharp_datasets::files::sha256(&dir.join(name)).unwrap();
    let pairs = run()["manifest"]["pairs"].clone();
    assert_eq!(pairs["sha256"], hash("r/pairs.csv"));
    assert_eq!(pairs["sha256"], hash("other.csv"));
    assert_eq!(pairs["lists"][0]["sha256"], hash("other.csv"));
    // A folder whose copy is in the list's own form, as written by earlier versions, can be
    // resumed.
    std::fs::copy(dir.join("p.csv"), dir.join("r/pairs.csv")).unwrap();
    let again = run();
    assert_eq!(
        (&again["reused"], &again["predicted"]),
        (&again["units"], &serde_json::json!(0))
    );
    assert_eq!(again["manifest"]["pairs"], pairs);
    assert_eq!(pairs["sha256"], hash("r/pairs.csv"));
    // An export copies the list unchanged, too.
    let line = format!("pairs export --pairs other.csv --dataset {SYNTHETIC} --out e --json");
    let export = words(&line);
    let export = sharp_bench(dir, &export).ends_with(0).json();
    assert_eq!(export["sha256"], hash("e/pairs.csv"));
}
