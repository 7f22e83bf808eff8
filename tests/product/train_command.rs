//! `train` on the tiny network, and the bundled network wherever a checkpoint can be given.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use sharp::model::inventory::CheckpointSource;
use sharp_datasets::bundled;

use crate::support::{Said, read, sharp_bench, words};
use crate::tiny::{golden, recorded_input};

/// Four steps of the first stage, without the perceptual loss, whose network takes the most time.
fn config(folder: &Path) -> String {
    let text = format!(
        "network.file = {:?}\nlosses.percep = 0.0\n\
         [stage1]\nsteps = 4\nbatch = 1\nside = 192\n\
         schedule = {{ peak = 1e-3, last = 1e-4, warmup_steps = 1 }}\n\
         [stage2]\nsteps = 0\nbatch = 1\n\
         [intervals]\nvalidation = 2\ncheckpoint = 2\n",
        golden("tiny_config.json#tiny")
    );
    std::fs::write(folder.join("t.toml"), &text).unwrap();
    text
}

fn arguments(out: &str) -> Vec<&str> {
    let validation = "--validation synthetic=size=64x48,views=20 --validation-pairs 1";
    [
        &words("train t.toml --out")[..],
        &[out],
        &words(validation),
        &words("--metrics psnr --json --quiet"),
    ]
    .concat()
}

fn train(folder: &Path, out: &str) -> Said {
    sharp_bench(folder, &arguments(out))
}

/// Starts a training and sends a signal as soon as its log has `lines` lines; returns its exit
/// code.
fn signalled(folder: &Path, out: &str, lines: usize, signal: &str) -> Option<i32> {
    let mut child = Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
        .args(arguments(out))
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let log = folder.join(out).join("log.csv");
    let started = Instant::now();
    let has = || std::fs::read_to_string(&log).is_ok_and(|text| text.lines().count() >= lines);
    while !has() && started.elapsed() < Duration::from_secs(300) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let pid = child.id().to_string();
    let sent = Command::new("kill").args([signal, &pid]).status().unwrap();
    assert!(sent.success());
    child.wait().unwrap().code()
}

/// The output that configuration and seed determine.
fn bytes(folder: &Path) -> Vec<Vec<u8>> {
    let names = ["log.csv", "validation.csv", "weights.safetensors"];
    let files = names.map(|name| std::fs::read(folder.join(name)).unwrap());
    files.into()
}

#[test]
#[cfg(unix)]
fn a_training_is_validated_and_goes_on_where_it_was_killed_or_interrupted() {
    let dir = tempfile::tempdir().unwrap();
    config(dir.path());
    let json = train(dir.path(), "a").ends_with(0).json();
    assert_eq!(
        (&json["complete"], &json["step"]),
        (&true.into(), &4.into())
    );
    let whole = dir.path().join("a");
    assert_eq!(read(whole.join("log.csv")).lines().count(), 5);
    let validation = read(whole.join("validation.csv"));
    let steps: Vec<&str> = validation.lines().skip(1).map(|row| &row[..4]).collect();
    assert_eq!(steps, ["1,2,", "1,4,"], "{validation}");
    let psnr = json["validation"]["psnr"].as_f64().unwrap();
    assert!(
        validation.contains(&format!("1,4,{psnr},\"psnr\"")),
        "{validation}"
    );
    // The last validation is an ordinary run.
    let scores = read(whole.join("validation/scores.csv"));
    assert!(
        scores.lines().nth(1).unwrap().contains(&psnr.to_string()),
        "{scores}"
    );
    let page = read(whole.join("index.html"));
    for part in ["learning rate", "psnr", "data:image/jpeg;base64,", "stage1"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("src=\"http") && !page.contains("<script"));

    assert_eq!(signalled(dir.path(), "b", 4, "-KILL"), None);
    assert!(!dir.path().join("b/weights.safetensors").exists());
    train(dir.path(), "b").ends_with(0);
    assert_eq!(bytes(&whole), bytes(&dir.path().join("b")));

    assert_eq!(signalled(dir.path(), "c", 2, "-INT"), Some(75));
    assert!(!dir.path().join("c/weights.safetensors").exists());
    // The file is not written before training is complete.
    let halves = [&arguments("c")[..], &["--export-f16", "half.safetensors"]].concat();
    let stopped = [&halves[..], &["--time-budget", "0s"]].concat();
    sharp_bench(dir.path(), &stopped).ends_with(75);
    assert!(!dir.path().join("half.safetensors").exists());
    sharp_bench(dir.path(), &halves).ends_with(0);
    let half = CheckpointSource::open(&dir.path().join("half.safetensors")).unwrap();
    let tiny = sharp::model::ModelConfig::load(&golden("tiny_config.json#tiny")).unwrap();
    half.check(&tiny, &[]).unwrap();
    assert_eq!(bytes(&whole), bytes(&dir.path().join("c")));

    // A complete training has nothing left to do.
    let again = train(dir.path(), "a").ends_with(0).json();
    assert_eq!(again["weights_sha256"], json["weights_sha256"]);

    // The weights are a checkpoint for the network described next to them.
    let method = "sharp:checkpoint=a/weights.safetensors,config=a/network.json";
    let run =
        words("run --dataset synthetic=size=64x48,views=20 --limit 1 --metrics psnr --method");
    sharp_bench(dir.path(), &[&run[..], &[method, "--out", "r"]].concat()).ends_with(0);
}

