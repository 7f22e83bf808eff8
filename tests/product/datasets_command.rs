//! `sharp-bench datasets`: available datasets, files that a pair list needs, broken files.

use std::path::Path;

use serde_json::Value;
use sharp_datasets::format::read_map;

use crate::own_pictures::own_pictures;
use crate::support::{read, sharp_bench, words};

/// The bundled scene, stored twice as two scenes of Middlebury.
fn middlebury(folder: &Path) {
    let bundled = sharp_datasets::bundled::extract(folder).unwrap();
    let scene = bundled.join("Motorcycle-quarter");
    for name in ["One-perfect", "Two-imperfect"] {
        let copy = folder.join("set").join(name);
        std::fs::create_dir_all(&copy).unwrap();
        for file in ["im0.png", "im1.png", "calib.txt", "disp0.pfm"] {
            std::fs::copy(scene.join(file), copy.join(file)).unwrap();
        }
    }
}

#[test]
fn a_sound_dataset_passes_its_check() {
    let dir = tempfile::tempdir().unwrap();
    middlebury(dir.path());
    // Resizing, which `run` accepts in the same place, does not apply.
    for spec in [
        "middlebury=set",
        "middlebury=set,frame=cover:256x256:lanczos",
    ] {
        let said = sharp_bench(dir.path(), &["datasets", "check", spec]).ends_with(0);
        for part in [
            "One-perfect: 2 views, 741x500; depth in 1 of 2 decoded views, at 92.7 %",
            "reading right=im1",
            "2 scenes, 4 views; 0 scenes unreadable; problems: 0",
        ] {
            assert!(said.out.contains(part), "'{part}' is not in: {}", said.out);
        }
    }
    let synthetic = words("datasets check synthetic=size=96x72,views=12 --json");
    let json = sharp_bench(dir.path(), &synthetic).ends_with(0).json();
    let scene = &json["datasets"][0]["scenes"][0];
    assert_eq!(
        (scene["views"].as_u64(), scene["decoded"].as_u64()),
        (Some(12), Some(10))
    );
    assert!(scene["consistency"]["as_read"]["depth"].as_f64().unwrap() > 0.7);
    assert_eq!(json["problems"], 0);
}

#[test]
fn everything_broken_is_named_in_one_go() {
    let dir = tempfile::tempdir().unwrap();
    middlebury(dir.path());
    let set = dir.path().join("set");
    let calib = read(set.join("One-perfect/calib.txt"));
    std::fs::write(
        set.join("One-perfect/calib.txt"),
        calib.replace("baseline", "base"),
    )
    .unwrap();
    let picture = std::fs::read(set.join("Two-imperfect/im1.png")).unwrap();
    std::fs::write(set.join("Two-imperfect/im1.png"), &picture[..9000]).unwrap();
    std::fs::write(set.join("Two-imperfect/disp0.pfm"), "Pf\n741 500\n-1\n").unwrap();
    let said = sharp_bench(dir.path(), &["datasets", "check", "middlebury=set"]).ends_with(4);
    let broken: Vec<&str> = said.out.lines().filter(|l| l.contains("BROKEN")).collect();
    assert_eq!(broken.len(), 3, "{}", said.out);
    for name in [
        "One-perfect/calib.txt",
        "Two-imperfect/im1.png",
        "Two-imperfect/disp0.pfm",
    ] {
        assert!(
            broken.iter().any(|line| line.contains(name)),
            "{name}: {broken:?}"
        );
    }
    let json = sharp_bench(
        dir.path(),
        &["datasets", "check", "middlebury=set", "--json"],
    );
    let json = json.ends_with(4).json();
    assert_eq!(json["problems"], 3);
    assert_eq!(
        json["datasets"][0]["unreadable"].as_array().unwrap().len(),
        1
    );
    sharp_bench(dir.path(), &["datasets", "check", "eth3d=set"]).is_error_with(&[
        "set",
        "no eth3d scene found",
        "dslr_calibration_jpg",
        "images=undistorted",
    ]);
}

