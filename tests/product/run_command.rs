//! `pairs`, `run` and `report`: whole runs, exact files, failures, restarts.

use std::path::Path;

use crate::support::{read, sharp_bench, words};

const DATASET: &str = "S:synthetic=size=96x72,views=20";

fn rows(path: &Path) -> Vec<Vec<String>> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .from_path(path)
        .unwrap();
    reader
        .records()
        .map(|row| row.unwrap().iter().map(str::to_owned).collect())
        .collect()
}

fn column(rows: &[Vec<String>], name: &str) -> usize {
    rows[0]
        .iter()
        .position(|c| c == name)
        .unwrap_or_else(|| panic!("no column {name}"))
}

fn run(dir: &Path, out: &str, more: &[&str]) -> crate::support::Said {
    let line =
        format!("run --dataset {DATASET} --limit 4 --metrics psnr,ssim-gauss11-valid --out {out}",);
    let mut args = words(&line);
    args.extend(more);
    sharp_bench(dir, &args)
}

#[test]
fn scores_have_the_promised_columns_and_the_target_is_perfect() {
    let dir = tempfile::tempdir().unwrap();
    let methods = words("--method target --method copy --method depth-splat");
    let line =
        format!("run --dataset {DATASET} --limit 4 --out r --metrics psnr,ssim-gauss11-valid");
    sharp_bench(dir.path(), &[words(&line), methods].concat()).ends_with(0);
    let rows = rows(&dir.path().join("r/scores.csv"));
    assert_eq!(
        rows[0][..13].join(","),
        "pair_id,dataset,scene,source,target,method,baseline_m,rotation_deg,median_depth_m,overlap,status,\
         psnr,\"ssim[gauss11,valid]\"".replace('"', "")
    );
    assert_eq!(rows.len(), 1 + 4 * 3);
    let (method, psnr, ssim) = (
        column(&rows, "method"),
        column(&rows, "psnr"),
        column(&rows, "ssim[gauss11,valid]"),
    );
    let mean = |label: &str| {
        let values: Vec<f64> = rows[1..]
            .iter()
            .filter(|row| row[method] == label)
            .map(|row| row[ssim].parse().unwrap())
            .collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    for row in rows[1..].iter().filter(|row| row[method] == "target") {
        assert_eq!((row[psnr].as_str(), row[ssim].as_str()), ("inf", "1"));
    }
    assert!(mean("depth-splat") > mean("copy"));
}

#[test]
fn a_failing_pair_is_recorded_and_the_others_go_on() {
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), "truth", &["--method", "target"]).ends_with(0);
    // External pictures, one of them missing and one with a wrong size.
    let pictures = dir.path().join("truth/predictions/target");
    let rows_of_truth = rows(&dir.path().join("truth/scores.csv"));
    let ids: Vec<&str> = rows_of_truth[1..]
        .iter()
        .map(|row| row[0].as_str())
        .collect();
    std::fs::remove_file(pictures.join(format!("{}.png", ids[0]))).unwrap();
    image::RgbImage::new(5, 5)
        .save(pictures.join(format!("{}.png", ids[1])))
        .unwrap();

    let import = [
        "--method",
        "imported:label=theirs,dir=truth/predictions/target",
    ];
    let said = run(dir.path(), "r", &import).ends_with(4);
    assert!(said.err.contains("2 of 4 units failed"), "{}", said.err);
    let rows = rows(&dir.path().join("r/scores.csv"));
    let (status, reason, psnr) = (
        column(&rows, "status"),
        column(&rows, "reason"),
        column(&rows, "psnr"),
    );
    let by_id = |id: &str| rows.iter().find(|row| row[0] == id).unwrap();
    assert_eq!(by_id(ids[0])[status], "failed");
    assert!(by_id(ids[0])[reason].contains("no picture"));
    assert!(by_id(ids[1])[reason].contains("5x5"));
    assert_eq!(by_id(ids[1])[psnr], "");
    assert_eq!(by_id(ids[2])[psnr], "inf");
    // The table shows n of N.
    let report = sharp_bench(dir.path(), &["report", "r"]).ends_with(0);
    assert!(report.out.contains("index.html"));
    assert!(read(dir.path().join("r/report/report.md")).contains("2/4"));

    // Corrected pictures are used; earlier successes are kept.
    std::fs::copy(
        pictures.join(format!("{}.png", ids[2])),
        pictures.join(format!("{}.png", ids[0])),
    )
    .unwrap();
    std::fs::copy(
        pictures.join(format!("{}.png", ids[2])),
        pictures.join(format!("{}.png", ids[1])),
    )
    .unwrap();
    let json = run(dir.path(), "r", &[&import[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    assert_eq!(json["reused"], 2);
    assert_eq!(json["failed"], 0);
}

#[test]
fn pair_lists_are_artifacts() {
    let dir = tempfile::tempdir().unwrap();
    let pairs = |out| {
        let args = ["pairs", "--dataset", DATASET, "--out", out, "--json"];
        sharp_bench(dir.path(), &args).ends_with(0).json()
    };
    let (a, b) = (pairs("a.csv"), pairs("b.csv"));
    assert_eq!(a["sha256"], b["sha256"]);
    let list = read(dir.path().join("a.csv"));
    assert!(list.starts_with(
        "pair_id,dataset,scene,set,source,target,source_file,target_file,source_sha256,target_sha256,baseline_m,\
         rotation_deg,median_depth_m,overlap,overlap_source_to_target,selected\n"
    ));
    let given = ["--pairs", "a.csv", "--method", "copy", "--json"];
    let json = run(dir.path(), "r", &given).ends_with(0).json();
    assert_eq!(json["manifest"]["pairs"]["sha256"], a["sha256"]);
    assert_eq!(json["manifest"]["pairs"]["lists"][0]["origin"], "given");

    // A list that names a view that does not exist is refused.
    let rows = rows(&dir.path().join("a.csv"));
    let (row, source) = (rows[1].join(","), &rows[1][4]);
    let elsewhere = row
        .replace(&format!("/{source}__"), "/nowhere__")
        .replace(&format!(",{source},"), ",nowhere,");
    assert_ne!(row, elsewhere);
    std::fs::write(dir.path().join("bad.csv"), list.replace(&row, &elsewhere)).unwrap();
    run(dir.path(), "s", &["--pairs", "bad.csv", "--method", "copy"])
        .is_error_with(&["bad.csv", "nowhere"]);
    assert!(!dir.path().join("s").exists());
}

#[test]
fn dry_runs_write_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let said = run(dir.path(), "r", &["--method", "copy", "--dry-run"]).ends_with(0);
    assert!(said.out.contains("units   4: 0 done"), "{}", said.out);
    // Only overlaps are written, to the user's cache, which is in this folder during tests.
    let found = std::fs::read_dir(dir.path()).unwrap();
    let found: Vec<_> = found.map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(found, [".cache"]);
}

#[test]
fn a_folder_grows_and_is_reported_joined_and_scored_again() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path();
    run(path, "r", &["--method", "copy", "--method", "mean"]).ends_with(0);
    run(path, "r", &["--method", "depth-splat:resolution=64"]).ends_with(0);
    let table = rows(&path.join("r/scores.csv"));
    let method = column(&table, "method");
    for label in ["copy", "mean", "depth-splat"] {
        let count = table[1..].iter().filter(|row| row[method] == label).count();
        assert_eq!(count, 4, "{label}");
    }
    let standing = run(path, "r", &["--method", "copy", "--dry-run", "--json"]).json();
    assert_eq!(standing["units"]["done"], 4);

    // Add another metric, from kept pictures.
    let json = sharp_bench(
        path,
        &["score", "r", "--metrics", "ssim-uniform7-sample", "--json"],
    )
    .ends_with(0)
    .json();
    assert_eq!(
        (&json["scored"], &json["not_kept"]),
        (&12.into(), &0.into())
    );
    let table = rows(&path.join("r/scores.csv"));
    let ssim = column(&table, "ssim[uniform7,sample]");
    assert!(table[1..].iter().all(|row| !row[ssim].is_empty()));

    // Join with other pairs and methods, renamed to avoid a collision.
    run(path, "more", &["--method", "copy"]).ends_with(0);
    let json = sharp_bench(path, &["merge", "r", "more", "--out", "all", "--json"])
        .ends_with(0)
        .json();
    assert_eq!((&json["units"], &json["missing"]), (&12.into(), &0.into()));
    assert_eq!(
        read(path.join("r/scores.csv")),
        read(path.join("all/scores.csv"))
    );
    let before = read(path.join("r/scores.csv"));
    std::fs::remove_file(path.join("r/scores.csv")).unwrap();
    sharp_bench(path, &["merge", "r"]).ends_with(0);
    assert_eq!(before, read(path.join("r/scores.csv")));
    sharp_bench(path, &["report", "old=more", "new=r", "--out", "both"]).ends_with(0);
    let report = read(path.join("both/report.md"));
    assert!(
        report.contains("| old |") && report.contains("| new/depth-splat |"),
        "{report}"
    );

    // A bundle can replace its folder, except for the pictures.
    sharp_bench(path, &["bundle", "r", "--out", "r.zip"]).ends_with(0);
    sharp_bench(path, &["bundle", "r", "--out", "r.zip"]).ends_with(0);
    sharp_bench(path, &["bundle", "r", "--out", "r/scores.csv"])
        .is_error_with(&["r/scores.csv", "not overwritten"]);
    sharp_bench(path, &["report", "r.zip"]).is_usage_error_with(&["--out"]);
    sharp_bench(path, &["report", "r", "--out", "of-folder"]).ends_with(0);
    sharp_bench(path, &["report", "r.zip", "--out", "of-bundle"]).ends_with(0);
    assert_eq!(
        read(path.join("of-folder/tables/scores.csv")),
        read(path.join("of-bundle/tables/scores.csv"))
    );
    sharp_bench(path, &["report", "r/scores.csv", "--out", "x"])
        .is_error_with(&["r/scores.csv", "not a bundle"]);

    // An unfinished run is reported with the results so far.
    let unit = std::fs::read_dir(path.join("more/units")).unwrap().next();
    std::fs::remove_dir_all(unit.unwrap().unwrap().path()).unwrap();
    let said = sharp_bench(path, &["report", "more"]).ends_with(0);
    assert!(said.err.contains("of 4 units are done"), "{}", said.err);
    assert!(read(path.join("more/report/report.md")).contains("has not ended"));
    sharp_bench(path, &["merge", "more"]).ends_with(75);

    // A folder of an earlier version.
    std::fs::create_dir(path.join("old")).unwrap();
    std::fs::write(path.join("old/manifest.json"), "{\"format\": 1}").unwrap();
    sharp_bench(path, &["report", "old"]).is_error_with(&["old", "format 1", "new folder"]);
}

