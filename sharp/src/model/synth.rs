//! Deterministic weights for a network, to compare implementations without a checkpoint.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use sharp_checkpoint::deterministic::model_weights;
use sharp_checkpoint::{DType, OutTensor, write_safetensors};

use super::inventory::inventory;
pub use super::params::Synth;
use super::{ModelConfig, ModelError};

/// Writes deterministic weights of all parameters of `config` to a safetensors file, with one tensor in memory at a
/// time.
///
/// # Errors
/// [`ModelError::Config`] for an impossible configuration; [`ModelError::Checkpoint`] if `path` cannot be written.
pub fn write(config: &ModelConfig, salt: &str, path: &Path) -> Result<(), ModelError> {
    let tensors: Vec<OutTensor> = inventory(config)?
        .into_iter()
        .map(|p| OutTensor {
            name: p.name,
            dtype: DType::F32,
            shape: p.shape,
        })
        .collect();
    let metadata = BTreeMap::from([
        ("weights".to_owned(), "deterministic".to_owned()),
        ("salt".to_owned(), salt.to_owned()),
        ("preset".to_owned(), config.preset.clone()),
    ]);
    Ok(write_safetensors(path, &metadata, &tensors, |tensor| {
        let values = model_weights(salt, &tensor.name, &tensor.shape);
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        Ok(Cow::Owned(bytes))
    })?)
}
