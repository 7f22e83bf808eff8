//! `pairs diff`, `pairs verify`, `pairs export`, `cameras export`.

use std::path::{Path, PathBuf};

use sharp_bench::exchange::camera_file::CameraFile;
use sharp_datasets::DatasetSpec;

use crate::support::{Said, read, sharp_bench};

const SYNTHETIC: &str = "S:synthetic=size=96x72,views=12";

fn build(dir: &Path, out: &str, more: &[&str]) -> Said {
    let args = ["pairs", "--dataset", SYNTHETIC, "--out", out];
    sharp_bench(dir, &[&args[..], more].concat())
}

fn modified(path: &Path) -> std::time::SystemTime {
    std::fs::metadata(path).unwrap().modified().unwrap()
}

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

    // Another photograph, and a calibration of another day.
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
    assert!(said.out.contains("another photograph: M/"), "{}", said.out);
    assert!(said.out.contains("other cameras: M/"), "{}", said.out);

    // What is not there is named, and is no reason to stop.
    let other = ["pairs", "verify", "p.csv", "--dataset", SYNTHETIC, "--json"];
    let json = sharp_bench(dir.path(), &other).ends_with(4).json();
    assert_eq!(json["absent"][0], "dataset 'M' is not given; given: S");
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

#[test]
fn exported_pairs_are_what_is_scored() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "p.csv", &[]).ends_with(0);
    let export = |more: &[&str]| {
        let args = [
            "pairs",
            "export",
            "--pairs",
            "p.csv",
            "--dataset",
            SYNTHETIC,
            "--limit",
            "3",
            "--out",
            "e",
            "--json",
        ];
        sharp_bench(dir.path(), &[&args[..], more].concat())
    };
    let json = export(&[]).ends_with(0).json();
    assert_eq!((&json["written"], &json["kept"]), (&3.into(), &0.into()));
    let list = read(dir.path().join("p.csv"));
    let id = list.lines().nth(1).unwrap().split(',').next().unwrap();
    let folder = dir.path().join("e").join(id);
    let pair: serde_json::Value = serde_json::from_str(&read(folder.join("pair.json"))).unwrap();
    assert_eq!(pair["pair_id"], id);
    assert_eq!(pair["prediction"]["file"], format!("{id}.png"));
    assert_eq!(pair["prediction"]["width"], 96);
    for (key, n) in [("K_s", 9), ("K_t", 9), ("target_from_source", 16)] {
        assert_eq!(pair[key].as_array().unwrap().len(), n, "{key}");
    }
    assert!(
        pair["conventions"]["pixels"]
            .as_str()
            .unwrap()
            .contains("0.5")
    );
    assert!(!folder.join("target.png").exists());

    // The exported source, handed back, is what `copy` predicts.
    let predictions = dir.path().join("predictions");
    for line in list.lines().skip(1).take(3) {
        let id = line.split(',').next().unwrap();
        let to = predictions.join(format!("{id}.png"));
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(dir.path().join("e").join(id).join("source.png"), to).unwrap();
    }
    let run = [
        "run",
        "--dataset",
        SYNTHETIC,
        "--pairs",
        "p.csv",
        "--limit",
        "3",
        "--metrics",
        "psnr",
        "--method",
        "copy",
        "--method",
        "imported:label=mine,dir=predictions",
        "--out",
        "r",
    ];
    sharp_bench(dir.path(), &run).ends_with(0);
    let scores = read(dir.path().join("r/scores.csv"));
    let psnr = |method: &str| -> Vec<&str> {
        let rows = scores.lines().filter(|l| l.contains(method));
        rows.map(|l| l.split(',').nth(11).unwrap()).collect()
    };
    assert_eq!(psnr(",copy,"), psnr(",mine,"));
    assert_eq!(psnr(",mine,").len(), 3);

    // Again: nothing to do. More asked for, or a file damaged: done anew.
    assert_eq!(export(&[]).ends_with(0).json()["kept"], 3);
    let before = modified(&folder.join("pair.json"));
    std::fs::write(folder.join("source.png"), b"half").unwrap();
    let json = export(&[]).ends_with(0).json();
    assert_eq!((&json["written"], &json["kept"]), (&1.into(), &2.into()));
    assert!(modified(&folder.join("pair.json")) >= before);
    image::open(folder.join("source.png")).unwrap();
    let json = export(&["--with", "target,depth"]).ends_with(0).json();
    assert_eq!(json["written"], 3);
    for name in ["target.png", "source_depth.npy", "target_depth.npy"] {
        assert!(folder.join(name).is_file(), "{name}");
    }
    let depth = sharp_datasets::format::npy::read(&folder.join("target_depth.npy")).unwrap();
    assert_eq!(depth.dimensions(), (96, 72));
    // No stray files of an interrupted write.
    for entry in std::fs::read_dir(&folder).unwrap() {
        let name = entry.unwrap().file_name();
        assert!(!name.to_string_lossy().starts_with('.'), "{name:?}");
    }
}

