//! Weights compiled into the program: the metrics' own weights, and those of AlexNet, the only
//! network that is small enough.

use safetensors::SafeTensors;

use super::{Backbone, WeightsError};
use crate::backbone::architecture::tap_channels;
use crate::identity::LpipsNet;

/// A weights file that is compiled in.
pub(crate) struct Embedded {
    file: &'static str,
    bytes: &'static [u8],
}

macro_rules! embedded {
    ($file:literal) => {
        Embedded {
            file: $file,
            bytes: include_bytes!(concat!("../../weights/", $file)),
        }
    };
}

/// The convolutions of torchvision's AlexNet.
pub(crate) const ALEXNET: Embedded = embedded!("alexnet.safetensors");

const LPIPS_ALEX: Embedded = embedded!("lpips_v0.1_alex.safetensors");
const LPIPS_VGG: Embedded = embedded!("lpips_v0.1_vgg.safetensors");
const LPIPS_SQUEEZE: Embedded = embedded!("lpips_v0.1_squeeze.safetensors");
const LPIPS_ALEX_V0: Embedded = embedded!("lpips_v0.0_alex.safetensors");
const LPIPS_VGG_V0: Embedded = embedded!("lpips_v0.0_vgg.safetensors");
const LPIPS_SQUEEZE_V0: Embedded = embedded!("lpips_v0.0_squeeze.safetensors");
const DISTS: Embedded = embedded!("dists.safetensors");

/// LPIPS v0.1: the non-negative weight of each channel, for each tap.
pub(crate) fn linear_weights(net: LpipsNet) -> Result<Vec<Vec<f32>>, WeightsError> {
    let file = match net {
        LpipsNet::Alex => LPIPS_ALEX,
        LpipsNet::Vgg => LPIPS_VGG,
        LpipsNet::Squeeze => LPIPS_SQUEEZE,
    };
    linear(net, &file)
}

/// The linear weights of LPIPS v0.0, one list per layer.
pub(crate) fn linear_weights_v0(net: LpipsNet) -> Result<Vec<Vec<f32>>, WeightsError> {
    let file = match net {
        LpipsNet::Alex => LPIPS_ALEX_V0,
        LpipsNet::Vgg => LPIPS_VGG_V0,
        LpipsNet::Squeeze => LPIPS_SQUEEZE_V0,
    };
    linear(net, &file)
}

fn linear(net: LpipsNet, file: &Embedded) -> Result<Vec<Vec<f32>>, WeightsError> {
    let channels = tap_channels(Backbone::of_lpips(net)).into_iter();
    channels
        .enumerate()
        .map(|(tap, channels)| file.not_negative(&format!("lin{tap}.model.1.weight"), channels))
        .collect()
}

/// DISTS: weights of the structure and texture terms for all 1475 channels.
pub(crate) fn dists_weights() -> Result<[Vec<f32>; 2], WeightsError> {
    let channels = 3 + tap_channels(Backbone::Vgg16).iter().sum::<usize>();
    let weights = |name| DISTS.not_negative(name, channels);
    Ok([weights("alpha")?, weights("beta")?])
}

impl Embedded {
    pub(crate) fn values(&self, name: &str, count: usize) -> Result<Vec<f32>, WeightsError> {
        let tensors =
            SafeTensors::deserialize(self.bytes).map_err(|e| self.damaged(e.to_string()))?;
        let tensor = tensors
            .tensor(name)
            .map_err(|e| self.damaged(e.to_string()))?;
        let (values, _) = tensor.data().as_chunks::<4>();
        if values.len() != count {
            return Err(self.damaged(format!("{name} has {} values, not {count}", values.len())));
        }
        Ok(values.iter().map(|&v| f32::from_le_bytes(v)).collect())
    }

    /// Values of a tensor; rejects negative values, which could make a distance negative.
    fn not_negative(&self, name: &str, count: usize) -> Result<Vec<f32>, WeightsError> {
        let values = self.values(name, count)?;
        if values.iter().all(|value| *value >= 0.0) {
            Ok(values)
        } else {
            Err(self.damaged(format!("{name} has a negative weight")))
        }
    }

    fn damaged(&self, reason: String) -> WeightsError {
        let file = self.file;
        WeightsError::Embedded { file, reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Weights, WeightsSource};

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
    fn the_bundled_networks_are_the_published_ones() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/weights");
        let vgg = format!("{folder}/vgg16.safetensors");
        let sources = [
            (Backbone::AlexNet, WeightsSource::BuiltIn),
            (Backbone::Vgg16, WeightsSource::File(vgg.into())),
        ];
        for (backbone, source) in sources {
            let weights = Weights {
                sources: [(backbone, source)].into(),
            };
            let used = weights.load(backbone).unwrap().unwrap().used;
            assert_eq!(used.features_sha256, backbone.published_features());
        }
    }

    #[test]
    fn damage_is_named() {
        let cut = Embedded {
            bytes: &DISTS.bytes[..90],
            ..DISTS
        };
        for error in [
            cut.values("alpha", 1475),
            DISTS.values("gamma", 1475),
            DISTS.values("alpha", 1474),
            ALEXNET.not_negative("features.0.bias", 64),
        ] {
            let error = error.unwrap_err().to_string();
            assert!(error.contains(".safetensors"), "{error}");
        }
    }
}
