//! Parts of a network that are computed again in the backward pass, so that their intermediate tensors are not kept
//! until then.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use candle_core::{
    CpuStorage, CustomOp3, DType, Device, Error, Layout, Shape, Tensor, TensorId, Var,
};

use super::custom::{View, pull};
use crate::model::ModelError;
use crate::model::compute::Compute;

/// Runs parts of a network without keeping their graphs, and collects the gradients of the variables in them. CPU only.
#[derive(Clone)]
pub(in crate::model) struct Recompute {
    compute: Compute,
    gradients: Arc<Mutex<HashMap<TensorId, Tensor>>>,
}

impl Recompute {
    pub(in crate::model) fn new(compute: &Compute) -> Self {
        Self {
            compute: compute.clone(),
            gradients: Arc::default(),
        }
    }

    /// Returns `part(inputs)`, for one to three inputs. `part` must be deterministic, because the backward pass runs it
    /// again.
    pub(in crate::model) fn run(
        &self,
        inputs: &[&Tensor],
        part: impl Fn(&[Tensor]) -> Result<Tensor, ModelError> + Send + Sync + 'static,
    ) -> Result<Tensor, ModelError> {
        let detached: Vec<Tensor> = inputs.iter().map(|input| input.detach()).collect();
        let output = part(&detached)?;
        let is_tracked = inputs.iter().any(|input| input.track_op());
        if !is_tracked && !output.track_op() {
            return Ok(output);
        }
        let output = output.detach();
        let nothing = Tensor::zeros(0, DType::F32, &Device::Cpu)?;
        let [a, b, c] = [0, 1, 2].map(|k| inputs.get(k).copied().unwrap_or(&nothing));
        // The backward pass reaches an operation only if an input of the operation is tracked.
        let a = if is_tracked {
            a.clone()
        } else {
            Var::from_tensor(a)?.into_inner()
        };
        let operation = Recomputed {
            part,
            output: Mutex::new(Some(output)),
            recompute: self.clone(),
        };
        Ok(a.apply_op3(b, c, operation)?)
    }

    /// Removes and returns the gradient of a variable; `None` if there is none.
    pub(in crate::model) fn take(&self, variable: &Tensor) -> Option<Tensor> {
        self.gradients().remove(&variable.id())
    }

    fn gradients(&self) -> MutexGuard<'_, HashMap<TensorId, Tensor>> {
        self.gradients
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

struct Recomputed<F> {
    part: F,
    /// The output, until the operation returns it.
    output: Mutex<Option<Tensor>>,
    recompute: Recompute,
}

impl<F> CustomOp3 for Recomputed<F>
where
    F: Fn(&[Tensor]) -> Result<Tensor, ModelError> + Send + Sync + 'static,
{
    fn name(&self) -> &'static str {
        "sharp-recomputed"
    }

    fn cpu_fwd(
        &self,
        _: &CpuStorage,
        _: &Layout,
        _: &CpuStorage,
        _: &Layout,
        _: &CpuStorage,
        _: &Layout,
    ) -> candle_core::Result<(CpuStorage, Shape)> {
        let output = self.output.lock();
        let output = output.unwrap_or_else(PoisonError::into_inner).take();
        let output = output.ok_or_else(|| Error::msg("a recomputed part runs forward once"))?;
        let (storage, layout) = output.storage_and_layout();
        let values = View::of(&storage, layout)?.values.to_vec();
        Ok((CpuStorage::F32(values), output.shape().clone()))
    }

    fn bwd(
        &self,
        a: &Tensor,
        b: &Tensor,
        c: &Tensor,
        _: &Tensor,
        upstream: &Tensor,
    ) -> candle_core::Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let given = [a, b, c].into_iter().filter(|x| x.elem_count() > 0);
        let ends = given.map(|x| Ok(Var::from_tensor(&x.detach())?.into_inner()));
        let ends = ends.collect::<candle_core::Result<Vec<_>>>()?;
        let output = (self.part)(&ends).map_err(Error::wrap)?;
        let outputs = [(output, upstream.contiguous()?)];
        let Some(mut found) = pull(&self.recompute.compute, &outputs)? else {
            return Ok((None, None, None));
        };
        let [a, b, c] = [0, 1, 2].map(|k| ends.get(k).and_then(|end| found.remove(end)));
        // The remaining gradients belong to variables inside the part.
        let mut sums = self.recompute.gradients();
        for id in found.get_ids() {
            if let Some(gradient) = found.get_id(*id) {
                let sum = match sums.remove(id) {
                    Some(sum) => (sum + gradient)?,
                    None => gradient.clone(),
                };
                sums.insert(*id, sum);
            }
        }
        Ok((a, b, c))
    }
}