#[test]
fn exports_that_cannot_work_say_why() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "p.csv", &["--pair-options", "limit=0"]).ends_with(4);
    let export = |dataset: &str, out: &str| {
        let args = [
            "pairs",
            "export",
            "--pairs",
            "p.csv",
            "--dataset",
            dataset,
            "--out",
            out,
        ];
        sharp_bench(dir.path(), &args)
    };
    export(SYNTHETIC, "e").is_error_with(&["p.csv", "selected", "--all"]);
    export("T:synthetic=size=96x72,views=12", "e").is_error_with(&["p.csv:2", "'S'"]);
    std::fs::write(dir.path().join("file"), b"x").unwrap();
    build(dir.path(), "p.csv", &[]).ends_with(0);
    export(SYNTHETIC, "file").is_error_with(&["file"]);
    assert!(!dir.path().join("e").exists());
}

#[test]
fn views_are_exported_with_their_cameras() {
    let dir = tempfile::tempdir().unwrap();
    let args = [
        "cameras",
        "export",
        "--dataset",
        SYNTHETIC,
        "--out",
        "v",
        "--json",
    ];
    let json = sharp_bench(dir.path(), &args).ends_with(0).json();
    assert_eq!((&json["views"], &json["written"]), (&12.into(), &12.into()));
    assert_eq!(sharp_bench(dir.path(), &args).json()["kept"], 12);
    let scene = DatasetSpec::parse(SYNTHETIC).unwrap();
    let scene = sharp_datasets::open(&scene).unwrap().remove(0);
    for view in &scene.views {
        let path = find(&dir.path().join("v/S"), &format!("{}.json", view.id));
        let camera: serde_json::Value = serde_json::from_str(&read(&path)).unwrap();
        assert!(!camera["conventions"].is_null());
        // What `render --camera` reads.
        let (intrinsics, camera_from_world) = CameraFile::read(&path).unwrap();
        assert_eq!(intrinsics, view.intrinsics);
        assert_eq!(camera_from_world, view.camera_from_world.to_affine());
    }
}

#[test]
fn overlaps_are_kept_and_change_nothing() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "fresh.csv", &["--no-cache"]).ends_with(0);
    assert!(!dir.path().join("c").exists());
    build(dir.path(), "first.csv", &["--cache", "c"]).ends_with(0);
    let tables = files(&dir.path().join("c"));
    assert_eq!(tables.len(), 1);
    let before = modified(&tables[0]);
    build(dir.path(), "second.csv", &["--cache", "c"]).ends_with(0);
    assert_eq!(modified(&tables[0]), before);
    std::fs::write(&tables[0], b"{").unwrap();
    let said = build(dir.path(), "third.csv", &["--cache", "c"]).ends_with(0);
    assert!(said.err.contains("warning: c/"), "{}", said.err);
    assert!(said.err.contains("measured anew"), "{}", said.err);
    let fresh = read(dir.path().join("fresh.csv"));
    for list in ["first.csv", "second.csv", "third.csv"] {
        assert_eq!(read(dir.path().join(list)), fresh, "{list}");
    }
    let both = build(dir.path(), "x.csv", &["--cache", "c", "--no-cache"]);
    assert_eq!(both.code, 2, "{}", both.err);
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path());
    let mut found = Vec::new();
    for path in entries {
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path);
        }
    }
    found
}

