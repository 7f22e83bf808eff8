//! `pairs diff`, `pairs verify`, `pairs export`, `cameras export`.

use std::path::{Path, PathBuf};

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
    build(dir.path(), "p.csv", &["--pair-options", "limit=0"]).ends_with(0);
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
    let camera = find_json(&dir.path().join("v/S"));
    for key in ["width", "height", "K", "camera_from_world", "conventions"] {
        assert!(!camera[key].is_null(), "{key}");
    }
}

fn find_json(folder: &Path) -> serde_json::Value {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            return find_json(&path);
        }
        if path.extension().is_some_and(|e| e == "json") {
            return serde_json::from_str(&read(path)).unwrap();
        }
    }
    panic!("no JSON");
}
