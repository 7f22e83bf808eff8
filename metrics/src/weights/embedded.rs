//! The metrics' own weights, which ship with the crate.

use safetensors::SafeTensors;

use super::{Backbone, WeightsError};
use crate::backbone::architecture::tap_channels;
use crate::identity::LpipsNet;

/// LPIPS v0.1: for each tap the non-negative weight of each channel.
pub(crate) fn linear_weights(net: LpipsNet) -> Result<Vec<Vec<f32>>, WeightsError> {
    let (file, bytes): (_, &[u8]) = match net {
        LpipsNet::Alex => (
            "lpips_v0.1_alex.safetensors",
            include_bytes!("../../weights/lpips_v0.1_alex.safetensors"),
        ),
        LpipsNet::Vgg => (
            "lpips_v0.1_vgg.safetensors",
            include_bytes!("../../weights/lpips_v0.1_vgg.safetensors"),
        ),
        LpipsNet::Squeeze => (
            "lpips_v0.1_squeeze.safetensors",
            include_bytes!("../../weights/lpips_v0.1_squeeze.safetensors"),
        ),
    };
    let channels = tap_channels(Backbone::of_lpips(net))
        .into_iter()
        .enumerate();
    channels
        .map(|(tap, channels)| read(file, bytes, &format!("lin{tap}.model.1.weight"), channels))
        .collect()
}

/// DISTS: weights of the structure and of the texture terms for all 1475 channels.
pub(crate) fn dists_weights() -> Result<[Vec<f32>; 2], WeightsError> {
    let bytes = include_bytes!("../../weights/dists.safetensors");
    let channels = 3 + tap_channels(Backbone::Vgg16).iter().sum::<usize>();
    let weights = |name| read("dists.safetensors", bytes, name, channels);
    Ok([weights("alpha")?, weights("beta")?])
}

fn read(
    file: &'static str,
    bytes: &[u8],
    name: &str,
    channels: usize,
) -> Result<Vec<f32>, WeightsError> {
    let damaged = |reason: String| WeightsError::Embedded { file, reason };
    let tensors = SafeTensors::deserialize(bytes).map_err(|e| damaged(e.to_string()))?;
    let tensor = tensors.tensor(name).map_err(|e| damaged(e.to_string()))?;
    let (values, _) = tensor.data().as_chunks::<4>();
    let values: Vec<f32> = values.iter().map(|&v| f32::from_le_bytes(v)).collect();
    // A negative weight would let a distance be negative.
    if values.len() == channels && values.iter().all(|value| *value >= 0.0) {
        Ok(values)
    } else {
        Err(damaged(format!(
            "{name} is not {channels} non-negative weights"
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_are_whole() {
        for (net, taps) in [
            (LpipsNet::Alex, 5),
            (LpipsNet::Vgg, 5),
            (LpipsNet::Squeeze, 7),
        ] {
            assert_eq!(linear_weights(net).unwrap().len(), taps);
        }
        let [alpha, beta] = dists_weights().unwrap();
        assert_eq!((alpha.len(), beta.len()), (1475, 1475));
        let sum: f64 = alpha.iter().chain(&beta).map(|&w| f64::from(w)).sum();
        assert!((sum - 0.999_999_83).abs() < 1e-8, "{sum}");
    }

    #[test]
    fn damage_is_named() {
        let bytes = include_bytes!("../../weights/dists.safetensors");
        for error in [
            read("dists.safetensors", &bytes[..90], "alpha", 1475),
            read("dists.safetensors", bytes, "gamma", 1475),
            read("dists.safetensors", bytes, "alpha", 1474),
        ] {
            let error = error.unwrap_err().to_string();
            assert!(error.contains("dists.safetensors"), "{error}");
        }
    }
}