#[test]
fn what_cannot_be_trained_is_one_clear_error() {
    let dir = tempfile::tempdir().unwrap();
    let text = config(dir.path());
    let with = |text: &str| {
        std::fs::write(dir.path().join("t.toml"), text).unwrap();
        train(dir.path(), "t")
    };
    with(&text.replace("peak = 1e-3", "peak = nan"))
        .is_error_with(&["t.toml", "`stage1.schedule.peak`"]);
    with("[stage1\n").is_error_with(&["t.toml: line 1"]);
    with(&format!("stepz = 3\n{text}")).is_error_with(&["line 1", "stepz"]);
    std::fs::remove_file(dir.path().join("t.toml")).unwrap();
    train(dir.path(), "t").is_error_with(&["t.toml: "]);
    assert!(!dir.path().join("t").exists());

    config(dir.path());
    let set = |values: &[&str]| {
        let sets = values.iter().flat_map(|value| ["--set", value]);
        let all: Vec<&str> = arguments("u").into_iter().chain(sets).collect();
        sharp_bench(dir.path(), &all)
    };
    set(&["stage1.steps=1"]).is_error_with(&["--set stage1.steps=1: ", "warmup_steps"]);
    assert!(!dir.path().join("u").exists());
    set(&["stage1.steps=2", "losses.tv=0"]).ends_with(0);
    let log = std::fs::read_to_string(dir.path().join("u/log.csv")).unwrap();
    assert_eq!(log.lines().count(), 3);
    train(dir.path(), "u").is_error_with(&["`losses.tv` was 0 and is now not given"]);

    // The paper's weight is meant for another network than the bundled one.
    let heavy = ["--set", "losses.percep=", "--set", "initial=absent.pt"];
    let said = sharp_bench(dir.path(), &[&arguments("v")[..], &heavy].concat());
    said.is_error_with(&["absent.pt"]);
    assert!(said.err.contains("`losses.percep` is 3"), "{}", said.err);

    let mut seen = arguments("t");
    seen[5] = "synthetic=world=varied,seed=999,scenes=2";
    sharp_bench(dir.path(), &seen).is_usage_error_with(&["scenes=2", "below 1000"]);

    let bundled = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../datasets/bundled/middlebury"
    );
    let dataset = format!("middlebury={bundled}");
    let data = format!("stage1.data={{ datasets = [{dataset:?}] }}");
    seen[5] = &dataset;
    let learnt = [&seen[..], &["--set", &data]].concat();
    sharp_bench(dir.path(), &learnt).is_usage_error_with(&["Motorcycle", "this training run uses"]);
    let data = format!("stage2.data={{ photographs = \"{bundled}/Motorcycle-quarter\" }}");
    let steps = words("--set stage2.steps=1 --set stage2.schedule.warmup_steps=0");
    let learnt = [&seen[..], &steps, &["--set", &data]].concat();
    sharp_bench(dir.path(), &learnt)
        .is_usage_error_with(&["photographs", "this training run uses"]);
}

/// The second of two scenes is held out, so that all pairs of the validation are from it.
#[test]
fn a_folder_of_photographs_is_split_into_training_and_validation() {
    let dir = tempfile::tempdir().unwrap();
    config(dir.path());
    let bundled = bundled::extract(&dir.path().join("bundled")).unwrap();
    let from = bundled.join("Motorcycle-quarter");
    for scene in ["A", "B"] {
        let to = dir.path().join("data").join(scene);
        std::fs::create_dir_all(&to).unwrap();
        for entry in std::fs::read_dir(&from).unwrap() {
            let file = entry.unwrap();
            std::fs::copy(file.path(), to.join(file.file_name())).unwrap();
        }
    }
    let trained = |held_out: usize, out| {
        let data = format!("stage2.data.split={{ photographs = \"data\", held_out = {held_out} }}");
        let mut arguments = arguments(out).to_vec();
        arguments[5] = "middlebury=data";
        for set in [
            "stage1.steps=0",
            "stage2={ steps = 1, side = 192, schedule.warmup_steps = 0 }",
            &data,
        ] {
            arguments.extend(["--set", set]);
        }
        sharp_bench(dir.path(), &arguments)
    };
    trained(2, "t").ends_with(0);
    let pairs = read(dir.path().join("t/validation-pairs.csv"));
    assert!(pairs.contains(",B,") && !pairs.contains(",A,"), "{pairs}");
    trained(3, "u").is_error_with(&["held out (`stage2.data.split`)"]);
}

