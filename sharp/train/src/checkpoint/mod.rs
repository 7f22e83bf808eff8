//! The state of a training run as one safetensors file, and export of a network's weights.
//!
//! No random state is stored: every random choice depends only on the seed and the position.

mod folder;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use half::f16;
use sharp::model::ModelError;
use sharp::model::params::{Parameter, WeightSource};
use sharp_checkpoint::{
    Checkpoint, CheckpointError, DType, Expected, Incomplete, OutTensor, write_safetensors,
};

pub use self::folder::CheckpointFolder;
use crate::optimizer::{Moments, ParameterState};
use crate::parts::TrainedParts;
use crate::position::{Position, Stage};

/// Key of the stage in the file's header.
const STAGE: &str = "stage";
/// Key of the number of completed steps in the file's header.
const STEP: &str = "step";
/// Key of the configuration's hash in the file's header.
const CONFIG: &str = "config_sha256";
/// Prefix of the names of weights.
const VALUES: &str = "values.";
/// Prefix of the names of first moments.
const FIRST: &str = "first_moment.";
/// Prefix of the names of second moments.
const SECOND: &str = "second_moment.";

/// Errors of writing or resuming from a state.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    #[error(transparent)]
    File(#[from] CheckpointError),
    #[error(transparent)]
    Incomplete(#[from] Incomplete),
    #[error("{}: not a training state: its header has no valid `{key}`", path.display())]
    NotAState { path: PathBuf, key: &'static str },
    #[error(
        "{}: written with another configuration (hash {found}, now {expected}): a setting, a file named in the \
         configuration, or the program has changed; use another folder",
        path.display()
    )]
    OtherConfig {
        path: PathBuf,
        expected: String,
        found: String,
    },
    /// A tensor contains NaN, an infinity, a negative second moment, or a value out of range for f16.
    #[error("{}: tensor '{name}' has a value of {value}", path.display())]
    Value {
        path: PathBuf,
        name: String,
        value: f32,
    },
}

/// Precision of exported weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    F32,
    /// Half precision, rounded to the nearest value.
    F16,
}

/// The complete state from which the next step starts.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingState {
    pub position: Position,
    /// All parameters that the network uses, frozen or not, in order of construction.
    pub weights: Vec<ParameterState>,
}

impl TrainingState {
    /// The state before the first step: weights from `source`; the moments of trained parameters
    /// are zero.
    ///
    /// # Errors
    /// Any error of `source`; [`ModelError::Weights`] if `source` returns the wrong number of
    /// values.
    pub fn new(
        inventory: &[Parameter],
        parts: &TrainedParts,
        source: &dyn WeightSource,
    ) -> Result<Self, ModelError> {
        let weights = inventory.iter().filter(|parameter| parameter.used);
        let weights = weights.map(|parameter| {
            let Parameter { name, shape, .. } = parameter.clone();
            let values = source.values(&name, &shape)?;
            if values.len() != parameter.len() {
                return Err(ModelError::Weights {
                    name,
                    expected: parameter.len(),
                    found: values.len(),
                });
            }
            Ok(ParameterState {
                moments: parts.contain(&name).then(|| Moments::zero(values.len())),
                name,
                shape,
                values,
            })
        });
        Ok(Self {
            position: Position::START,
            weights: weights.collect::<Result<_, _>>()?,
        })
    }

    /// Checks that all weights, which were read from `path`, are finite.
    ///
    /// # Errors
    /// [`StateError::Value`] names the first weight that is not finite.
    pub(crate) fn check(&self, path: &Path) -> Result<(), StateError> {
        let mut weights = self.weights.iter();
        weights.try_for_each(|weights| check_values(path, VALUES, &weights.name, &weights.values))
    }

    /// Moves to the start of a stage and resets the optimiser's moments to zero.
    pub fn begin(&mut self, stage: Stage) {
        self.position = Position { stage, step: 0 };
        for weights in &mut self.weights {
            if let Some(moments) = &mut weights.moments {
                *moments = Moments::zero(weights.values.len());
            }
        }
    }

    /// Writes the whole state atomically.
    ///
    /// # Errors
    /// [`StateError::File`] if the file cannot be written; [`StateError::Value`] for values from which training cannot
    /// resume.
    pub fn save(&self, path: &Path, config_sha256: &str) -> Result<(), StateError> {
        let Position { stage, step } = self.position;
        let metadata = [
            (STAGE, stage.number().to_string()),
            (STEP, step.to_string()),
            (CONFIG, config_sha256.to_owned()),
        ];
        let metadata = metadata.map(|(key, value)| (key.to_owned(), value)).into();
        let mut tensors = BTreeMap::new();
        for weights in &self.weights {
            let mut add = |kind: &str, values| {
                let name = format!("{kind}{}", weights.name);
                check_values(path, kind, &name, values)?;
                tensors.insert(name, (&*weights.shape, values));
                Ok::<_, StateError>(())
            };
            add(VALUES, &*weights.values)?;
            if let Some(Moments { first, second }) = &weights.moments {
                add(FIRST, first)?;
                add(SECOND, second)?;
            }
        }
        Ok(write(path, &metadata, &tensors, Precision::F32)?)
    }

