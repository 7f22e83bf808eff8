//! Where a network's weights come from, and the list of what it needs.
//!
//! Modules ask for their parameters by name and shape while they are built. The same construction,
//! fed by [`inventory`], yields the list of everything a configuration needs, so that list and
//! modules cannot disagree.

use std::cell::RefCell;
use std::path::Path;

use candle_core::{DType, Device, Tensor};
use sharp_checkpoint::{Checkpoint, Expected};

use super::{ModelConfig, ModelError};

/// Gives parameters to modules under construction.
pub trait Source {
    /// The parameter called `name`, f32, of exactly `shape`.
    ///
    /// # Errors
    /// [`ModelError`] when it is not to be had.
    fn tensor(&self, name: &str, shape: &[usize]) -> Result<Tensor, ModelError>;

    /// Tells of a parameter that the checkpoint has and inference never uses.
    fn unused(&self, name: &str, shape: &[usize]);
}

/// A source at a place in the tree of modules.
#[derive(Clone)]
pub struct Params<'a> {
    source: &'a dyn Source,
    path: String,
}

impl<'a> Params<'a> {
    /// The root.
    pub fn new(source: &'a dyn Source) -> Self {
        Self {
            source,
            path: String::new(),
        }
    }

    /// The module `name` below this one.
    pub fn pp(&self, name: impl std::fmt::Display) -> Self {
        Self {
            source: self.source,
            path: self.name(name),
        }
    }

    /// A parameter of this module.
    ///
    /// # Errors
    /// [`ModelError`] of the source.
    pub fn get(&self, name: &str, shape: &[usize]) -> Result<Tensor, ModelError> {
        self.source.tensor(&self.name(name), shape)
    }

    /// Declares a parameter of this module that inference does not use.
    pub fn unused(&self, name: &str, shape: &[usize]) {
        self.source.unused(&self.name(name), shape);
    }

    fn name(&self, name: impl std::fmt::Display) -> String {
        if self.path.is_empty() {
            name.to_string()
        } else {
            format!("{}.{name}", self.path)
        }
    }
}

/// One parameter of a network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// As in the checkpoint.
    pub name: String,
    /// As PyTorch lays it out.
    pub shape: Vec<usize>,
    /// False for what is in the checkpoint but never used at inference.
    pub used: bool,
}

impl Parameter {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// True for a parameter without values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Everything the network of `config` has, in order of construction.
///
/// # Errors
/// [`ModelError::Config`] for an impossible configuration.
pub fn inventory(config: &ModelConfig) -> Result<Vec<Parameter>, ModelError> {
    config.validate()?;
    let inventory = Inventory::default();
    super::predictor::Network::new(config, &Params::new(&inventory))?;
    Ok(inventory.0.into_inner())
}

/// A checkpoint file as a network's source.
pub struct CheckpointSource {
    checkpoint: Checkpoint,
    device: Device,
}

impl CheckpointSource {
    /// Opens a `.pt` or `.safetensors` file; tensors go to `device`.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`].
    pub fn open(path: &Path, device: &Device) -> Result<Self, ModelError> {
        Ok(Self {
            checkpoint: Checkpoint::open(path)?,
            device: device.clone(),
        })
    }

    /// Checks that the file holds every parameter of `config` that inference uses, in its shape,
    /// and nothing that the network does not know but for names that begin with one of
    /// `allow_unused`. What inference never uses ([`Parameter::used`]) may be absent.
    ///
    /// # Errors
    /// [`ModelError::Incomplete`] with everything that differs; [`ModelError::Config`].
    pub fn check(&self, config: &ModelConfig, allow_unused: &[String]) -> Result<(), ModelError> {
        let expected: Vec<Expected> = inventory(config)?
            .into_iter()
            .filter(|p| p.used || self.checkpoint.contains(&p.name))
            .map(|p| Expected {
                name: p.name,
                shape: p.shape,
            })
            .collect();
        Ok(self.checkpoint.check(&expected, allow_unused)?)
    }
}

impl Source for CheckpointSource {
    fn tensor(&self, name: &str, shape: &[usize]) -> Result<Tensor, ModelError> {
        let values = self.checkpoint.tensor_f32(name)?;
        Ok(Tensor::from_vec(values, shape, &self.device)?)
    }