#[test]
fn files_of_a_run_folder_follow_the_published_schema() {
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), "r", &["--method", "copy"]).ends_with(0);
    let json = |path: &Path| -> serde_json::Value { serde_json::from_str(&read(path)).unwrap() };
    let unit = std::fs::read_dir(dir.path().join("r/units"))
        .unwrap()
        .next();
    let unit = std::fs::read_dir(unit.unwrap().unwrap().path())
        .unwrap()
        .next();
    let unit = unit.unwrap().unwrap().path();
    for (name, path) in [
        ("manifest", dir.path().join("r/manifest.json")),
        ("plan", dir.path().join("r/plan.json")),
        ("unit", unit),
    ] {
        let schema = sharp_bench(dir.path(), &["schema", name])
            .ends_with(0)
            .json();
        let (known, found) = (&schema["properties"], json(&path));
        for key in found.as_object().unwrap().keys() {
            assert!(
                known.get(key).is_some(),
                "{name}: {key} is not in the schema"
            );
        }
        for key in schema["required"].as_array().unwrap() {
            let key = key.as_str().unwrap();
            assert!(found.get(key).is_some(), "{name}: {key} is required");
        }
    }
}

#[test]
fn what_cannot_work_is_one_line() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("full")).unwrap();
    std::fs::write(dir.path().join("full/thesis.tex"), b"x").unwrap();
    for (args, parts) in [
        (
            vec!["--method", "copy", "--method", "copy"],
            vec!["label 'copy' is taken"],
        ),
        (vec!["--method", "copy:speed=1"], vec!["speed"]),
        (
            vec!["--method", "copy", "--memory-limit", "4"],
            vec!["512M"],
        ),
    ] {
        run(dir.path(), "r", &args).is_usage_error_with(&parts);
    }
    let line = format!("run --dataset {DATASET} --method copy --limit -1 --out r");
    sharp_bench(dir.path(), &words(&line)).is_usage_error_with(&["--limit"]);
    run(dir.path(), "r", &["--method", "imported:dir=nowhere"]).is_error_with(&["nowhere"]);
    run(dir.path(), "r", &["--method", "magic"]).is_usage_error_with(&["magic", "depth-splat"]);
    run(dir.path(), "full", &["--method", "copy"]).is_error_with(&["full", "other files"]);
    let unknown = words("run --dataset moonbase=x --method copy --out r");
    sharp_bench(dir.path(), &unknown).is_usage_error_with(&["moonbase", "middlebury"]);
    let absent = words("run --dataset middlebury=nowhere --method copy --out r");
    sharp_bench(dir.path(), &absent).is_error_with(&["nowhere"]);
    sharp_bench(dir.path(), &["report", "nowhere"]).is_error_with(&["nowhere", "manifest.json"]);
}

