//! `record` and `parity`: the stage at which a changed model first differs.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;
use sharp_checkpoint::{Checkpoint, OutTensor, write_safetensors};

use crate::support::{Said, sharp_bench as run, words};
use crate::tiny::{golden, recorded_input, tiny, with_checkpoint};

/// Runs `parity` of a checkpoint against the official recording.
fn parity(dir: &Path, model: &[String; 4], focal: &str, more: &[&str]) -> Said {
    let (image, _) = recorded_input();
    let recording = golden("golden_tiny.safetensors");
    let mut args = vec!["parity", "--image", &image, "--focal-px", focal];
    args.extend(["--golden", &recording]);
    args.extend(model.iter().map(String::as_str));
    args.extend(more);
    run(dir, &args)
}

/// Writes the official tiny weights with one value of one tensor changed.
fn with_one_value_changed(tensor: &str, to: &Path) {
    let official = Checkpoint::open(golden("tiny_model.pt")).unwrap();
    let tensors: Vec<OutTensor> = official
        .names()
        .map(|name| OutTensor {
            name: name.to_owned(),
            dtype: official.dtype(name).unwrap(),
            shape: official.shape(name).unwrap().to_vec(),
        })
        .collect();
    assert!(official.contains(tensor), "{tensor}");
    write_safetensors(to, &BTreeMap::new(), &tensors, |out| {
        let mut bytes = official.tensor_bytes(&out.name)?;
        if out.name == tensor {
            let value = f32::from_le_bytes(bytes[..4].try_into().unwrap()) + 0.5;
            bytes[..4].copy_from_slice(&value.to_le_bytes());
        }
        Ok(Cow::Owned(bytes))
    })
    .unwrap();
}

fn keys(value: &Value) -> Vec<&str> {
    value
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect()
}

#[test]
fn parity_with_the_official_recording_in_the_documented_form() {
    let dir = tempfile::tempdir().unwrap();
    // The recording in the file is found by the photograph's name.
    let json = parity(
        dir.path(),
        &tiny(),
        "500",
        &["--tolerance", "5e-6", "--json", "--exact"],
    )
    .ends_with(0)
    .json();
    assert_eq!(keys(&json), ["stages", "first_divergence"]);
    assert!(json["first_divergence"].is_null());
    let stages = json["stages"].as_array().unwrap();
    assert!(stages.len() > 80, "{}", stages.len());
    for stage in stages {
        assert_eq!(keys(stage), ["stage", "rel_error", "values"]);
        assert!(stage["rel_error"].as_f64().unwrap() <= 5e-6, "{stage}");
        assert!(stage["values"].as_u64().unwrap() > 0, "{stage}");
    }
    let names: Vec<&str> = stages
        .iter()
        .map(|s| s["stage"].as_str().unwrap())
        .collect();
    assert!(!names.contains(&"world.quaternions"));
    for stage in [
        "world.covariance6",
        "world.singular_values",
        "alignment.map",
    ] {
        assert!(names.contains(&stage), "{stage}");
    }
    // In the recording, large stages are sampled and small ones are complete.
    let values = |name: &str| {
        let stage = stages.iter().find(|s| s["stage"] == name).unwrap();
        stage["values"].as_u64().unwrap()
    };
    assert_eq!(values("deltas"), 14 * 2 * 96 * 96);
    assert!(stages.iter().any(|s| s["values"] == 512));

    let said = parity(dir.path(), &tiny(), "500", &["--prefix", "tiny"]).ends_with(0);
    assert!(said.out.contains("stages within 1.0e-4"), "{}", said.out);
    parity(dir.path(), &tiny(), "500", &["--prefix", "nobody"]).is_error_with(&[
        "golden_tiny.safetensors",
        "nobody",
        "available: tiny",
    ]);
}