#[test]
fn configurations_of_the_bundled_network_fit_together() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let load = |name| {
        let file = root.join("sharp/train/configs").join(name);
        // The first two give their network relative to the folder of these sources.
        let text = std::fs::read_to_string(&file).unwrap();
        let text = text.replace("sharp/mini/", &format!("{}/sharp/mini/", root.display()));
        sharp_train::config::TrainingConfig::parse(&text, &file).unwrap()
    };
    let [depth, early, whole] = ["mini-384-depth.toml", "mini-384.toml", "mini.toml"].map(load);
    assert_eq!(whole.network, sharp::model::bundled::config().unwrap());
    assert_eq!(depth.network, early.network);
    let handed_on = early.initial_depth.unwrap();
    assert_eq!(handed_on, Path::new("depth/weights.safetensors"));
    assert!(depth.losses.depth > 0.0 && early.losses.color > 0.0);
    let handed_on = whole.initial.unwrap();
    assert_eq!(handed_on, Path::new("mini-384/weights.safetensors"));
}

#[test]
fn a_training_may_begin_with_the_bundled_network() {
    let dir = tempfile::tempdir().unwrap();
    let text = "network = \"mini\"\ninitial = \"mini\"\n\
                losses = { color = 0, alpha = 0, percep = 0, grad = 0, delta = 0, splat = 0 }\n\
                stage1 = { steps = 1, side = 64, schedule.warmup_steps = 0 }\n\
                stage2.steps = 0\nintervals.validation = 0\n";
    std::fs::write(dir.path().join("t.toml"), text).unwrap();
    let json = train(dir.path(), "t").ends_with(0).json();
    let learnt = dir.path().join("t/weights.safetensors");
    let bundled = sharp::model::bundled::config().unwrap();
    CheckpointSource::open(&learnt)
        .unwrap()
        .check(&bundled, &[])
        .unwrap();
    // If it is killed before its first checkpoint, it starts again with the same weights.
    let bytes = std::fs::read(&learnt).unwrap();
    std::fs::remove_dir_all(dir.path().join("t/checkpoints")).unwrap();
    train(dir.path(), "t").ends_with(0);
    assert_eq!(std::fs::read(&learnt).unwrap(), bytes);
    // Random weights would start with another loss.
    let loss = |out: &str| {
        let log = read(dir.path().join(out).join("log.csv"));
        let row = log.lines().nth(1).unwrap();
        row.split(',').nth(6).unwrap().parse::<f64>().unwrap()
    };
    std::fs::write(
        dir.path().join("t.toml"),
        text.replace("initial = \"mini\"\n", ""),
    )
    .unwrap();
    train(dir.path(), "u").ends_with(0);
    assert!(loss("t") < 0.8 * loss("u"), "{} {}", loss("t"), loss("u"));
    assert_eq!(json["complete"], true);
}

#[test]
fn the_bundled_network_predicts_records_and_compares() {
    let dir = tempfile::tempdir().unwrap();
    let (image, focal) = recorded_input();
    let input = [
        "--image",
        &image,
        "--focal-px",
        &focal,
        "--checkpoint",
        "mini",
    ];
    let record = [&["record", "--out", "r.safetensors"][..], &input].concat();
    sharp_bench(dir.path(), &record).ends_with(0);
    let parity = [&["parity", "--golden", "r.safetensors"][..], &input].concat();
    let said = sharp_bench(dir.path(), &parity).ends_with(0);
    assert!(said.out.contains("within"), "{}", said.out);
    let exact = [&parity[..], &["--exact"]].concat();
    sharp_bench(dir.path(), &exact).ends_with(0);

    let predict = [
        "predict",
        &image,
        "--checkpoint",
        "mini",
        "--out",
        "p.ply",
        "--json",
    ];
    let json = sharp_bench(dir.path(), &predict).ends_with(0).json();
    assert_eq!(json[0]["gaussians"], 2 * 256 * 256);
    let both = [&predict[..], &["--config", "x.json"]].concat();
    sharp_bench(dir.path(), &both).is_error_with(&["own configuration", "./mini"]);
    // Without any checkpoint, `predict` uses the bundled network, and a note says so.
    let none = ["predict", &image, "--out", "q.ply"];
    let said = sharp_bench(dir.path(), &none).ends_with(0).err;
    let note = "using the bundled small network: no SHARP checkpoint";
    assert!(said.contains(note), "{said}");
}