#[test]
fn an_estimate_and_a_count_write_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let line = format!("run --dataset {DATASET} --method copy --method depth-splat:resolution=256");
    let args = words(&line);
    let with = |more: &[&str]| sharp_bench(dir.path(), &[&args[..], more].concat());
    let count = with(&["--dry-run", "--json"]).ends_with(0).json();
    assert_eq!(count["units"]["missing"], count["units"]["units"]);
    let estimate = with(&["--estimate", "--json", "--metrics", "psnr"])
        .ends_with(0)
        .json();
    assert_eq!(estimate["units"], count["units"]["units"]);
    // Two pairs from each of three sources.
    assert_eq!(estimate["measured_pairs"], 6);
    assert_eq!(estimate["measured_failures"], 0);
    for field in ["cpu_secs", "wall_secs", "disk_bytes"] {
        assert!(estimate[field].as_f64().unwrap() > 0.0, "{field}");
    }
    let words = with(&["--estimate", "--metrics", "psnr"]).ends_with(0).out;
    assert!(words.contains("CPU") && words.contains("memory"), "{words}");
    let left = std::fs::read_dir(dir.path()).unwrap();
    let left: Vec<_> = left.flatten().map(|entry| entry.file_name()).collect();
    assert!(left.iter().all(|name| name == ".cache"), "{left:?}");
    assert_eq!(with(&[]).code, 2);
}

