//! Compares features with recorded statistics, and streamed results with each other.

use serde_json::Value;
use sharp_kernels::{Algorithm, Simd};

use super::*;
use crate::picture::{Normalization, Picture};
use crate::weights::{Backbone, Weights};

fn golden(file: &str) -> String {
    format!(
        "{}/../tests/golden/metrics/{file}",
        env!("CARGO_MANIFEST_DIR")
    )
}

fn network(backbone: Backbone, simd: Simd, algorithm: Algorithm) -> (Network, Kernels) {
    let loaded = Weights::deterministic("").load(backbone).unwrap().unwrap();
    let kernels = Kernels { simd, algorithm };
    (Network::new(backbone, &loaded.tensors, kernels), kernels)
}

/// Every tap's features of the first picture, whole.
fn features(
    network: &Network,
    picture: &Picture,
    norm: &Normalization,
    strip: usize,
) -> Vec<Vec<f32>> {
    let (width, height) = picture.dimensions();
    let mut taps = Vec::new();
    stream(
        network,
        (width as usize, height as usize),
        3,
        Some(strip),
        |_, y, out| norm.row(picture, y, out),
        |Taps { tap, rows, .. }| {
            assert!(rows[0] == rows[1] && rows[0] == rows[2] && rows.len() == 3);
            taps.resize(taps.len().max(tap + 1), Vec::new());
            taps[tap].extend_from_slice(rows[0]);
        },
    )
    .unwrap();
    taps
}

#[test]
fn features_are_those_of_torch() {
    let json: Value =
        serde_json::from_str(&std::fs::read_to_string(golden("features.json")).unwrap()).unwrap();
    let picture = image::open(golden("images/rocket_odd97x131_ref.png"))
        .unwrap()
        .to_rgb8();
    let picture = Picture::from(picture);
    let lpips = Normalization::new(2.0, -1.0, [-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]);
    let dists = Normalization::new(1.0, 0.0, [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]);
    let nets = [
        ("lpips_alex", Backbone::AlexNet),
        ("lpips_vgg", Backbone::Vgg16),
        ("lpips_squeeze", Backbone::SqueezeNet1_1),
        ("dists", Backbone::Vgg16),
    ];
    for (name, backbone) in nets {
        for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
            let (mut network, kernels) = network(backbone, Simd::detect(), algorithm);
            let mut taps = Vec::new();
            let mut norm = &lpips;
            if name == "dists" {
                network = network.with_l2_pooling(kernels);
                norm = &dists;
                // DISTS's first tap is the picture itself.
                taps.push(Vec::new());
            }
            taps.extend(features(&network, &picture, norm, 1000));
            let recorded = json[format!("{name}:rocket_odd97x131_ref")]
                .as_array()
                .unwrap();
            assert_eq!(taps.len(), recorded.len());
            for (tap, golden) in taps.iter().zip(recorded).filter(|(tap, _)| !tap.is_empty()) {
                let shape: Vec<usize> = serde_json::from_value(golden["shape"].clone()).unwrap();
                let [_, channels, height, width] = shape[..] else {
                    panic!()
                };
                assert_eq!(tap.len(), channels * height * width, "{name}");
                let max = golden["max"].as_f64().unwrap();
                let at =
                    |x: usize, y: usize, c: usize| f64::from(tap[(y * width + x) * channels + c]);
                let list = |key: &str| -> Vec<f64> {
                    serde_json::from_value(golden[key].clone()).unwrap_or_default()
                };
                let mean = tap.iter().map(|&v| f64::from(v)).sum::<f64>() / tap.len() as f64;
                assert!(
                    (mean - golden["mean"].as_f64().unwrap()).abs() < 2e-5 * max,
                    "{name}"
                );
                let places = [
                    ("first", 0, 0, 0),
                    ("center", width / 2, height / 2, 0),
                    ("last", width - 1, height - 1, channels - 3),
                ];
                for (key, x, y, from) in places {
                    for (i, expected) in list(key).into_iter().enumerate() {
                        let error = (at(x, y, from + i) - expected).abs();
                        assert!(error < 2e-5 * max, "{name} {key} {i}: {error:.1e}");
                    }
                }
            }
        }
    }
}

#[test]
fn the_smallest_pictures_are_those_on_which_every_layer_has_a_pixel() {
    let kernels = Simd::detect();
    for backbone in Backbone::ALL {
        let (network, _) = network(backbone, kernels, Algorithm::Direct);
        let side = network.smallest_side();
        let sizes = network.sizes(side, side).unwrap();
        assert!(sizes.iter().all(|size| size.width >= 1 && size.height >= 1));
        assert!(network.sizes(side - 1, 200).is_none());
    }
}
