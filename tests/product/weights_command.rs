//! `weights`: contents of files, reasons for rejecting them, and how the official checkpoint is
//! fetched and recognised.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use sharp_checkpoint::{Checkpoint, DType, OutTensor, write_safetensors};

use crate::support::{Said, holds, sharp_bench as run, sharp_bench_with, words};
use crate::tiny::{golden, recorded_input, with_checkpoint};

#[test]
fn weights_are_made_checked_and_converted() {
    let dir = tempfile::tempdir().unwrap();
    let config = golden("tiny_config.json#tiny");
    let synth = ["weights", "synth", "--config", &config, "--out"];
    run(dir.path(), &[&synth[..], &["a.safetensors"]].concat()).ends_with(0);
    // Another salt gives other values with the same shapes; the same salt gives the same bytes.
    let salted = |salt: &str, out: &str| {
        run(dir.path(), &[&synth[..], &[out, "--salt", salt]].concat()).ends_with(0);
        fs::read(dir.path().join(out)).unwrap()
    };
    assert_ne!(salted("x", "c.safetensors"), salted("y", "d.safetensors"));
    assert_eq!(salted("x", "e.safetensors"), salted("x", "c.safetensors"));
    let pt = golden("tiny_model.pt");
    run(dir.path(), &["weights", "convert", &pt, "b.safetensors"]).ends_with(0);
    let check = |file: &str| {
        run(
            dir.path(),
            &["weights", "check", file, "--config", &config, "--json"],
        )
        .ends_with(0)
        .json()
    };
    let (synthetic, converted) = (check("a.safetensors"), check("b.safetensors"));
    assert_eq!(synthetic["parameters"], converted["parameters"]);
    assert_eq!(synthetic["modules"], converted["modules"]);
    assert_eq!(converted["not_finite"], 0);

    // The release's network is different, so everything that does not fit is listed.
    let said = run(dir.path(), &["weights", "check", "a.safetensors", "--json"]).ends_with(1);
    holds(
        &said.err,
        &[
            "missing",
            "shape",
            "for a network of another size, give its configuration: config=FILE.json#NAME",
        ],
    );
    // A fitting configuration next to the file is found.
    let tiny = dir.path().join("tiny.json");
    std::fs::copy(golden("tiny_config.json"), &tiny).unwrap();
    let said = run(dir.path(), &["weights", "check", "a.safetensors"]).ends_with(0);
    assert!(
        said.out.contains("all tensors of the network 'tiny_test'"),
        "{}",
        said.out
    );
    // A configuration of the same name that does not fit is the one that the error is about.
    let other = fs::read_to_string(&tiny).unwrap();
    let other = other.replace(r#""embed_dim": 32"#, r#""embed_dim": 64"#);
    fs::write(dir.path().join("a.json"), other).unwrap();
    let said = run(dir.path(), &["weights", "check", "a.safetensors"]).ends_with(1);
    holds(
        &said.err,
        &["another shape", "compared with the network `a.json#"],
    );
    std::fs::write(dir.path().join("page.pt"), b"<!DOCTYPE html>").unwrap();
    assert_eq!(run(dir.path(), &["weights", "check", "page.pt"]).code, 1);
}

#[test]
fn values_that_are_not_finite_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let tensor = OutTensor {
        name: "w".into(),
        dtype: DType::F32,
        shape: vec![3],
    };
    let values = [f32::NAN, 1.0, f32::INFINITY];
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    write_safetensors(
        &dir.path().join("w.safetensors"),
        &BTreeMap::new(),
        &[tensor],
        |_| Ok(Cow::Owned(bytes.clone())),
    )
    .unwrap();
    let said = run(dir.path(), &["weights", "check", "w.safetensors"]);
    said.is_error_with(&["w.safetensors", "2 values are not finite"]);
    assert!(said.out.contains("not finite    2"), "{}", said.out);
}

/// A checkpoint with Depth Pro's tensor names, which `predict` refuses.
#[test]
fn depth_pros_weights_are_told_from_those_of_sharp() {
    let dir = tempfile::tempdir().unwrap();
    let tensor = OutTensor {
        name: "encoder.patch_encoder.cls_token".into(),
        dtype: DType::F32,
        shape: vec![1],
    };
    write_safetensors(
        &dir.path().join("depth_pro.safetensors"),
        &BTreeMap::new(),
        &[tensor],
        |_| Ok(Cow::Owned(vec![0; 4])),
    )
    .unwrap();
    let (image, _) = recorded_input();
    let args = ["predict", &image, "--out", "p.ply"];
    let checkpoint = ["--checkpoint", "depth_pro.safetensors"];
    run(dir.path(), &[&args[..], &checkpoint].concat())
        .is_error_with(&["depth_pro.safetensors", "`predict --depth-only`"]);
}