#[test]
fn what_the_paper_leaves_unsaid_about_renderings_is_a_recorded_choice() {
    let dir = tempfile::tempdir().unwrap();
    let splat = |out: &str, more: &[&str]| {
        let method = ["--method", "depth-splat"];
        run(dir.path(), out, &[&method[..], more].concat())
    };
    let scores = |out: &str| {
        let rows = rows(&dir.path().join(out).join("scores.csv"));
        let psnr = column(&rows, "psnr");
        rows[1..]
            .iter()
            .map(|row| row[psnr].clone())
            .collect::<Vec<_>>()
    };
    splat("r", &[]).ends_with(0);
    for (out, option, value, recorded) in [
        ("eps2d", "--eps2d", "gsplat", "\"eps2d\": 0.3"),
        (
            "background",
            "--background",
            "white",
            "\"background\": \"white\"",
        ),
        (
            "quantise",
            "--quantise",
            "truncate",
            "\"quantization\": \"truncate\"",
        ),
    ] {
        splat(out, &[option, value]).ends_with(0);
        let manifest = read(dir.path().join(out).join("manifest.json"));
        assert!(manifest.contains(recorded), "{manifest}");
        assert_ne!(scores(out), scores("r"), "{option}");
        // A folder has only one value for each choice.
        splat("r", &[option, value]).is_error_with(&["r:", "renderer"]);
    }
}