    /// Reads a state written by [`Self::save`], for the network of `inventory`, of which `parts`
    /// are trained.
    ///
    /// # Errors
    /// [`StateError`]: a damaged file, another configuration, tensors that do not match the network
    /// and its moments, or values from which training cannot resume.
    pub fn load(
        path: &Path,
        config_sha256: &str,
        inventory: &[Parameter],
        parts: &TrainedParts,
    ) -> Result<Self, StateError> {
        let file = Checkpoint::open(path)?;
        let position = position_of(&file)?;
        let found = header(&file, CONFIG)?;
        if found != config_sha256 {
            return Err(StateError::OtherConfig {
                path: path.to_owned(),
                expected: config_sha256.to_owned(),
                found: found.to_owned(),
            });
        }
        let used = || inventory.iter().filter(|parameter| parameter.used);
        let expected = used().flat_map(|Parameter { name, shape, .. }| {
            let kinds: &[&str] = if parts.contain(name) {
                &[VALUES, FIRST, SECOND]
            } else {
                &[VALUES]
            };
            kinds.iter().map(move |kind| Expected {
                name: format!("{kind}{name}"),
                shape: shape.clone(),
            })
        });
        let expected: Vec<Expected> = expected.collect();
        file.check(&expected, &[] as &[&str])?;
        let read = |kind: &str, name: &str| {
            let name = format!("{kind}{name}");
            let values = file.tensor_f32(&name)?;
            check_values(path, kind, &name, &values)?;
            Ok::<_, StateError>(values)
        };
        let weights = used().map(|Parameter { name, shape, .. }| {
            let moments = || -> Result<Moments, StateError> {
                Ok(Moments {
                    first: read(FIRST, name)?,
                    second: read(SECOND, name)?,
                })
            };
            Ok(ParameterState {
                name: name.clone(),
                shape: shape.clone(),
                values: read(VALUES, name)?,
                moments: parts.contain(name).then(moments).transpose()?,
            })
        });
        Ok(Self {
            position,
            weights: weights.collect::<Result<_, StateError>>()?,
        })
    }

    /// Writes only the network's weights, as a checkpoint for [`Predictor`](sharp::model::Predictor); `metadata` is
    /// free text.
    ///
    /// # Errors
    /// [`StateError::Value`] for values that are not finite in `precision`; [`StateError::File`] if the file cannot be
    /// written.
    pub fn export(
        &self,
        path: &Path,
        precision: Precision,
        metadata: &BTreeMap<String, String>,
    ) -> Result<(), StateError> {
        let is_held = |value: &f32| match precision {
            Precision::F32 => value.is_finite(),
            Precision::F16 => f16::from_f32(*value).is_finite(),
        };
        let mut tensors = BTreeMap::new();
        for ParameterState {
            name,
            shape,
            values,
            ..
        } in &self.weights
        {
            if let Some(&value) = values.iter().find(|value| !is_held(value)) {
                return Err(StateError::Value {
                    path: path.to_owned(),
                    name: name.clone(),
                    value,
                });
            }
            tensors.insert(name.clone(), (&**shape, &**values));
        }
        Ok(write(path, metadata, &tensors, precision)?)
    }
}

/// Rejects values from which training cannot resume: non-finite ones and negative second moments.
fn check_values(path: &Path, kind: &str, name: &str, values: &[f32]) -> Result<(), StateError> {
    let is_good = |value: &f32| value.is_finite() && (kind != SECOND || *value >= 0.0);
    match values.iter().find(|value| !is_good(value)) {
        None => Ok(()),
        Some(&value) => Err(StateError::Value {
            path: path.to_owned(),
            name: name.to_owned(),
            value,
        }),
    }
}

fn position_of(file: &Checkpoint) -> Result<Position, StateError> {
    let number = |key: &'static str| {
        let number = header(file, key)?.parse::<u64>().ok();
        number.ok_or_else(|| not_a_state(file, key))
    };
    Ok(Position {
        stage: Stage::from_number(number(STAGE)?).ok_or_else(|| not_a_state(file, STAGE))?,
        step: number(STEP)?,
    })
}

fn header<'a>(file: &'a Checkpoint, key: &'static str) -> Result<&'a str, StateError> {
    let value = file.metadata().get(key);
    value
        .map(String::as_str)
        .ok_or_else(|| not_a_state(file, key))
}

fn not_a_state(file: &Checkpoint, key: &'static str) -> StateError {
    let path = file.path().to_owned();
    StateError::NotAState { path, key }
}

/// Shapes and values, keyed by name.
type Tensors<'a> = BTreeMap<String, (&'a [usize], &'a [f32])>;

fn write(
    path: &Path,
    metadata: &BTreeMap<String, String>,
    tensors: &Tensors<'_>,
    precision: Precision,
) -> Result<(), CheckpointError> {
    let dtype = match precision {
        Precision::F32 => DType::F32,
        Precision::F16 => DType::F16,
    };
    let list: Vec<OutTensor> = tensors
        .iter()
        .map(|(name, (shape, _))| OutTensor {
            name: name.clone(),
            dtype,
            shape: shape.to_vec(),
        })
        .collect();
    write_safetensors(path, metadata, &list, |tensor| {
        let values = tensors
            .get(&tensor.name)
            .map_or(&[][..], |(_, values)| values);
        let bytes: Vec<u8> = match precision {
            Precision::F32 => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Precision::F16 => {
                let halves = values.iter().map(|&v| f16::from_f32(v));
                halves.flat_map(|v| v.to_le_bytes()).collect()
            }
        };
        Ok(Cow::Owned(bytes))
    })
}

#[cfg(test)]
mod tests;
