//! Compares a file written by PyTorch with the weights that it is known to contain.

use std::path::Path;

use sharp_checkpoint::deterministic::{backbone_weights, model_weights};
use sharp_checkpoint::{Checkpoint, Expected};

fn golden(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/golden")
        .join(name)
}

#[test]
fn every_tensor_of_a_real_state_dict_bit_for_bit() {
    let found = Checkpoint::open(golden("model/tiny_model.pt")).unwrap();
    assert!(found.others().is_empty());
    let mut expected = Vec::new();
    for name in found.names() {
        let shape = found.shape(name).unwrap().to_vec();
        let values = found.tensor_f32(name).unwrap();
        assert_eq!(values, model_weights("", name, &shape), "{name}");
        let name = name.to_owned();
        expected.push(Expected { name, shape });
    }
    assert_eq!(expected.len(), 405);
    found.check(&expected, &[] as &[&str]).unwrap();
}

#[test]
fn backbone_weights_match_their_recorded_values() {
    let text = std::fs::read_to_string(golden("metrics/weights_vectors.json")).unwrap();
    let vectors: serde_json::Value = serde_json::from_str(&text).unwrap();
    let tensors = vectors["tensors"].as_object().unwrap();
    assert!(tensors.len() > 3);
    for (name, recorded) in tensors {
        let shape: Vec<usize> = serde_json::from_value(recorded["shape"].clone()).unwrap();
        let values = backbone_weights("", name, &shape);
        let first: Vec<f64> = serde_json::from_value(recorded["first8"].clone()).unwrap();
        for (value, recorded) in values.iter().zip(first) {
            assert_eq!(f64::from(*value), recorded, "{name}");
        }
        let last = values[values.len() - 1];
        assert_eq!(
            f64::from(last),
            recorded["last"].as_f64().unwrap(),
            "{name}"
        );
        let sum: f64 = values.iter().map(|&v| f64::from(v)).sum();
        assert!(
            (sum - recorded["sum_f64"].as_f64().unwrap()).abs() < 1e-9,
            "{name}"
        );
    }
}

#[test]
fn the_hash_is_that_of_the_file() {
    let found =
        Checkpoint::open(golden("metrics/weights/lpips_v0.1_alex_lin.safetensors")).unwrap();
    assert_eq!(found.shape("lin0.model.1.weight").unwrap(), [1, 64, 1, 1]);
    let hash = "255d6454292d155a069f693a111769acec003d588617b250f24775369c816e04";
    assert_eq!(found.sha256().unwrap(), hash);
}