#[test]
fn the_open_choices_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["pairs", "--dataset", SYNTHETIC, "--ambiguity", "--no-cache"];
    let json = sharp_bench(dir.path(), &[&args[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    let choices = json["choices"].as_array().unwrap();
    assert!(choices.len() > 25, "{}", choices.len());
    let of = |change: &str, what: &str| {
        let row = choices.iter().find(|c| c["change"] == change).unwrap();
        row["datasets"]["S"][what].as_u64().unwrap()
    };
    // The counts are those of lists that are built so.
    for change in ["", "threshold=0.7", "test=frustum", "sets=strided"] {
        let list = build(dir.path(), "p.csv", &["--pair-options", change, "--json"])
            .ends_with(0)
            .json();
        assert_eq!(
            list["datasets"]["S"]["qualified"],
            of(change, "qualified"),
            "{change}"
        );
    }
    assert_eq!(of("", "shared"), of("", "selected"));
    assert!(of("threshold=0.7", "qualified") < of("", "qualified"));
    let said = sharp_bench(dir.path(), &args).ends_with(0);
    assert!(said.out.contains("order=once"), "{}", said.out);
    assert_eq!(
        build(dir.path(), "p.csv", &["--ambiguity"]).code,
        2,
        "--ambiguity writes no list"
    );
}

#[test]
fn somebody_elses_depth_decides_overlap_and_is_named() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "truth.csv", &["--no-cache"]).ends_with(0);
    // The true depth in another unit, as a prediction of the right shape has it.
    let export = [
        "pairs",
        "export",
        "--pairs",
        "truth.csv",
        "--all",
        "--dataset",
        SYNTHETIC,
        "--out",
        "e",
        "--with",
        "depth",
    ];
    sharp_bench(dir.path(), &export).ends_with(0);
    let list = read(dir.path().join("truth.csv"));
    for line in list.lines().skip(1) {
        let id = line.split(',').next().unwrap();
        let (stem, _) = id.split_once("__").unwrap();
        let from = dir.path().join("e").join(id).join("source_depth.npy");
        let mut depth = sharp_datasets::format::npy::read(&from).unwrap();
        depth.iter_mut().for_each(|z| *z *= 0.25);
        let to = dir.path().join("mono").join(format!("{stem}.npy"));
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        sharp_datasets::format::npy::write(&to, &depth).unwrap();
    }
    let mono = ["--overlap-depth", "mono", "--no-cache"];
    let json = build(dir.path(), "mono.csv", &[&mono[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    assert_eq!(json["overlap_depth"], "given,median-scaled-to-ground-truth");
    assert!(json["options"].as_str().unwrap().contains("overlap=given"));
    assert!(
        json["overlap_depth_maps"]
            .as_str()
            .unwrap()
            .contains("maps, sha256 ")
    );
    // Scaled back, it is the truth: the same pairs with the same overlap to rounding.
    let ids = |name: &str| -> Vec<String> {
        let text = read(dir.path().join(name));
        let lines = text.lines().skip(1);
        lines
            .map(|l| l.split(',').next().unwrap().to_owned())
            .collect()
    };
    assert_eq!(ids("mono.csv"), ids("truth.csv"));
    // As it is, it would put every surface at a quarter of its distance.
    let metric = [&mono[..], &["--pair-options", "overlap=given-metric"]].concat();
    build(dir.path(), "metric.csv", &metric).ends_with(4);
    assert_ne!(ids("metric.csv"), ids("truth.csv"));

    // A run says where its overlap comes from, also with a list that was built before.
    let run = |out: &str, pairs: &[&str]| {
        let args = [
            "run",
            "--dataset",
            SYNTHETIC,
            "--method",
            "copy",
            "--metrics",
            "psnr",
            "--limit",
            "1",
            "--out",
            out,
        ];
        sharp_bench(dir.path(), &[&args[..], pairs].concat()).ends_with(0);
        let manifest: serde_json::Value =
            serde_json::from_str(&read(dir.path().join(out).join("manifest.json"))).unwrap();
        manifest["pairs"]["options"].clone()
    };
    let built = run("built", &mono);
    assert_eq!(
        built["overlap depth"],
        "given,median-scaled-to-ground-truth"
    );
    assert_eq!(run("given", &["--pairs", "mono.csv"]), built);
    sharp_bench(dir.path(), &["report", "built"]).ends_with(0);
    let report = read(dir.path().join("built/report/report.md"));
    assert!(report.contains("median-scaled-to-ground-truth"), "{report}");

    let wrong = |more: &[&str], parts: &[&str]| {
        build(dir.path(), "x.csv", more).is_error_with(parts);
        assert!(!dir.path().join("x.csv").exists());
    };
    wrong(
        &["--overlap-depth", "nowhere"],
        &["nowhere", "not a folder"],
    );
    std::fs::create_dir(dir.path().join("empty")).unwrap();
    wrong(&["--overlap-depth", "empty"], &["not one view"]);
    wrong(
        &["--pair-options", "overlap=given"],
        &["--overlap-depth DIR"],
    );
    let both = [
        "--overlap-depth",
        "mono",
        "--pair-options",
        "overlap=sparse",
    ];
    wrong(&both, &["does not take"]);
}

#[test]
fn a_checkpoint_decides_overlap_and_is_not_judged_on_its_own_choice() {
    let dir = tempfile::tempdir().unwrap();
    let golden = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/model");
    let model = golden.join("tiny_model.pt").display().to_string();
    let config = golden.join("tiny_config.json#tiny").display().to_string();
    let options = [
        "--pair-options",
        "overlap=sharp-release,threshold=0",
        "--overlap-checkpoint",
        &model,
        "--overlap-config",
        &config,
        "--no-cache",
    ];
    let json = build(dir.path(), "p.csv", &[&options[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    let depth = json["overlap_depth"].as_str().unwrap();
    assert!(
        depth.starts_with("first layer of another network(checkpoint sha256 "),
        "{depth}"
    );
    let method = format!("sharp:checkpoint={model},config={config}");
    let run = [
        "run",
        "--dataset",
        SYNTHETIC,
        "--pairs",
        "p.csv",
        "--metrics",
        "psnr",
        "--limit",
        "1",
        "--method",
        &method,
        "--method",
        "copy",
        "--out",
        "r",
    ];
    sharp_bench(dir.path(), &run).is_error_with(&["method 'sharp' is evaluated with"]);
    // Without the official file nothing stands in for it.
    let absent = [
        "--pair-options",
        "overlap=sharp-release",
        "--overlap-checkpoint",
        "no.pt",
    ];
    build(dir.path(), "q.csv", &absent).is_error_with(&["no.pt"]);
    let useless = ["--overlap-checkpoint", model.as_str()];
    build(dir.path(), "q.csv", &useless).is_error_with(&["overlap=sharp-release"]);
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
    let run = [
        "run",
        "--dataset",
        SYNTHETIC,
        "--method",
        "copy",
        "--metrics",
        "psnr",
    ];
    let run = [
        &run[..],
        &["--pair-options", "min-baseline=9", "--out", "r"],
    ]
    .concat();
    sharp_bench(dir.path(), &run).is_error_with(&["no pair to evaluate", "min-baseline=9"]);
    // Nothing amiss, nothing said.
    let json = build(dir.path(), "p.csv", &["--json"]).ends_with(0).json();
    assert_eq!(json["warnings"].as_array().unwrap().len(), 0);
}

#[test]
fn depth_is_exported_where_there_is_some() {
    let dir = tempfile::tempdir().unwrap();
    let data = sharp_datasets::bundled::extract(&dir.path().join("data")).unwrap();
    let dataset = format!("M:middlebury={}", data.display());
    let build = ["pairs", "--dataset", &dataset, "--out", "p.csv"];
    sharp_bench(dir.path(), &build).ends_with(0);
    let export = || {
        let args = ["pairs", "export", "--pairs", "p.csv", "--dataset", &dataset];
        let more = ["--with", "depth", "--out", "e", "--json"];
        sharp_bench(dir.path(), &[&args[..], &more].concat()).ends_with(0)
    };
    let stale = find(&data, "im0.png");
    let list = read(dir.path().join("p.csv"));
    let id = list.lines().nth(1).unwrap().split(',').next().unwrap();
    let folder = dir.path().join("e").join(id);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::copy(stale, folder.join("target_depth.npy")).unwrap();
    let said = export();
    assert!(said.err.contains("1 view without depth"), "{}", said.err);
    let json = said.json();
    assert_eq!(
        (&json["written"], &json["without_depth"]),
        (&1.into(), &1.into())
    );
    assert!(folder.join("source_depth.npy").is_file());
    assert!(!folder.join("target_depth.npy").exists());
    let pair: serde_json::Value = serde_json::from_str(&read(folder.join("pair.json"))).unwrap();
    let files: Vec<&String> = pair["files"].as_object().unwrap().keys().collect();
    assert_eq!(files, ["source.png", "source_depth.npy"]);
    // What is kept lacks it just as well.
    let json = export().json();
    assert_eq!(
        (&json["kept"], &json["without_depth"]),
        (&1.into(), &1.into())
    );
}

#[test]
fn readings_of_a_dataset_are_choices_too() {
    let dir = tempfile::tempdir().unwrap();
    let data = sharp_datasets::bundled::extract(&dir.path().join("data")).unwrap();
    let dataset = format!("M:middlebury={}", data.display());
    let args = ["pairs", "--dataset", &dataset, "--ambiguity", "--no-cache"];
    let json = sharp_bench(dir.path(), &[&args[..], &["--json"]].concat());
    let json = json.ends_with(0).json();
    let rows = json["choices"].as_array().unwrap();
    let of = |change: &str| {
        let found = rows.iter().find(|row| row["change"] == change);
        found.unwrap_or_else(|| panic!("no {change} in {json}"))
    };
    assert_eq!(of("")["datasets"]["M"]["selected"], 1);
    // The bundle has one exposure.
    let other = of("right=im1E");
    assert!(other["unavailable"]["M"].is_string(), "{other}");
    assert!(rows.iter().all(|row| row["about"] != "threshold"));
    let said = sharp_bench(dir.path(), &args).ends_with(0);
    let line = said.out.lines().find(|line| line.contains("right=im1E"));
    assert!(line.unwrap().contains("cannot be opened"), "{}", said.out);
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
    let proxies = &manifest["pairs"]["proxies"];
    assert_eq!(proxies, &serde_json::json!(["min-baseline=0.001"]));
    assert!(table.contains("M<sup>a</sup><br>PSNR"), "{table}");
    assert!(table.contains("proxy of the paper's column"), "{table}");
    assert!(
        report.contains("| min-baseline | 0.001 (proxy: differs from the paper) |"),
        "{report}"
    );
    assert!(report.contains("| seed | 3 |"), "{report}");
    let (manifest, table, _) = run("seed=3", "b");
    assert!(manifest["pairs"]["proxies"].is_null());
    assert!(table.contains("M<br>PSNR"), "{table}");

    build(dir.path(), "p.csv", &["--pair-options", "threshold=0.5"]).ends_with(0);
    let beside: serde_json::Value =
        serde_json::from_str(&read(dir.path().join("p.csv.json"))).unwrap();
    assert_eq!(beside["proxies"], serde_json::json!(["threshold=0.5"]));
}

#[test]
fn help_lists_what_each_choice_may_be() {
    let dir = tempfile::tempdir().unwrap();
    let said = sharp_bench(dir.path(), &["pairs", "--help"]).ends_with(0);
    for part in [
        "sets           consecutive, strided, whole, random:SEED\n",
        "limit          all or a number\n                 default 512; pairs of a dataset",
        "at-threshold   out, in\n                 default out; ",
    ] {
        assert!(said.out.contains(part), "{}", said.out);
    }
}
