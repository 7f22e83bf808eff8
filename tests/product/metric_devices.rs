//! `--device` of `metrics` and `run`: its effects, its errors, and results that must not be mixed.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sharp_checkpoint::deterministic::backbone_weights;
use sharp_checkpoint::{DType, OutTensor, write_safetensors};

use crate::support::{read, sharp_bench as run, words};

/// Index, inputs, squeezed channels and outputs per half of each of SqueezeNet's modules.
const FIRES: [(usize, usize, usize, usize); 8] = [
    (3, 64, 16, 64),
    (4, 128, 16, 64),
    (6, 128, 32, 128),
    (7, 256, 32, 128),
    (9, 256, 48, 192),
    (10, 384, 48, 192),
    (11, 384, 64, 256),
    (12, 512, 64, 256),
];

/// Writes deterministic weights of SqueezeNet.
fn squeezenet(path: &Path) {
    let mut convolutions = vec![("0".to_owned(), [64, 3, 3, 3])];
    for (index, inputs, squeezed, expanded) in FIRES {
        let mut part = |name: &str, shape| convolutions.push((format!("{index}.{name}"), shape));
        part("squeeze", [squeezed, inputs, 1, 1]);
        part("expand1x1", [expanded, squeezed, 1, 1]);
        part("expand3x3", [expanded, squeezed, 3, 3]);
    }
    let tensor = |name: String, shape: &[usize]| OutTensor {
        name,
        dtype: DType::F32,
        shape: shape.to_vec(),
    };
    let both = |(name, shape): &(String, [usize; 4])| {
        [
            tensor(format!("features.{name}.weight"), shape),
            tensor(format!("features.{name}.bias"), &shape[..1]),
        ]
    };
    let tensors: Vec<OutTensor> = convolutions.iter().flat_map(both).collect();
    write_safetensors(path, &BTreeMap::new(), &tensors, |tensor| {
        let name = format!("squeezenet1_1.{}", tensor.name);
        let values = backbone_weights("", &name, &tensor.shape);
        Ok(Cow::Owned(
            values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        ))
    })
    .unwrap();
}

fn image(side: &str) -> String {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/metrics/images");
    let name = format!("rocket_odd97x131_{side}.png");
    folder.join(name).display().to_string()
}

#[test]
fn candles_tensors_give_the_same_numbers_and_say_where_they_were_computed() {
    let dir = tempfile::tempdir().unwrap();
    squeezenet(&dir.path().join("s.safetensors"));
    let learned = words("--metrics lpips-squeeze --weights squeezenet1_1=s.safetensors");
    let (a, b) = (image("dist"), image("ref"));
    let score = |device: &str| {
        let args = ["metrics", &a, &b, "--device", device, "--json"];
        run(dir.path(), &[&args[..], &learned].concat())
    };
    let number = |device: &str| {
        let json = score(device).ends_with(0).json();
        json["mean"]["lpips[squeeze,v0.1]"].as_f64().unwrap()
    };
    let (kernels, tensors) = (number("cpu"), number("candle-cpu"));
    assert!((kernels - tensors).abs() < 1e-5, "{kernels} and {tensors}");
    for device in ["cuda", "metal"] {
        let built = match device {
            "cuda" => cfg!(feature = "cuda"),
            _ => cfg!(feature = "metal"),
        };
        if !built {
            score(device).is_error_with(&["--device", &format!("--features {device}")]);
        }
    }
    score("tpu").ends_with(2);

    // Two runs that differ only in the device are not combined in one table.
    for (device, method) in [("cpu", "copy"), ("candle-cpu", "mean")] {
        let args = words("run --dataset S:synthetic=size=96x72,views=20 --limit 1");
        let rest = ["--method", method, "--out", device, "--device", device];
        run(dir.path(), &[&args[..], &rest, &learned].concat()).ends_with(0);
        let manifest = read(dir.path().join(device).join("manifest.json"));
        let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
        assert_eq!(manifest["metric_networks"]["device"], device);
    }
    run(
        dir.path(),
        &["report", "cpu", "candle-cpu", "--out", "both"],
    )
    .is_error_with(&[
        "the device behind LPIPS and DISTS",
        "\"cpu\"",
        "\"candle-cpu\"",
    ]);
}
