//! Loading of a network's tensors; all must be present and finite.

use std::collections::BTreeMap;
use std::path::Path;

use sha2::{Digest, Sha256};
use sharp_checkpoint::deterministic::backbone_weights;
use sharp_checkpoint::hash::hex;
use sharp_checkpoint::{Checkpoint, Expected, Incomplete};

use super::embedded::ALEXNET;
use super::{Backbone, Weights, WeightsError, WeightsSource, WeightsUsed};
use crate::backbone::architecture;

/// Shapes and values (in C order) of tensors, keyed by name.
pub type NamedTensors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// All tensors of a network's features, by their name after `features.`.
#[derive(Debug)]
pub(crate) struct Tensors(NamedTensors);

impl Tensors {
    /// Shape and values of a tensor. All of the network's tensors are present.
    pub(crate) fn get(&self, name: &str) -> (&[usize], &[f32]) {
        let (shape, values) = &self.0[name];
        (shape, values)
    }

    fn sha256(&self) -> String {
        let mut hash = Sha256::new();
        for (name, (_, values)) in &self.0 {
            hash.update(name.as_bytes());
            for value in values {
                hash.update(value.to_le_bytes());
            }
        }
        hex(hash.finalize())
    }
}

/// A network's tensors and their source.
#[derive(Debug)]
pub(crate) struct LoadedBackbone {
    pub(crate) tensors: Tensors,
    pub(crate) used: WeightsUsed,
}

impl Weights {
    /// Reads the tensors of a network; `None` if no weights are configured for it.
    pub(crate) fn load(&self, backbone: Backbone) -> Result<Option<LoadedBackbone>, WeightsError> {
        let Some(source) = self.sources.get(&backbone) else {
            return Ok(None);
        };
        let (tensors, original_sha256) = match source {
            WeightsSource::File(path) => {
                let (tensors, original) = read(backbone, path)?;
                (tensors, Some(original))
            }
            WeightsSource::BuiltIn => (built_in(backbone)?, None),
            WeightsSource::Deterministic(salt) => (deterministic(backbone, salt), None),
        };
        let used = WeightsUsed {
            backbone,
            source: source.clone(),
            features_sha256: tensors.sha256(),
            original_sha256,
        };
        Ok(Some(LoadedBackbone { tensors, used }))
    }

    /// Tensors of a network's features by their name after `features.` (`0.weight`, `0.bias`, …), for use by other
    /// implementations; `None` without weights.
    ///
    /// # Errors
    /// [`WeightsError`] if the weights are unreadable, belong to another network, or are not
    /// finite.
    pub fn convolutions(&self, backbone: Backbone) -> Result<Option<NamedTensors>, WeightsError> {
        Ok(self.load(backbone)?.map(|loaded| loaded.tensors.0))
    }
}

/// The published convolutions that are compiled into this program, which are those of AlexNet.
fn built_in(backbone: Backbone) -> Result<Tensors, WeightsError> {
    let tensors = architecture::tensors(backbone).into_iter().map(|tensor| {
        let name = format!("features.{}", tensor.name);
        let values = ALEXNET.values(&name, tensor.shape.iter().product())?;
        Ok((tensor.name, (tensor.shape, values)))
    });
    Ok(Tensors(tensors.collect::<Result<_, _>>()?))
}

fn deterministic(backbone: Backbone, salt: &str) -> Tensors {
    let tensors = architecture::tensors(backbone).into_iter().map(|tensor| {
        let name = format!("{backbone}.features.{}", tensor.name);
        let values = backbone_weights(salt, &name, &tensor.shape);
        (tensor.name, (tensor.shape, values))
    });
    Tensors(tensors.collect())
}

/// Metadata key under which `sharp_checkpoint` records the source of a converted file.
const SOURCE_SHA256: &str = "source_sha256";

