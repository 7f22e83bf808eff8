//! A network and everything that its predictions depend on.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use sharp_checkpoint::hash::sha256_hex;

use super::inventory::CheckpointSource;
use super::{Algorithm, DeviceChoice, ModelConfig, ModelError};

/// A network to [open](super::Predictor::open).
#[derive(Debug, Clone)]
pub struct NetworkSpec {
    /// `.pt` or `.safetensors`.
    pub checkpoint: PathBuf,
    pub config: ModelConfig,
    /// Name prefixes of tensors that the checkpoint may hold besides the network's.
    pub allow_unused: Vec<String>,
    pub device: DeviceChoice,
    /// Of 3×3 kernels; matters on the CPU alone.
    pub convolution: Algorithm,
    /// How its file was read beyond what was asked for, for people.
    pub notes: Vec<String>,
}

/// Everything besides its input that a prediction depends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NetworkIdentity {
    pub checkpoint_sha256: String,
    /// The configuration's own name, for people; the hash decides.
    pub preset: String,
    /// Of the configuration's values, whatever file they stand in.
    pub config_sha256: String,
    /// [`Compute::name`](super::Compute::name) of the device found, not of the one asked for.
    pub engine: String,
}

impl NetworkSpec {
    /// The release's network on the CPU, with the faster convolutions.
    pub fn release(checkpoint: impl Into<PathBuf>) -> Self {
        Self {
            checkpoint: checkpoint.into(),
            config: ModelConfig::release(),
            allow_unused: Vec::new(),
            device: DeviceChoice::Cpu,
            convolution: Algorithm::Winograd,
            notes: Vec::new(),
        }
    }

    /// Reads the whole checkpoint for its hash: seconds for the release's.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`], [`ModelError::Device`].
    pub fn identity(&self) -> Result<NetworkIdentity, ModelError> {
        Ok(NetworkIdentity {
            engine: self.device.open(self.convolution)?.name(),
            checkpoint_sha256: CheckpointSource::open(&self.checkpoint)?.sha256()?,
            preset: self.config.preset.clone(),
            // Debug output of numbers, texts and lists of them is unambiguous and cannot fail.
            config_sha256: sha256_hex(format!("{:?}", self.config).as_bytes()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Predictor;

    #[test]
    fn identity_is_what_computes() {
        let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/golden/model");
        let mut spec = NetworkSpec {
            config: ModelConfig::load(&format!("{golden}/tiny_config.json#tiny")).unwrap(),
            ..NetworkSpec::release(format!("{golden}/tiny_model.pt"))
        };
        let plain = spec.identity().unwrap();
        assert_eq!(plain.checkpoint_sha256.len(), 64);
        assert!(plain.engine.starts_with("cpu-"), "{}", plain.engine);
        spec.allow_unused.push("ema.".into());
        assert_eq!(spec.identity().unwrap(), plain);
        spec.convolution = Algorithm::Direct;
        assert_ne!(spec.identity().unwrap().engine, plain.engine);
        spec.config.vit.norm_eps = 1e-5;
        assert_ne!(spec.identity().unwrap().config_sha256, plain.config_sha256);
        assert_eq!(Predictor::open(&spec).unwrap().config(), &spec.config);
    }
}