/// The tiny network's weights with an additional tensor.
fn with_a_surplus_tensor(path: &Path) {
    let official = Checkpoint::open(golden("tiny_model.pt")).unwrap();
    let mut tensors: Vec<OutTensor> = official
        .names()
        .map(|name| OutTensor {
            name: name.to_owned(),
            dtype: official.dtype(name).unwrap(),
            shape: official.shape(name).unwrap().to_vec(),
        })
        .collect();
    tensors.push(OutTensor {
        name: "ema.decay".into(),
        dtype: DType::F32,
        shape: vec![1],
    });
    write_safetensors(path, &BTreeMap::new(), &tensors, |tensor| {
        if official.contains(&tensor.name) {
            official.tensor_bytes(&tensor.name).map(Cow::Owned)
        } else {
            Ok(Cow::Owned(vec![0; 4]))
        }
    })
    .unwrap();
}

#[test]
fn surplus_tensors_are_refused_until_they_are_allowed_everywhere() {
    let dir = tempfile::tempdir().unwrap();
    with_a_surplus_tensor(&dir.path().join("more.safetensors"));
    let (image, _) = recorded_input();
    let config = golden("tiny_config.json#tiny");
    let model = with_checkpoint("more.safetensors");
    let model: Vec<&str> = model.iter().map(String::as_str).collect();
    let predict = [&["predict", &image, "--out", "p.ply"][..], &model].concat();
    let check = ["weights", "check", "more.safetensors", "--config", &config];
    for command in [&predict[..], &check] {
        let said = run(dir.path(), command).ends_with(1);
        assert!(said.err.contains("surplus: ema.decay"), "{}", said.err);
        run(dir.path(), &[command, &["--allow-unused", "ema."]].concat()).ends_with(0);
    }
    let evaluate = |more: &str| {
        let method = format!("sharp:checkpoint=more.safetensors,config={config}{more}");
        let fixed =
            "run --dataset S:synthetic=size=96x72,views=20 --limit 1 --metrics psnr --out r --json";
        run(
            dir.path(),
            &[&words(fixed)[..], &["--method", &method]].concat(),
        )
    };
    evaluate("").is_error_with(&["surplus: ema.decay"]);
    assert_eq!(
        evaluate(",allow_unused=ema.").ends_with(0).json()["failed"],
        0
    );
}

/// Runs a command for a user whose home and caches are in `dir`.
fn at_home(dir: &Path, args: &[&str]) -> Said {
    let (home, cache, torch, ours) = (
        dir.join("home"),
        dir.join("cache"),
        dir.join("torch"),
        dir.join("ours"),
    );
    let variables = [
        ("HOME", &*home),
        ("XDG_CACHE_HOME", &*cache),
        ("TORCH_HOME", &*torch),
        ("SHARP_BENCH_WEIGHTS", &*ours),
        // An address without a server.
        ("SHARP_BENCH_MIRROR", Path::new("http://127.0.0.1:9")),
    ];
    sharp_bench_with(dir, &variables, args)
}

#[test]
fn networks_that_ship_are_at_hand_and_others_are_fetched_from_the_mirror() {
    let dir = tempfile::tempdir().unwrap();
    let list = at_home(dir.path(), &["weights", "list", "--json"]);
    let list = list.ends_with(0).json();
    let file = |i: usize| list[i]["file"].as_str();
    assert_eq!(file(0), Some("built in"));
    assert!(file(1).unwrap().ends_with("weights/vgg16.safetensors"));
    assert_eq!(
        (list[2]["name"].as_str(), file(2)),
        (Some("squeezenet1_1"), None)
    );
    let mini = list[3]["name"].as_str();
    assert!(mini == Some("mini") && file(3).unwrap().ends_with("mini.safetensors"));

    let fetch = |name: &str| at_home(dir.path(), &["weights", "fetch", name]);
    // Fetches only missing weights, unless they are requested by name.
    fetch("metrics").is_error_with(&["http://127.0.0.1:9/squeezenet1_1-b8a52dc0.pth"]);
    fetch("vgg16").is_error_with(&["http://127.0.0.1:9/vgg16-397923af.pth"]);
    let offline = ["weights", "fetch", "metrics", "--offline"];
    at_home(dir.path(), &offline).is_error_with(&["--offline", "squeezenet1_1=FILE"]);
}

