//! A network and everything that its predictions depend on.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::config::config_sha256;
use super::inventory::CheckpointSource;
use super::{Algorithm, DeviceChoice, ModelConfig, ModelError};

/// Description of a network to [open](super::Predictor::open).
#[derive(Debug, Clone)]
pub struct NetworkSpec {
    /// Path of a `.pt` or `.safetensors` file.
    pub checkpoint: PathBuf,
    pub config: ModelConfig,
    /// Name prefixes of extra tensors that the checkpoint may contain.
    pub allow_unused: Vec<String>,
    pub device: DeviceChoice,
    /// Algorithm for 3×3 convolutions; only used on the CPU.
    pub convolution: Algorithm,
    /// Human-readable notes on how the file was interpreted.
    pub notes: Vec<String>,
}

/// Everything except the input on which a prediction depends.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NetworkIdentity {
    pub checkpoint_sha256: String,
    /// Name of the configuration, for display; the hash identifies it.
    pub preset: String,
    /// SHA-256 of the configuration's values, independent of the file they were read from.
    pub config_sha256: String,
    /// [`Compute::name`](super::Compute::name) of the device that is actually used, which may
    /// differ from the requested one.
    pub engine: String,
}

impl NetworkSpec {
    /// The SHARP release's network on the CPU, with the faster convolutions.
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

    /// Computes the identity. Hashes the whole checkpoint, which takes seconds for the SHARP release's.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] if the file cannot be read; [`ModelError::Device`] if the device is not available.
    pub fn identity(&self) -> Result<NetworkIdentity, ModelError> {
        Ok(NetworkIdentity {
            engine: self.device.open(self.convolution)?.name(),
            checkpoint_sha256: CheckpointSource::open(&self.checkpoint)?.sha256()?,
            preset: self.config.preset.clone(),
            config_sha256: config_sha256(&self.config),
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