#[test]
fn the_first_stage_that_diverges_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let depth = "monodepth_model.monodepth_predictor.";
    for (tensor, stage) in [
        ("encoder.patch_encoder.pos_embed", "patch_encoder.tokens_in"),
        (
            "encoder.image_encoder.blocks.2.mlp.fc1.bias",
            "image_encoder.block2",
        ),
        ("decoder.fusions.2.out_conv.bias", "depth_decoder.fusion2"),
    ] {
        let file = dir.path().join("changed.safetensors");
        with_one_value_changed(&format!("{depth}{tensor}"), &file);
        let model = with_checkpoint(file.to_str().unwrap());
        let said = parity(dir.path(), &model, "500", &["--json"]).ends_with(1);
        assert_eq!(said.json()["first_divergence"], stage, "{tensor}");
        let named = format!("diverges first at stage {stage}");
        assert!(said.err.contains(&named), "{}", said.err);
        // A tolerance larger than the change accepts it.
        parity(dir.path(), &model, "500", &["--tolerance", "1e9"]).ends_with(0);
    }
    // Another focal length gives another prediction.
    let said = parity(dir.path(), &tiny(), "77", &["--json"]).ends_with(1);
    assert_eq!(said.json()["first_divergence"], "disparity_factor");
}

#[test]
fn a_device_that_this_build_lacks_is_an_error_that_says_how_to_get_it() {
    let dir = tempfile::tempdir().unwrap();
    for (device, built) in [
        ("cuda", cfg!(feature = "cuda")),
        ("metal", cfg!(feature = "metal")),
    ] {
        if !built {
            parity(dir.path(), &tiny(), "500", &["--device", device])
                .is_error_with(&[&format!("--features {device}")]);
        }
    }
    parity(dir.path(), &tiny(), "500", &["--device", "auto"]).ends_with(0);
    parity(dir.path(), &tiny(), "500", &["--device", "tpu"]).ends_with(2);
}

/// Evaluates two models with the same file name: in two folders, in one run, one after the other in one folder, and
/// after one file has replaced the other.
#[test]
fn two_models_of_one_file_name_share_no_number() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for (folder, head) in [("a", "geometry"), ("b", "texture")] {
        std::fs::create_dir(dir.join(folder)).unwrap();
        let bias = format!("feature_model.{head}_head.3.bias");
        with_one_value_changed(&bias, &dir.join(folder).join("model.safetensors"));
    }
    let config = golden("tiny_config.json#tiny");
    let method = |label: &str, folder: &str| {
        format!("sharp:label={label},checkpoint={folder}/model.safetensors,config={config}")
    };
    let evaluated = |out: &str, methods: &[String]| {
        let line = format!(
            "run --dataset=S:synthetic=size=96x72,views=20 --limit=2 --metrics=psnr \
             --keep-gaussians --json --out {out}",
        );
        let what = words(&line);
        let methods = methods.iter().flat_map(|method| ["--method", method]);
        let args: Vec<&str> = what.into_iter().chain(methods).collect();
        let json = run(dir, &args).ends_with(0).json();
        let scores = std::fs::read_to_string(dir.join(out).join("scores.csv")).unwrap();
        (scores, json["reused"].as_u64().unwrap())
    };
    let net = |folder: &str| [method("net", folder)];
    let (of_a, _) = evaluated("alone-a", &net("a"));
    let (of_b, _) = evaluated("alone-b", &net("b"));
    assert_ne!(of_a, of_b);
    // One after the other in the same folder.
    assert_eq!(evaluated("r", &net("a")), (of_a.clone(), 0));
    assert_eq!(evaluated("r", &net("a")), (of_a.clone(), 2));
    assert_eq!(evaluated("r", &net("b")), (of_b.clone(), 0));
    // In the same run.
    let (both, _) = evaluated("both", &[method("one", "a"), method("two", "b")]);
    let rows = |label: &str| -> String {
        let named = format!(",{label},");
        let rows = both.lines().filter(|row| row.contains(&named));
        rows.map(|row| row.replacen(&named, ",net,", 1) + "\n")
            .collect()
    };
    assert!(of_a.ends_with(&rows("one")) && of_b.ends_with(&rows("two")));
    // Swapped, keeping the modification times of the first.
    let (file, other) = (
        dir.join("a/model.safetensors"),
        dir.join("b/model.safetensors"),
    );
    assert_eq!(evaluated("s", &net("a")), (of_a, 0));
    let written = std::fs::metadata(&file).unwrap().modified().unwrap();
    std::fs::copy(other, &file).unwrap();
    let opened = std::fs::File::options().write(true).open(&file).unwrap();
    opened.set_modified(written).unwrap();
    drop(opened);
    assert_eq!(evaluated("s", &net("a")), (of_b, 0));
}