#[test]
fn the_list_has_every_format_with_its_readings() {
    let dir = tempfile::tempdir().unwrap();
    let json = sharp_bench(dir.path(), &["datasets", "list", "--json"])
        .ends_with(0)
        .json();
    let all = json.as_array().unwrap();
    let names: Vec<&str> = all.iter().map(|f| f["format"].as_str().unwrap()).collect();
    assert_eq!(
        names.join(" "),
        "middlebury booster scannetpp wildrgbd tanks-and-temples eth3d nerfstudio colmap stereo virtual synthetic"
    );
    for dataset in &all[..6] {
        for key in [
            "title",
            "page",
            "terms",
            "download",
            "size",
            "layout",
            "table_column",
            "caveat",
        ] {
            assert!(
                !dataset[key].as_str().unwrap().is_empty(),
                "{} {key}",
                dataset["format"]
            );
        }
        let readings = dataset["readings"].as_array().unwrap();
        assert!(!readings.is_empty(), "{}", dataset["format"]);
        for reading in readings
            .iter()
            .filter(|r| r["choices"] != Value::Array(vec![]))
        {
            let default = &reading["default"];
            let mut choices = reading["choices"].as_array().unwrap().iter();
            assert!(choices.any(|c| c["value"] == *default), "{reading}");
        }
    }
    let text = sharp_bench(dir.path(), &["datasets", "list"])
        .ends_with(0)
        .out;
    for part in [
        "split=nvs_sem_val (open)",
        "split=nvs_test_small (proxy)",
        "illuminations=all by default",
        "rectification=perfect",
        "scenes=training15",
        "split=val-frames",
        "feeds     Tanks and Temples",
    ] {
        assert!(text.contains(part), "'{part}' is not in: {text}");
    }
}

#[test]
fn settings_of_every_dataset_are_in_the_help() {
    let dir = tempfile::tempdir().unwrap();
    for args in [
        ["run", "--help-all"],
        ["datasets", "--help-all"],
        ["datasets", "list"],
    ] {
        let said = sharp_bench(dir.path(), &args).ends_with(0);
        for part in [
            "frame=RULE",
            "width:W:KERNEL",
            "pairs.KEY=VALUE",
            "sweep=none",
        ] {
            assert!(said.out.contains(part), "{args:?}, {part}: {}", said.out);
        }
    }
}

#[test]
fn a_pair_list_needs_exactly_these_files() {
    let dir = tempfile::tempdir().unwrap();
    middlebury(dir.path());
    let dataset = "M:middlebury=set,rectification=perfect";
    sharp_bench(
        dir.path(),
        &["pairs", "--dataset", dataset, "--out", "pairs.csv"],
    )
    .ends_with(0);
    let needed = |more: &[&str]| {
        let args = [
            &["datasets", "list", "--needed-for", "pairs.csv", "--json"],
            more,
        ]
        .concat();
        sharp_bench(dir.path(), &args)
    };
    // The name M does not determine the format, so only the pictures are known.
    let json = needed(&[]).ends_with(0).json();
    assert_eq!(json["datasets"][0]["format"], Value::Null);
    assert_eq!(json["datasets"][0]["files"].as_array().unwrap().len(), 2);
    let json = needed(&["--dataset", "M:middlebury=set"])
        .ends_with(0)
        .json();
    let found = &json["datasets"][0];
    let files: Vec<String> = found["files"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| {
            format!(
                "{} {}",
                f["role"].as_str().unwrap(),
                f["path"].as_str().unwrap()
            )
        })
        .collect();
    assert_eq!(
        files,
        [
            "picture One-perfect/im0.png",
            "picture One-perfect/im1.png",
            "camera One-perfect/calib.txt",
            "depth One-perfect/disp0.pfm",
        ]
    );
    assert_eq!(found["archives"][0], "zip/One-perfect.zip");
    assert_eq!(json["missing"], 0);
    std::fs::remove_file(dir.path().join("set/One-perfect/disp0.pfm")).unwrap();
    let said = needed(&["--dataset", "M:middlebury=set"]).ends_with(4);
    assert_eq!(said.json()["missing"], 1);
    needed(&["--dataset", "eth3d=set"]).is_error_with(&["eth3d", "its datasets are M"]);
}