/// Tensors of a file, and the SHA-256 of the file in which they were published.
fn read(backbone: Backbone, path: &Path) -> Result<(Tensors, String), WeightsError> {
    let refused = |source| WeightsError::Checkpoint { backbone, source };
    let file = Checkpoint::open(path).map_err(refused)?;
    let bare = file.contains("0.weight");
    let prefix = if bare { "" } else { "features." };
    let wanted = architecture::tensors(backbone);
    let expected: Vec<Expected> = wanted
        .iter()
        .map(|tensor| Expected {
            name: format!("{prefix}{}", tensor.name),
            shape: tensor.shape.clone(),
        })
        .collect();
    file.check(&expected, &["classifier."])
        .map_err(|incomplete| WeightsError::Mismatch {
            backbone,
            path: path.to_owned(),
            reason: in_one_line(&incomplete),
        })?;
    let mut tensors = BTreeMap::new();
    for (tensor, Expected { name, .. }) in wanted.into_iter().zip(expected) {
        let values = file.tensor_f32(&name).map_err(refused)?;
        if !values.iter().all(|value| value.is_finite()) {
            return Err(WeightsError::NotFinite {
                path: path.to_owned(),
                tensor: name,
            });
        }
        tensors.insert(tensor.name, (tensor.shape, values));
    }
    let original = file.metadata().get(SOURCE_SHA256).cloned();
    let original = match original {
        Some(original) => original,
        None => file.sha256().map_err(refused)?,
    };
    Ok((Tensors(tensors), original))
}

/// Summarises the differences in one line: for each kind of difference, the number of tensors and
/// the first tensor.
fn in_one_line(incomplete: &Incomplete) -> String {
    let mut parts = Vec::new();
    if let Some(first) = incomplete.misshaped.first() {
        let (count, name) = (incomplete.misshaped.len(), &first.name);
        let (expected, found) = (&first.expected, &first.found);
        parts.push(format!(
            "{count} of another shape (first: {name} {found:?}, expected {expected:?})"
        ));
    }
    if let Some(first) = incomplete.missing.first() {
        let count = incomplete.missing.len();
        parts.push(format!("{count} missing (first: {})", first.name));
    }
    if let Some(first) = incomplete.surplus.first() {
        let count = incomplete.surplus.len();
        parts.push(format!("{count} surplus (first: {first})"));
    }
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;

    use sharp_checkpoint::{DType, OutTensor, write_safetensors};

    use super::*;

    /// Writes a safetensors file of the deterministic weights; `change` may rename tensors.
    fn write(path: &Path, change: impl Fn(&str) -> String, value: Option<f32>) {
        let tensors = deterministic(Backbone::SqueezeNet1_1, "");
        let name = |name: &str| change(&format!("features.{name}"));
        let out: Vec<OutTensor> = tensors
            .0
            .iter()
            .map(|(key, (shape, _))| OutTensor {
                name: name(key),
                dtype: DType::F32,
                shape: shape.clone(),
            })
            .collect();
        write_safetensors(path, &BTreeMap::new(), &out, |tensor| {
            let (_, (_, values)) = tensors
                .0
                .iter()
                .find(|(k, _)| name(k) == tensor.name)
                .unwrap();
            let bytes = values
                .iter()
                .flat_map(|&v| value.unwrap_or(v).to_le_bytes());
            Ok(Cow::Owned(bytes.collect()))
        })
        .unwrap();
    }

    #[test]
    fn files_with_and_without_prefix_are_the_same_weights() {
        let folder = tempfile::tempdir().unwrap();
        let (full, bare) = (folder.path().join("a"), folder.path().join("b"));
        write(&full, str::to_owned, None);
        write(&bare, |name| name.replace("features.", ""), None);
        let sha = |weights: Weights| {
            let loaded = weights.load(Backbone::SqueezeNet1_1).unwrap().unwrap();
            loaded.used.features_sha256
        };
        let expected = sha(Weights::deterministic(""));
        assert_ne!(expected, sha(Weights::deterministic("x")));
        for file in [full, bare] {
            assert_eq!(
                sha(Weights::none().with_file(Backbone::SqueezeNet1_1, file)),
                expected
            );
        }
    }

    #[test]
    fn wrong_files_are_refused_by_name_and_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("w.safetensors");
        let error = |backbone| {
            let weights = Weights::none().with_file(backbone, &path);
            let error = weights.load(backbone).unwrap_err().to_string();
            assert!(error.contains("w.safetensors"), "{error}");
            assert!(!error.contains('\n'), "{error}");
            error
        };
        error(Backbone::Vgg16);
        std::fs::write(&path, b"<html>not found</html>").unwrap();
        error(Backbone::Vgg16);
        write(&path, str::to_owned, None);
        let other = error(Backbone::Vgg16);
        assert!(other.contains("not the weights of vgg16"), "{other}");
        write(&path, |name| name.replace("12.squeeze", "99.squeeze"), None);
        let other = error(Backbone::SqueezeNet1_1);
        assert!(other.contains("features.12.squeeze.bias"), "{other}");
        write(&path, str::to_owned, Some(f32::NAN));
        assert!(error(Backbone::SqueezeNet1_1).contains("not finite"));
    }
}