#[cfg(unix)]
#[test]
fn what_never_ends_is_no_input() {
    let dir = tempfile::tempdir().unwrap();
    for args in [
        &["weights", "check", "/dev/zero"][..],
        &["gaussians", "info", "/dev/zero"],
        &["render", "/dev/zero", "--out", "x.png"],
    ] {
        sharp_bench(dir.path(), args).is_error_with(&["/dev/zero"]);
    }
    let method = ["--method", "sharp:checkpoint=/dev/zero"];
    run(dir.path(), "r", &method).is_error_with(&["/dev/zero", "not a regular file"]);
}

#[test]
fn a_run_is_repeated_from_its_own_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path();
    for folder in ["study/mine/synthetic/seed0", "elsewhere"] {
        std::fs::create_dir_all(path.join(folder)).unwrap();
    }
    let study = "\
        dataset = [\"synthetic=size=48x36,views=6\"]\n\
        method = [\"copy\", \"command:label=program,run='sh my.sh'\"]\n\
        metrics = \"psnr\"\n\
        pair-options = \"order=once\"\n\
        limit = 5\n";
    std::fs::write(path.join("study/study.toml"), study).unwrap();
    let program = "while read -r line; do
      to=$(echo \"$line\" | sed 's/.*\"write_to\": *\"\\([^\"]*\\)\".*/\\1/')
      id=$(echo \"$line\" | sed 's/.*\"pair_id\": *\"\\([^\"]*\\)\".*/\\1/')
      cp \"$(dirname \"$to\")/source.png\" \"$to\"; echo \"{\\\"pair_id\\\":\\\"$id\\\"}\"
    done";
    std::fs::write(path.join("study/my.sh"), program).unwrap();
    let args = words("run --config study/study.toml --limit 3 --out r");
    sharp_bench(path, &args).ends_with(0);
    let scores = read(path.join("r/scores.csv"));
    assert_eq!(scores.lines().count(), 1 + 3 * 2, "{scores}");
    let file = "../r/run.toml";
    let args = ["run", "--config", file, "--out", "../again"];
    sharp_bench(&path.join("elsewhere"), &args).ends_with(0);
    assert_eq!(read(path.join("again/scores.csv")), scores);
    assert_eq!(
        read(path.join("again/run.toml")),
        read(path.join("r/run.toml"))
    );
    for (file, part) in [
        ("limits = 3", "'limits'"),
        ("method = [\"copy\"]", "no dataset"),
    ] {
        std::fs::write(path.join("wrong.toml"), file).unwrap();
        let said = sharp_bench(path, &["run", "--config", "wrong.toml", "--out", "w"]);
        assert!(said.code > 0 && said.err.contains(part), "{}", said.err);
    }
    sharp_bench(path, &["run", "--dataset", "synthetic", "--out", "w"])
        .is_usage_error_with(&["no method"]);
    // The given list may change; the folder has its own copy.
    std::fs::copy(path.join("r/pairs.csv"), path.join("list.csv")).unwrap();
    let study = ["run", "--config", "study/study.toml"];
    sharp_bench(
        path,
        &[&study[..], &["--pairs", "list.csv", "--out", "w"]].concat(),
    )
    .is_usage_error_with(&["pairs and pair-options"]);
    let listed = words("run --dataset synthetic=size=48x36,views=6 --method copy --metrics psnr");
    sharp_bench(
        path,
        &[
            &listed[..],
            &["--pairs", "list.csv", "--limit", "2", "--out", "l"],
        ]
        .concat(),
    )
    .ends_with(0);
    std::fs::write(path.join("list.csv"), "").unwrap();
    sharp_bench(path, &["run", "--config", "l/run.toml", "--out", "l2"]).ends_with(0);
    assert_eq!(
        read(path.join("l2/scores.csv")),
        read(path.join("l/scores.csv"))
    );
}
