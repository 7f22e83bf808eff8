//! Parameters of a network and the source of their values.
//!
//! Modules declare their parameters by name and shape during construction, and fetch the values when they run. On the
//! CPU, each layer's weights are read just before use and dropped afterwards, so that a network of 2.8 GB needs only a
//! few megabytes of memory for weights.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use candle_core::{DType, Device, Shape, Tensor, Var};
use candle_nn::var_builder::SimpleBackend;
use candle_nn::{Init, VarBuilder};
use sharp_checkpoint::deterministic::model_weights;

use super::ModelError;
use super::compute::{Compute, Kernels};
use super::ops::Recompute;

/// A source of parameter values.
pub trait WeightSource: Send + Sync {
    /// Values of the parameter `name` with `shape`, in C order of PyTorch's layout.
    ///
    /// # Errors
    /// [`ModelError`] if the values cannot be read.
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError>;
}

/// Derives every parameter from its name; see [`sharp_checkpoint::deterministic`].
#[derive(Debug, Clone, Default)]
pub struct Synth {
    /// Text that is prepended to every name.
    pub salt: String,
}

impl WeightSource for Synth {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        Ok(model_weights(&self.salt, name, shape))
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// Name in the checkpoint.
    pub name: String,
    /// Shape in PyTorch's layout.
    pub shape: Vec<usize>,
    /// False for parameters that are in the checkpoint but not used at inference.
    pub used: bool,
}

impl Parameter {
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A source of weights as the backend of a [`VarBuilder`]. On the CPU, values are read each time a
/// layer requests them; on a GPU, tensors are cached.
#[derive(Clone)]
pub(super) struct Weights {
    source: Arc<dyn WeightSource>,
    trains: Arc<dyn Fn(&str) -> bool + Send + Sync>,
    /// Cached tensors, keyed by name: variables, and on a GPU all tensors.
    held: Arc<Mutex<BTreeMap<String, Tensor>>>,
}

impl Weights {
    /// Wraps a source of weights; `trains` returns true for the names of parameters that become variables.
    pub(super) fn new(
        source: impl WeightSource + 'static,
        trains: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Self {
        Self {
            source: Arc::new(source),
            trains: Arc::new(trains),
            held: Arc::default(),
        }
    }

    /// Variables that layers have requested, keyed by name.
    pub(super) fn variables(&self) -> BTreeMap<String, Tensor> {
        let held = self.held().clone().into_iter();
        held.filter(|(_, tensor)| tensor.is_variable()).collect()
    }

    fn held(&self) -> MutexGuard<'_, BTreeMap<String, Tensor>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn read(&self, name: &str, shape: &Shape) -> Result<Vec<f32>, ModelError> {
        let values = self.source.values(name, shape.dims())?;
        if values.len() == shape.elem_count() {
            return Ok(values);
        }
        Err(ModelError::Weights {
            name: name.to_owned(),
            expected: shape.elem_count(),
            found: values.len(),
        })
    }
}

impl SimpleBackend for Weights {
    fn get(
        &self,
        shape: Shape,
        name: &str,
        _: Init,
        _: DType,
        device: &Device,
    ) -> candle_core::Result<Tensor> {
        if let Some(tensor) = self.held().get(name) {
            return Ok(tensor.clone());
        }
        let values = self.read(name, &shape)?;
        let trains = (self.trains)(name);
        let tensor = if trains {
            Var::from_vec(values, shape, device)?.into_inner()
        } else {
            Tensor::from_vec(values, shape, device)?
        };
        if trains || !device.is_cpu() {
            self.held().insert(name.to_owned(), tensor.clone());
        }
        Ok(tensor)
    }

    fn get_unchecked(&self, name: &str, _: DType, _: &Device) -> candle_core::Result<Tensor> {
        candle_core::bail!("{name}: a parameter can only be read with its declared shape")
    }

    fn contains_tensor(&self, name: &str) -> bool {
        self.held().contains_key(name)
    }
}

/// A parameter of a layer, fetched when the layer runs.
pub(super) struct Weight {
    module: VarBuilder<'static>,
    name: &'static str,
    shape: Vec<usize>,
}

impl Weight {
    pub(super) fn get(&self) -> candle_core::Result<Tensor> {
        self.module.get(self.shape.as_slice(), self.name)
    }
}

/// A node in the module tree under construction; collects the parameters that modules declare.
#[derive(Clone)]
pub(super) struct Params<'a> {
    module: VarBuilder<'static>,
    pub(super) kernels: Option<Kernels>,
    /// Collects the gradients of recomputed parts. `Some` only in training, and only if intermediate tensors are not
    /// kept.
    pub(super) recompute: Option<Recompute>,
    list: &'a RefCell<Vec<Parameter>>,
}

impl<'a> Params<'a> {
    /// Creates the root of a module tree whose layers run on `compute`.
    pub(super) fn new(
        compute: &Compute,
        weights: &Weights,
        list: &'a RefCell<Vec<Parameter>>,
    ) -> Self {
        let (weights, device) = (Box::new(weights.clone()), compute.device.clone());
        Self {
            module: VarBuilder::from_backend(weights, DType::F32, device),
            kernels: compute.kernels,
            recompute: None,
            list,
        }
    }

    pub(super) fn device(&self) -> &Device {
        self.module.device()
    }

    /// The child module `name`.
    pub(super) fn pp(&self, name: impl ToString) -> Self {
        Self {
            module: self.module.pp(name),
            ..self.clone()
        }
    }

    pub(super) fn get(&self, name: &'static str, shape: &[usize]) -> Weight {
        self.declare(name, shape, true);
        Weight {
            module: self.module.clone(),
            name,
            shape: shape.to_vec(),
        }
    }

    /// Declares a parameter of this module that inference does not use.
    pub(super) fn unused(&self, name: &str, shape: &[usize]) {
        self.declare(name, shape, false);
    }

    fn declare(&self, name: &str, shape: &[usize], used: bool) {
        let module = self.module.prefix();
        let name = if module.is_empty() {
            name.to_owned()
        } else {
            format!("{module}.{name}")
        };
        self.list.borrow_mut().push(Parameter {
            name,
            shape: shape.to_vec(),
            used,
        });
    }
}
