//! `pairs export`, `cameras export`.

use super::*;

#[test]
fn exported_pairs_are_what_is_scored() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "p.csv", &[]).ends_with(0);
    let export = |more: &[&str]| {
        let line =
            format!("pairs export --pairs p.csv --dataset {SYNTHETIC} --limit 3 --out e --json",);
        let args = words(&line);
        sharp_bench(dir.path(), &[&args[..], more].concat())
    };
    let json = export(&[]).ends_with(0).json();
    assert_eq!((&json["written"], &json["kept"]), (&3.into(), &0.into()));
    let list = read(dir.path().join("p.csv"));
    let ids = list.lines().skip(1).map(|line| line.split(',').next());
    let exported = |id: &&str| dir.path().join("e").join(id).is_dir();
    let ids: Vec<&str> = ids.flatten().filter(exported).collect();
    let id = ids[0];
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

    // The exported source, used as an external prediction, equals the prediction of `copy`.
    let predictions = dir.path().join("predictions");
    for id in ids {
        let to = predictions.join(format!("{id}.png"));
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(dir.path().join("e").join(id).join("source.png"), to).unwrap();
    }
    let line = format!(
        "run --dataset {SYNTHETIC} --pairs p.csv --limit 3 --metrics psnr --method copy \
         --method imported:label=mine,dir=predictions --out r",
    );
    sharp_bench(dir.path(), &words(&line)).ends_with(0);
    let scores = read(dir.path().join("r/scores.csv"));
    let psnr = |method: &str| -> Vec<&str> {
        let rows = scores.lines().filter(|l| l.contains(method));
        rows.map(|l| l.split(',').nth(11).unwrap()).collect()
    };
    assert_eq!(psnr(",copy,"), psnr(",mine,"));
    assert_eq!(psnr(",mine,").len(), 3);

    // A repetition has nothing to do. If more is requested, or a file is damaged, it is written
    // again.
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
    let depth = sharp_datasets::format::read_map(&folder.join("target_depth.npy")).unwrap();
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
        let args = format!("pairs export --pairs p.csv --dataset {dataset} --out {out}");
        sharp_bench(dir.path(), &words(&args))
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
    let line = format!("cameras export --dataset {SYNTHETIC} --out v --json");
    let args = words(&line);
    let json = sharp_bench(dir.path(), &args).ends_with(0).json();
    assert_eq!((&json["views"], &json["written"]), (&12.into(), &12.into()));
    assert_eq!(sharp_bench(dir.path(), &args).json()["kept"], 12);
    let scene = DatasetSpec::parse(SYNTHETIC).unwrap();
    let scene = sharp_datasets::open(&scene).unwrap().remove(0);
    for view in &scene.views {
        let path = find(&dir.path().join("v/S"), &format!("{}.json", view.id));
        let camera: serde_json::Value = serde_json::from_str(&read(&path)).unwrap();
        assert!(!camera["conventions"].is_null());
        // `render --camera` can read it.
        let (intrinsics, camera_from_world) = CameraFile::read(&path).unwrap();
        assert_eq!(intrinsics, view.intrinsics);
        assert_eq!(camera_from_world, view.camera_from_world.to_affine());
    }
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
    assert!(said.err.contains("no depth for 1 view"), "{}", said.err);
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
    // The kept export lacks depth too.
    let json = export().json();
    assert_eq!(
        (&json["kept"], &json["without_depth"]),
        (&1.into(), &1.into())
    );
}

#[test]
fn cameras_of_a_scale_sweep_are_exported() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "p.csv", &[]).ends_with(0);
    let export = |scales: &str| {
        let line = format!("pairs export --pairs p.csv --dataset {SYNTHETIC} --limit 1");
        let args = words(&line);
        let more = ["--out", "e", "--json", "--scales", scales];
        sharp_bench(dir.path(), &[&args[..], &more].concat())
    };
    let written = export("0.5,1,2").ends_with(0).json()["written"].clone();
    assert_eq!(written, 1);
    // With other scales, the pair is written again.
    assert_eq!(export("0.5,2").ends_with(0).json()["written"], 1);
    assert_eq!(export("0.5,2").ends_with(0).json()["kept"], 1);
    let list = read(dir.path().join("p.csv"));
    let ids = list
        .lines()
        .skip(1)
        .map(|line| line.split(',').next().unwrap());
    let folder = ids
        .map(|id| dir.path().join("e").join(id))
        .find(|f| f.is_dir());
    let pair = read(folder.unwrap().join("pair.json"));
    let pair: serde_json::Value = serde_json::from_str(&pair).unwrap();
    let matrix = |of: &serde_json::Value| -> Vec<f64> {
        let values = of["target_from_source"].as_array().unwrap();
        values.iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let (metric, half) = (matrix(&pair), matrix(&pair["scales"][0]));
    assert_eq!(pair["scales"][0]["scale"], "0.5");
    for (i, (metric, half)) in metric.iter().zip(&half).enumerate() {
        let factor = if matches!(i, 3 | 7 | 11) { 0.5 } else { 1.0 };
        assert_eq!(half, &(metric * factor), "{i}");
    }
    let file = pair["prediction"]["file"].as_str().unwrap();
    assert_eq!(pair["scales"][1]["file"], format!("2/{file}"));
    assert_eq!(export("0.5,big").code, 2);
}
