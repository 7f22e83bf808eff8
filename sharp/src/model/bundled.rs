//! The small network bundled with the source code: the configuration is compiled in; the weights
//! are in the file `sharp/mini/mini.safetensors`, which is distributed with the programs.

use std::path::Path;

use super::inventory::inventory;
use super::params::Parameter;
use super::{ModelConfig, ModelError};

/// Name used in place of a checkpoint's path.
pub const NAME: &str = "mini";

/// File name of the network's weights.
pub const FILE: &str = "mini.safetensors";

/// Configuration of the network.
///
/// # Errors
/// If the compiled-in configuration is invalid.
pub fn config() -> Result<ModelConfig, ModelError> {
    let text = include_str!("../../mini/mini.json");
    let config: ModelConfig = serde_json::from_str(text)
        .map_err(|error| ModelError::file(Path::new("mini.json"), error))?;
    config.validate()?;
    Ok(config)
}

/// SHA-256 of the weights file, 64 lower-case hexadecimal digits.
pub fn weights_sha256() -> &'static str {
    let line = include_str!("../../mini/mini.sha256");
    line.split(' ').next().unwrap_or_default()
}

/// Folder of the weights file in this repository.
pub fn source_folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/mini"))
}

/// A one-line description of the network, for messages and lists.
///
/// # Errors
/// As for [`config`].
pub fn description() -> Result<String, ModelError> {
    let count: usize = inventory(&config()?)?.iter().map(Parameter::len).sum();
    let millions = count as f64 / 1e6;
    Ok(format!(
        "SHARP architecture, {millions:.1} million parameters, trained on procedural scenes; not Apple's model"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::inventory::CheckpointSource;

    #[test]
    fn the_weights_are_those_of_the_sizes_and_the_hash() {
        let source = CheckpointSource::open(&source_folder().join(FILE)).unwrap();
        assert_eq!(source.sha256().unwrap(), weights_sha256());
        source.check(&config().unwrap(), &[]).unwrap();
        assert!(description().unwrap().starts_with("SHARP architecture, "));
    }
}