#[test]
fn without_a_checkpoint_the_licence_and_the_ways_to_get_it_are_shown() {
    let dir = tempfile::tempdir().unwrap();
    let address = "https://ml-site.cdn-apple.com/models/sharp/sharp_2572gikvuh.pt";
    let said = at_home(dir.path(), &["weights", "fetch", "sharp"]);
    said.is_error_with(&["--accept-licence", address, "ours/sharp_2572gikvuh.pt"]);
    for part in [
        "Apple Machine Learning Research Model License",
        "https://github.com/apple/ml-sharp/blob/main/LICENSE_MODEL",
        "research only",
    ] {
        assert!(said.err.contains(part), "{part}: {}", said.err);
    }
    let accepted = at_home(
        dir.path(),
        &["weights", "fetch", "sharp", "--accept-licence"],
    );
    accepted.is_error_with(&[
        "127.0.0.1:9/sharp_2572gikvuh.pt",
        address,
        "--checkpoint FILE",
    ]);
    let offline = ["weights", "fetch", "sharp", "--offline", "--accept-licence"];
    at_home(dir.path(), &offline).is_error_with(&["--offline", address]);
    at_home(dir.path(), &["weights", "fetch", "sharpe"]).is_error_with(&["sharpe"]);
    let list = at_home(dir.path(), &["weights", "list"]).ends_with(0);
    holds(&list.out, &["unverified until its first use"]);
    // `predict` reports where it searched.
    let (image, _) = recorded_input();
    let said = at_home(dir.path(), &["predict", &image, "--out", "p.ply"]).ends_with(0);
    for part in ["torch/hub/checkpoints", "ours/", "--checkpoint FILE"] {
        assert!(said.err.contains(part), "{part}: {}", said.err);
    }
}

#[test]
fn a_checkpoint_in_torchs_folder_is_found_recorded_and_recognised() {
    let dir = tempfile::tempdir().unwrap();
    let hub = dir.path().join("torch/hub/checkpoints");
    fs::create_dir_all(&hub).unwrap();
    let file = hub.join("sharp_2572gikvuh.pt");
    fs::copy(golden("tiny_model.pt"), &file).unwrap();
    let fetch = || at_home(dir.path(), &["weights", "fetch", "sharp", "--json"]);
    let first = fetch().ends_with(0).json();
    assert_eq!(first[0]["verified"], false);
    assert!(
        first[0]["record"]
            .as_str()
            .unwrap()
            .starts_with("unverified")
    );
    assert!(first[0]["file"].as_str().unwrap().contains("torch/hub"));
    let text = fs::read_to_string(dir.path().join("ours/sharp_2572gikvuh.pt.json")).unwrap();
    let record: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(record["bytes"], fs::metadata(&file).unwrap().len());
    let again = fetch().ends_with(0).json();
    assert_eq!(again[0]["verified"], true);
    let day = record["recorded"].as_str().unwrap();
    let matches = format!("matches the checkpoint recorded on {day}");
    assert_eq!(again[0]["record"], matches);
    let list = at_home(dir.path(), &["weights", "list"]).ends_with(0);
    assert!(list.out.contains(record["sha256"].as_str().unwrap()));
    // `check` also compares with the record, before it finds that the network differs from the
    // release's.
    let check = ["weights", "check", file.to_str().unwrap()];
    let checked = at_home(dir.path(), &check).ends_with(1);
    assert!(checked.out.contains(&matches), "{}", checked.out);
    // Another file with the same name is no longer accepted.
    let mut bytes = fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&file, bytes).unwrap();
    for command in [&check[..], &["weights", "fetch", "sharp"]] {
        at_home(dir.path(), command).is_error_with(&["recorded on", "delete"]);
    }
    let evaluate = words("run --dataset S:synthetic=size=96x72,views=20 --out r");
    let evaluate = [&evaluate[..], &["--method", "sharp", "--metrics", "psnr"]].concat();
    at_home(dir.path(), &evaluate).is_error_with(&["recorded on"]);
}