    fn unused(&self, _: &str, _: &[usize]) {}
}

/// Notes what is asked for and answers with zeros that take no memory.
#[derive(Default)]
struct Inventory(RefCell<Vec<Parameter>>);

impl Inventory {
    fn note(&self, name: &str, shape: &[usize], used: bool) {
        self.0.borrow_mut().push(Parameter {
            name: name.to_owned(),
            shape: shape.to_vec(),
            used,
        });
    }
}

impl Source for Inventory {
    fn tensor(&self, name: &str, shape: &[usize]) -> Result<Tensor, ModelError> {
        self.note(name, shape, true);
        Ok(Tensor::zeros((), DType::F32, &Device::Cpu)?.broadcast_as(shape)?)
    }

    fn unused(&self, name: &str, shape: &[usize]) {
        self.note(name, shape, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// The official state dict, names and shapes, against ours.
    #[test]
    fn the_releases_parameters_are_exactly_the_official_ones() {
        let csv = include_str!("../../../tests/golden/model/state_dict.csv");
        let official: BTreeMap<String, Vec<usize>> = csv
            .lines()
            .skip(1)
            .map(|line| {
                let mut fields = line.split(',');
                let name = fields.next().unwrap().to_owned();
                let shape = fields.next().unwrap().split('x');
                (name, shape.map(|d| d.parse().unwrap()).collect())
            })
            .collect();
        let ours = inventory(&ModelConfig::release()).unwrap();
        assert_eq!(ours.len(), 1038);
        assert_eq!(ours.iter().map(Parameter::len).sum::<usize>(), 702_305_169);
        let ours: BTreeMap<String, Vec<usize>> =
            ours.into_iter().map(|p| (p.name, p.shape)).collect();
        assert_eq!(ours, official);
    }

    #[test]
    fn another_stride_changes_the_skip_convolution() {
        let mut config = ModelConfig::release();
        config.gaussian_stride = 4;
        let skip = "feature_model.image_encoder.conv.weight";
        let found = inventory(&config).unwrap();
        let skip = found.iter().find(|p| p.name == skip).unwrap();
        assert_eq!(skip.shape, [128, 5, 4, 4]);
    }

    fn tiny() -> ModelConfig {
        let file = "/../tests/golden/model/tiny_config.json#tiny";
        ModelConfig::load(&format!("{}{file}", env!("CARGO_MANIFEST_DIR"))).unwrap()
    }

    fn official_tiny() -> CheckpointSource {
        let file = "/../tests/golden/model/tiny_model.pt";
        let file = format!("{}{file}", env!("CARGO_MANIFEST_DIR"));
        CheckpointSource::open(Path::new(&file), &Device::Cpu).unwrap()
    }

    #[test]
    fn an_official_checkpoint_holds_the_deterministic_weights_and_nothing_else() {
        let source = official_tiny();
        source.check(&tiny(), &[]).unwrap();
        for parameter in inventory(&tiny()).unwrap() {
            let found = source.tensor(&parameter.name, &parameter.shape).unwrap();
            let found: Vec<f32> = found.flatten_all().unwrap().to_vec1().unwrap();
            let expected = sharp_checkpoint::deterministic::model_weights(
                "",
                &parameter.name,
                &parameter.shape,
            );
            assert_eq!(found, expected, "{}", parameter.name);
        }
    }

    #[test]
    fn everything_that_does_not_fit_is_listed_at_once() {
        let mut wider = tiny();
        wider.gaussian_dim_out = 16;
        wider.vit.depth = 5;
        let message = official_tiny().check(&wider, &[]).unwrap_err().to_string();
        for line in [
            "28 missing, 0 surplus, 6 of another shape",
            "patch_encoder.blocks.4.attn.qkv.weight [96, 32]",
            "prediction_head.texture_prediction_head.weight [22, 8, 1, 1], expected [22, 16, 1, 1]",
        ] {
            assert!(message.contains(line), "{message}");
        }
        let mut shallower = tiny();
        shallower.vit.depth = 3;
        shallower.hook_ids = [0, 1, 2, 2];
        let refused = official_tiny()
            .check(&shallower, &[])
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains("0 missing, 28 surplus, 0 of another shape"),
            "{refused}"
        );
        let encoder = "monodepth_model.monodepth_predictor.encoder.";
        let allowed = ["patch", "image"].map(|k| format!("{encoder}{k}_encoder.blocks.3."));
        official_tiny().check(&shallower, &allowed).unwrap();
    }
}
