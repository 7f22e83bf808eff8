//! Normalisations with scales and shifts.

use candle_core::{D, DType, Result, Tensor};
use sharp_kernels::NormGradient;

use super::custom::{Back, Operation, Pass, View, apply};
use super::rectified;
use crate::model::compute::Kernels;

/// Normalisation over groups of channels and all pixels of an image, followed by ReLU if `relu`.
pub(in crate::model) fn group_norm(
    kernels: Option<Kernels>,
    x: &Tensor,
    [gamma, beta]: [&Tensor; 2],
    (groups, eps, relu): (usize, f32, bool),
) -> Result<Tensor> {
    let norm = GroupNorm { groups, eps, relu };
    apply(kernels, norm, &[x, gamma, beta])
}

struct GroupNorm {
    groups: usize,
    eps: f32,
    relu: bool,
}

impl GroupNorm {
    fn kernel(&self, inputs: &[View<'_>]) -> sharp_kernels::GroupNorm {
        let [gamma, beta] = [1, 2].map(|k| inputs[k].values);
        sharp_kernels::GroupNorm::new(self.groups, gamma, beta, self.eps)
    }
}

impl Operation for GroupNorm {
    const NAME: &'static str = "sharp-group-norm";

    /// Uses f64 if the device supports it: over the millions of values of a group, f32 sums would be off by 1e-5.
    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        let (_, h, w, c) = inputs[0].dims4()?;
        let x = inputs[0].reshape((h * w, self.groups, c / self.groups))?;
        let wide = if x.device().is_metal() {
            DType::F32
        } else {
            DType::F64
        };
        let mean = |t: &Tensor| {
            let t = t.to_dtype(wide)?;
            t.mean_keepdim(0)?.mean_keepdim(2)?.to_dtype(x.dtype())
        };
        let y = normalized(&x, mean, self.eps)?.reshape((1, h, w, c))?;
        let y = y.broadcast_mul(&inputs[1])?.broadcast_add(&inputs[2])?;
        if self.relu { rectified(&y) } else { Ok(y) }
    }

    fn by_kernels(&self, kernels: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        let View { values, dims } = inputs[0];
        let mut out = vec![0.0; values.len()];
        self.kernel(inputs)
            .run(kernels.simd, values, self.relu, &mut out);
        (out, dims.to_vec())
    }

    fn back(&self, kernels: Kernels, pass: &Pass<'_>) -> Option<Vec<Option<Back>>> {
        let (x, upstream) = (pass.inputs[0].values, pass.upstream(self.relu));
        let NormGradient { input, gamma, beta } =
            self.kernel(pass.inputs)
                .backward(kernels.simd, x, &upstream);
        let all = [input, gamma, beta];
        Some(all.map(|values| Some(Back::Values(values))).into())
    }
}

/// Normalises every token.
pub(in crate::model) fn layer_norm(
    kernels: Option<Kernels>,
    x: &Tensor,
    [gamma, beta]: [&Tensor; 2],
    eps: f32,
) -> Result<Tensor> {
    apply(kernels, LayerNorm(eps), &[x, gamma, beta])
}

struct LayerNorm(f32);

impl Operation for LayerNorm {
    const NAME: &'static str = "sharp-layer-norm";

    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        normalized(&inputs[0], |t| t.mean_keepdim(D::Minus1), self.0)?
            .broadcast_mul(&inputs[1])?
            .broadcast_add(&inputs[2])
    }

    fn by_kernels(&self, kernels: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        let [x, gamma, beta] = [0, 1, 2].map(|k| inputs[k].values);
        let mut out = vec![0.0; x.len()];
        sharp_kernels::layer_norm(kernels.simd, x, gamma, beta, self.0, &mut out);
        (out, inputs[0].dims.to_vec())
    }
}

/// Normalises with the given mean. Values are centred before they are squared, because a difference of large sums
/// would lose digits.
fn normalized(x: &Tensor, mean: impl Fn(&Tensor) -> Result<Tensor>, eps: f32) -> Result<Tensor> {
    let centered = x.broadcast_sub(&mean(x)?)?;
    let variance = mean(&centered.sqr()?)?;
    centered.broadcast_div(&(variance + f64::from(eps))?.sqrt()?)
}
