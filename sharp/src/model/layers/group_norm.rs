//! Group normalisation.

use std::sync::Arc;

use candle_core::{DType, Tensor};
use sharp_kernels::Simd;

use super::Learned;
use crate::model::ModelError;
use crate::model::engine::{Engine, Runtime};
use crate::model::map::{HostMap, Map, mixed};
use crate::model::params::{Parameter, Params};
use crate::model::tape::Node;

/// Normalisation over groups of channels and all pixels, then a learned scale and shift.
pub(in crate::model) struct GroupNormLayer {
    weight: Parameter,
    bias: Parameter,
    groups: usize,
}

impl GroupNormLayer {
    const EPS: f32 = 1e-5;

    pub(in crate::model) fn new(p: &Params<'_>, width: usize, groups: usize) -> Self {
        Self {
            weight: p.get("weight", &[width]),
            bias: p.get("bias", &[width]),
            groups,
        }
    }

    /// `[width, h, w]` to the same shape.
    pub(in crate::model) fn forward(&self, rt: &Runtime, x: &Map) -> Result<Map, ModelError> {
        match (&rt.engine, x) {
            (Engine::Kernels(kernels), Map::Host(x)) => {
                let norm = sharp_kernels::GroupNorm::new(
                    self.groups,
                    &rt.values(&self.weight)?,
                    &rt.values(&self.bias)?,
                    Self::EPS,
                );
                let mut out = vec![0.0; x.data.len()];
                norm.run(kernels.simd, &x.data, false, &mut out);
                let node = self.recorded(rt, kernels.simd, norm, x);
                let shape = (x.height, x.width, x.channels);
                Ok(Map::Host(HostMap::new(shape, out).at_node(node)))
            }
            (Engine::Tensors(_), Map::Tensor(x)) => Ok(Map::Tensor(self.on_tensors(rt, x)?)),
            _ => Err(mixed()),
        }
    }

    /// The way back, in training.
    fn recorded(
        &self,
        rt: &Runtime,
        simd: Simd,
        norm: sharp_kernels::GroupNorm,
        x: &HostMap,
    ) -> Option<Node> {
        let learned = Learned::of(rt, &self.weight, Some(&self.bias));
        let tape = rt.tape.as_ref()?;
        if !learned.any() && x.node.is_none() {
            return None;
        }
        let (data, node) = (Arc::clone(&x.data), x.node.clone());
        Some(tape.record(move |g, gradients| {
            let back = norm.backward(simd, &data, &g);
            let of_input = learned.add_norm(gradients, back);
            gradients.add(node.as_ref(), of_input);
            Ok(())
        }))
    }

    /// Sums in f64 where the device has it: over the millions of values of a group, f32 would be
    /// off by 1e-5.
    fn on_tensors(&self, rt: &Runtime, x: &Tensor) -> Result<Tensor, ModelError> {
        let (_, c, h, w) = x.dims4()?;
        let wide = if x.device().is_metal() {
            DType::F32
        } else {
            DType::F64
        };
        let grouped = x.reshape((self.groups, c / self.groups * h, w))?;
        let mean = |t: &Tensor| {
            let t = t.to_dtype(wide)?;
            t.mean_keepdim(2)?.mean_keepdim(1)?.to_dtype(DType::F32)
        };
        let centered = grouped.broadcast_sub(&mean(&grouped)?)?;
        let variance = mean(&centered.sqr()?)?;
        let deviation = (variance + f64::from(Self::EPS))?.sqrt()?;
        let normal = centered.broadcast_div(&deviation)?;
        let per_channel = |parameter: &Parameter| {
            Ok::<_, ModelError>(rt.tensor(parameter, x.device())?.reshape((1, c, 1, 1))?)
        };
        Ok(normal
            .reshape((1, c, h, w))?
            .broadcast_mul(&per_channel(&self.weight)?)?
            .broadcast_add(&per_channel(&self.bias)?)?)
    }
}