#[test]
fn own_pictures_need_what_their_camera_file_names() {
    let dir = tempfile::tempdir().unwrap();
    own_pictures(&dir.path().join("own"), [1.0, -1.0, -1.0]);
    let pairs = words(
        "pairs --dataset nerfstudio=own,depth-unit=1 --pair-options threshold=0 --out pairs.csv",
    );
    sharp_bench(dir.path(), &pairs).ends_with(0);
    let needed = |dataset: &str| {
        let args = words("datasets list --needed-for pairs.csv --json --dataset");
        sharp_bench(dir.path(), &[&args[..], &[dataset]].concat())
    };
    let json = needed("nerfstudio=own").ends_with(0).json();
    let files = json["datasets"][0]["files"].as_array().unwrap();
    let named = |role: &str| -> Vec<&str> {
        let of_role = files.iter().filter(|file| file["role"] == role);
        of_role.map(|file| file["path"].as_str().unwrap()).collect()
    };
    assert_eq!(named("picture"), ["0.png", "1.png", "2.png", "3.png"]);
    assert_eq!(named("camera"), ["transforms.json"]);
    assert_eq!(named("depth"), ["0.npy", "1.npy", "2.npy", "3.npy"]);
    // The dataset may also be given as the file itself.
    let same = needed("nerfstudio=own/transforms.json").ends_with(0).json();
    assert_eq!(same["datasets"], json["datasets"]);
    // Under another name: the files that the reader found.
    let own = dir.path().join("own");
    let train = own.join("transforms_train.json");
    std::fs::rename(own.join("transforms.json"), &train).unwrap();
    let json = needed("nerfstudio=own").ends_with(0).json();
    let files = json["datasets"][0]["files"].as_array().unwrap();
    let cameras = files.iter().filter(|file| file["role"] == "camera");
    let cameras: Vec<_> = cameras.map(|file| file["path"].as_str().unwrap()).collect();
    assert_eq!(cameras, ["transforms_train.json"]);
    // If the file of cameras is missing, the layout determines the needed files.
    std::fs::remove_file(train).unwrap();
    let json = needed("nerfstudio=own").ends_with(4).json();
    assert_eq!(json["missing"], 1);
}

#[test]
fn an_export_under_another_reading_is_made_anew() {
    let dir = tempfile::tempdir().unwrap();
    own_pictures(&dir.path().join("own"), [1.0, -1.0, -1.0]);
    let with = |command: &[&str], unit: &str| {
        let dataset = format!("nerfstudio=own,depth-unit={unit}");
        let args = [command, &["--dataset", &dataset, "--json"]].concat();
        sharp_bench(dir.path(), &args).ends_with(0).json()
    };
    let options = ["--pair-options", "threshold=0", "--out", "p.csv"];
    with(&[&["pairs"], &options[..]].concat(), "1");
    let export = |unit: &str| {
        let command = ["pairs", "export", "--pairs", "p.csv", "--with", "depth"];
        with(&[&command[..], &["--out", "e"]].concat(), unit)
    };
    let all = export("1")["written"].clone();
    assert!(all.as_u64().unwrap() > 0);
    assert_eq!(export("1")["kept"], all);
    let list = std::fs::read_to_string(dir.path().join("p.csv")).unwrap();
    let id = list.lines().nth(1).unwrap().split(',').next().unwrap();
    let depth = || read_map(&dir.path().join("e").join(id).join("source_depth.npy")).unwrap();
    let before = depth();
    assert_eq!(export("2")["written"], all);
    for (one, two) in before.iter().zip(depth().iter()) {
        assert_eq!(2.0 * one, *two);
    }
}

#[test]
fn readings_appear_in_the_report() {
    let dir = tempfile::tempdir().unwrap();
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/booster");
    let dataset = format!(
        "booster={},illuminations=first,split=test",
        fixture.display()
    );
    let args = words("run --method copy --metrics psnr --out r --dataset");
    sharp_bench(dir.path(), &[&args[..], &[&*dataset]].concat()).ends_with(0);
    sharp_bench(dir.path(), &["report", "r"]).ends_with(0);
    let page = read(dir.path().join("r/report/index.html"));
    for reading in [
        "illuminations=first",
        "set=balanced",
        "split=test (proxy: differs from the paper)",
    ] {
        assert!(page.contains(reading), "{reading}");
    }
}
