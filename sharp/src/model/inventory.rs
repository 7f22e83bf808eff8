//! List of a network's parameters, and checks of a checkpoint against it.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use sharp_checkpoint::{Checkpoint, Expected};

use super::network::SharpNetwork;
use super::params::{Parameter, Params, Synth, WeightSource, Weights};
use super::{Algorithm, Compute, ModelConfig, ModelError};

/// All parameters of the network of `config`, in order of construction.
///
/// # Errors
/// [`ModelError::Config`] for an impossible configuration.
pub fn inventory(config: &ModelConfig) -> Result<Vec<Parameter>, ModelError> {
    config.validate()?;
    Ok(declared(|p| SharpNetwork::new(config, p)))
}

/// All parameters that the construction of a network declares.
pub(super) fn declared<N>(build: impl FnOnce(&Params<'_>) -> N) -> Vec<Parameter> {
    let (list, nowhere) = (RefCell::default(), Compute::cpu(Algorithm::Direct));
    let nothing = Weights::new(Synth::default(), |_| false);
    build(&Params::new(&nowhere, &nothing, &list));
    list.into_inner()
}

/// A checkpoint file as a source of weights.
#[derive(Debug)]
pub struct CheckpointSource {
    file: Checkpoint,
    left_out: Option<String>,
}

impl CheckpointSource {
    /// Opens a `.pt` or `.safetensors` file. Prefixes and components that wrappers add to all names
    /// (`module.`, `_orig_mod.`, `model.`) are removed.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] if the file cannot be read; [`ModelError::File`] if names have different prefixes.
    pub fn open(path: &Path) -> Result<Self, ModelError> {
        Self::open_with(path, &inventory(&ModelConfig::release())?)
    }

    /// Like [`Self::open`], for a network whose parameters have the names in `parameters`; their
    /// shapes are ignored.
    pub(super) fn open_with(path: &Path, parameters: &[Parameter]) -> Result<Self, ModelError> {
        let roots = parameters.iter().filter_map(|p| p.name.split('.').next());
        // The first components of names are the same for all sizes.
        let roots: BTreeSet<String> = roots.map(str::to_owned).collect();
        let mut file = Checkpoint::open(path)?;
        let left_out = file.without_prefix(&roots).map_err(|prefixes| {
            let prefixes = prefixes.iter().map(|prefix| format!("`{prefix}`"));
            ModelError::File {
                path: path.to_owned(),
                reason: format!(
                    "its names have several prefixes ({}); save the tensors of only one network",
                    prefixes.collect::<Vec<_>>().join(", ")
                ),
            }
        })?;
        Ok(Self { file, left_out })
    }

    /// Wrapper prefix or components removed from all names, e.g. `module._orig_mod.`.
    pub fn left_out(&self) -> Option<&str> {
        self.left_out.as_deref()
    }

    /// True if the name of any tensor begins with `prefix`.
    pub fn has(&self, prefix: &str) -> bool {
        self.file.names().any(|name| name.starts_with(prefix))
    }

    /// SHA-256 of the whole file, 64 hexadecimal digits.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] if the file cannot be read.
    pub fn sha256(&self) -> Result<String, ModelError> {
        Ok(self.file.sha256()?)
    }

    /// Checks that the file contains every parameter of `config` used at inference, with its shape, and no unknown
    /// tensor except those whose names begin with one of `allow_unused`. Parameters not used at inference
    /// ([`Parameter::used`]) may be absent.
    ///
    /// # Errors
    /// [`ModelError::Config`] for an impossible configuration or a configuration whose Gaussian
    /// stride or alignment input differs from the weights'; [`ModelError::Incomplete`] with all
    /// other differences.
    pub fn check(&self, config: &ModelConfig, allow_unused: &[String]) -> Result<(), ModelError> {
        config.validate()?;
        if let Some(stride) = self.stride()
            && stride != config.gaussian_stride
        {
            return Err(ModelError::Config(format!(
                "`{}` has Gaussian stride {}, but the weights in {} have stride {stride}; set `gaussian_stride` to \
                 {stride}",
                config.preset,
                config.gaussian_stride,
                self.file.path().display()
            )));
        }
        let layers = config.alignment_input.layers();
        if let Some(found) = self.alignment_layers()
            && found != layers
        {
            return Err(ModelError::Config(format!(
                "the alignment network of `{}` receives {layers} depth layers, but the weights in {} expect \
                 {found}; set `alignment_input` to match",
                config.preset,
                self.file.path().display()
            )));
        }
        self.check_for(inventory(config)?, allow_unused)
    }

    /// Like [`Self::check`], but only for parameters whose names begin with `prefix`; all other tensors in the file are
    /// ignored.
    ///
    /// # Errors
    /// [`ModelError::Config`] for an impossible configuration; [`ModelError::Incomplete`] with all differences.
    pub fn check_part(&self, config: &ModelConfig, prefix: &str) -> Result<(), ModelError> {
        let mut parameters = inventory(config)?;
        parameters.retain(|p| p.name.starts_with(prefix));
        self.check_for(parameters, &[String::new()])
    }

    /// A warning about weights that training does not produce; `None` if no weights are suspicious.
    /// Suspicious are tensors that end in zeros, as in a file that was only partly written or
    /// copied, and tensors that are equal in several layers. Layers that are zero before training
    /// are ignored.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] if the file cannot be read.
    pub fn implausible_weights(&self) -> Result<Option<String>, ModelError> {
        let (mut count, mut first) = (0, None);
        let (mut known, mut repeated) = (BTreeMap::new(), Vec::new());
        for name in self.file.names() {
            let is_kernel = self.file.shape(name)?.len() >= 2;
            if !is_kernel || ZERO_BEFORE_TRAINING.iter().any(|part| name.contains(part)) {
                continue;
            }
            let values = self.file.tensor_f32(name)?;
            let zeros = values
                .iter()
                .rev()
                .take_while(|value| **value == 0.0)
                .count();
            let share = zeros as f64 / values.len().max(1) as f64;
            if share >= MIN_ZERO_TAIL {
                count += 1;
                first.get_or_insert((name, share));
            }
            // Layers of the same kind have names that differ only in their numbers.
            let is_number = |part: &&str| part.parse::<usize>().is_ok();
            let kind: Vec<&str> = name.split('.').filter(|part| !is_number(part)).collect();
            let sample = values.iter().step_by((values.len() / MIN_COMPARED).max(1));
            let sample: Vec<u32> = sample.map(|value| value.to_bits()).collect();
            if sample.iter().any(|value| *value != sample[0]) {
                let other = *known.entry((kind, sample)).or_insert(name);
                if other != name {
                    repeated.push((name, other));
                }
            }
        }
        let repeated = repeated.first().map(|(name, other)| {
            format!(
                "{} of its weight tensors are equal to those of another layer (for example, {name} to {other}), which \
                 training does not produce; perhaps one layer's tensors were written in place of another's; convert \
                 the file again",
                repeated.len()
            )
        });
        let zeros = first.map(|(name, share)| {
            format!(
                "{count} of its weight tensors end in zeros (for example, {name}, of which {:.0} % are missing), \
                 which training does not produce; the file was probably written or copied only in part, so download \
                 or convert it again",
                100.0 * share
            )
        });
        Ok(zeros.or(repeated))
    }

    /// Checks that the file contains all `parameters` that are used, and no other tensors, except
    /// tensors with a prefix in `allow_unused`; see [`Self::check`].
    pub(super) fn check_for(
        &self,
        parameters: Vec<Parameter>,
        allow_unused: &[String],
    ) -> Result<(), ModelError> {
        let parameters = parameters.into_iter();
        let needed = parameters.filter(|p| p.used || self.file.contains(&p.name));
        let expected: Vec<Expected> = needed
            .map(|p| Expected {
                name: p.name,
                shape: p.shape,
            })
            .collect();
        Ok(self.file.check(&expected, allow_unused)?)
    }

    /// Gaussian stride of the weights, i.e. the kernel size of the convolution that maps image and depth to the grid of
    /// Gaussians. `None` if the file has no such convolution.
    fn stride(&self) -> Option<usize> {
        match *self.file.shape(SKIP_CONVOLUTION).ok()? {
            [_, _, rows, columns] if rows == columns => Some(rows),
            _ => None,
        }
    }

    /// Predicted depth layers that the weights' alignment network receives. `None` if the file has
    /// no alignment network.
    fn alignment_layers(&self) -> Option<usize> {
        match *self.file.shape(ALIGNMENT_CONVOLUTION).ok()? {
            [_, channels, _, _] => channels.checked_sub(1),
            _ => None,
        }
    }
}

/// Layers whose names contain one of these texts are zero before training.
pub const ZERO_BEFORE_TRAINING: [&str; 2] = ["prediction_head.", "scale_map_estimator.conv_out."];
/// Two tensors are compared by at least this many evenly spaced values; tensors with fewer values are compared
/// completely.
const MIN_COMPARED: usize = 256;
/// Zeros at the end of a tensor count as missing values if they are at least this share of the
/// tensor.
const MIN_ZERO_TAIL: f64 = 0.1;

const SKIP_CONVOLUTION: &str = "feature_model.image_encoder.conv.weight";
const ALIGNMENT_CONVOLUTION: &str = "depth_alignment.scale_map_estimator.encoder.conv_in.0.weight";

impl WeightSource for CheckpointSource {
    fn values(&self, name: &str, _: &[usize]) -> Result<Vec<f32>, ModelError> {
        Ok(self.file.tensor_f32(name)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::config::AlignmentInput;
    use std::collections::BTreeMap;

    /// Compares names and shapes of our parameters with the official state dict.
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
        let found = inventory(&config).unwrap();
        let skip = found.iter().find(|p| p.name == SKIP_CONVOLUTION).unwrap();
        assert_eq!(skip.shape, [128, 5, 4, 4]);
    }

    #[test]
    fn weights_of_another_stride_are_a_configuration_error() {
        for stride in [4, 8] {
            let mut config = tiny();
            config.gaussian_stride = stride;
            let error = official_tiny().check(&config, &[]).unwrap_err();
            assert!(matches!(error, ModelError::Config(_)), "{error:?}");
            let text = error.to_string();
            for part in [
                &format!("Gaussian stride {stride}"),
                "have stride 2",
                "tiny_model.pt",
            ] {
                assert!(text.contains(part), "{text}");
            }
        }
    }

    #[test]
    fn weights_of_another_alignment_input_are_a_configuration_error() {
        let mut config = tiny();
        config.alignment_input = AlignmentInput::BothLayers;
        let error = official_tiny().check(&config, &[]).unwrap_err();
        assert!(matches!(error, ModelError::Config(_)), "{error:?}");
        let text = error.to_string();
        for part in ["receives 2 depth layers", "tiny_model.pt expect 1"] {
            assert!(text.contains(part), "{text}");
        }
    }

    fn tiny() -> ModelConfig {
        let file = "/../tests/golden/model/tiny_config.json#tiny";
        ModelConfig::load(&format!("{}{file}", env!("CARGO_MANIFEST_DIR"))).unwrap()
    }

    fn official_tiny() -> CheckpointSource {
        let file = "/../tests/golden/model/tiny_model.pt";
        let file = format!("{}{file}", env!("CARGO_MANIFEST_DIR"));
        CheckpointSource::open(Path::new(&file)).unwrap()
    }

    #[test]
    fn an_official_checkpoint_is_complete_and_holds_nothing_else() {
        official_tiny().check(&tiny(), &[]).unwrap();
    }

    /// [`implausible_weights`](CheckpointSource::implausible_weights) of a checkpoint in which
    /// `change` has modified some tensors, selected by name.
    fn told_of(change: impl Fn(&str, &mut Vec<f32>)) -> Option<String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("changed.safetensors");
        let parameters = inventory(&tiny()).unwrap();
        let tensors = parameters.into_iter().map(|p| sharp_checkpoint::OutTensor {
            name: p.name,
            dtype: sharp_checkpoint::DType::F32,
            shape: p.shape,
        });
        let tensors: Vec<_> = tensors.collect();
        let official = official_tiny();
        let values = |tensor: &sharp_checkpoint::OutTensor| {
            let mut values = official.file.tensor_f32(&tensor.name)?;
            change(&tensor.name, &mut values);
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            Ok(bytes.into())
        };
        sharp_checkpoint::write_safetensors(&path, &BTreeMap::new(), &tensors, values).unwrap();
        CheckpointSource::open(&path)
            .unwrap()
            .implausible_weights()
            .unwrap()
    }

    #[test]
    fn weights_that_end_in_zeros_are_told_and_untrained_heads_are_not() {
        assert_eq!(official_tiny().implausible_weights().unwrap(), None);
        let with_zeros = |part: &str, share: f64| {
            told_of(|name, values| {
                if name.contains(part) {
                    let kept = (values.len() as f64 * (1.0 - share)) as usize;
                    values[kept..].fill(0.0);
                }
            })
        };
        for part in [
            "prediction_head.",
            "scale_map_estimator.conv_out.",
            ".bias",
            ".gamma",
        ] {
            assert_eq!(with_zeros(part, 1.0), None, "{part}");
        }
        let text = with_zeros("patch_encoder.patch_embed.proj.weight", 0.5).unwrap();
        assert!(
            text.starts_with("1 of its weight tensors")
                && text.contains("proj.weight, of which 50 %"),
            "{text}"
        );
    }

    #[test]
    fn layers_with_the_weights_of_another_are_told() {
        let official = official_tiny();
        let text = told_of(|name, values| {
            let first = name.replace("blocks.1.", "blocks.0.");
            *values = official.file.tensor_f32(&first).unwrap();
        });
        let text = text.unwrap();
        assert!(
            text.contains("blocks.1.") && text.contains("equal to those of another layer"),
            "{text}"
        );
    }

    #[test]
    fn what_does_not_fit_is_counted_and_the_first_of_it_named() {
        let mut wider = tiny();
        wider.gaussian_dim_out = 16;
        wider.vit.depth = 5;
        let message = official_tiny().check(&wider, &[]).unwrap_err().to_string();
        for line in [
            "28 missing, 0 surplus, 6 of another shape",
            "encoder.image_encoder.blocks.4.attn.proj.bias [32]",
            "missing: 25 more",
            "feature_model.geometry_head.3.bias [8], expected [16]",
            "another shape: 3 more",
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
