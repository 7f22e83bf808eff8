//! Compute engines: own kernels on the CPU, or candle tensors on any device.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use candle_core::{Device, Tensor};
use sharp_kernels::{Algorithm, Simd, Workspace};

use super::ModelError;
use super::params::{Parameter, WeightSource};
use super::tape::Tape;

pub enum Engine {
    /// Our kernels on the CPU: images as `[row][column][channel]`, weights streamed.
    Kernels(CpuKernels),
    /// Tensors on a device, weights resident there. On the CPU it is slower and larger than the
    /// kernels, and serves as their reference.
    Tensors(Device),
}

/// The kernels and how they compute.
#[derive(Debug, Clone, Copy)]
pub struct CpuKernels {
    pub(super) simd: Simd,
    pub(super) convolution: Algorithm,
}

impl Engine {
    /// Kernels for this CPU; `convolution` is for 3×3 kernels.
    pub fn cpu(convolution: Algorithm) -> Self {
        Self::Kernels(CpuKernels {
            simd: Simd::detect(),
            convolution,
        })
    }

    /// For records: `cpu-avx2`, `cpu-avx2-exact` ([`Algorithm::Direct`]), `candle-cuda…`.
    pub fn name(&self) -> String {
        match self {
            Self::Kernels(kernels) => {
                let set = kernels.simd.instruction_set();
                match kernels.convolution {
                    Algorithm::Winograd => format!("cpu-{set}"),
                    Algorithm::Direct => format!("cpu-{set}-exact"),
                }
            }
            Self::Tensors(device) => format!("candle-{:?}", device.location()).to_lowercase(),
        }
    }
}

/// An engine at work on one network.
pub(super) struct Runtime {
    pub(super) engine: Engine,
    source: Box<dyn WeightSource>,
    /// Tensors that are on the device already; the kernels keep nothing.
    resident: Mutex<HashMap<String, Tensor>>,
    workspace: Mutex<Workspace>,
    /// In training, on kernels: how gradients go back.
    pub(super) tape: Option<Arc<Tape>>,
}

impl Runtime {
    pub(super) fn new(engine: Engine, source: Box<dyn WeightSource>) -> Self {
        Self {
            engine,
            source,
            resident: Mutex::default(),
            workspace: Mutex::default(),
            tape: None,
        }
    }

    /// On kernels for this CPU, with a tape.
    pub(super) fn in_training(source: Box<dyn WeightSource>, tape: Arc<Tape>) -> Self {
        let engine = Engine::cpu(sharp_kernels::Algorithm::Winograd);
        Self {
            tape: Some(tape),
            ..Self::new(engine, source)
        }
    }

    pub(super) fn values(&self, parameter: &Parameter) -> Result<Vec<f32>, ModelError> {
        let values = self.source.values(&parameter.name, &parameter.shape)?;
        if values.len() == parameter.len() {
            Ok(values)
        } else {
            Err(ModelError::Weights {
                name: parameter.name.clone(),
                expected: parameter.len(),
                found: values.len(),
            })
        }
    }

    pub(super) fn tensor(
        &self,
        parameter: &Parameter,
        device: &Device,
    ) -> Result<Tensor, ModelError> {
        let mut resident = lock(&self.resident);
        if let Some(tensor) = resident.get(&parameter.name) {
            return Ok(tensor.clone());
        }
        let values = self.values(parameter)?;
        let tensor = Tensor::from_vec(values, &parameter.shape[..], device)?;
        resident.insert(parameter.name.clone(), tensor.clone());
        Ok(tensor)
    }

    /// Runs `f` with the kernels' scratch memory.
    pub(super) fn with_workspace<R>(&self, f: impl FnOnce(&mut Workspace) -> R) -> R {
        f(&mut lock(&self.workspace))
    }
}

/// A panic leaves neither map nor workspace in a state that would matter.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
