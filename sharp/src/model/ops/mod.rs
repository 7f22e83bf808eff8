//! Operations of the network's layers, implemented by candle on any device, or on the CPU by this project's kernels (as
//! candle custom ops).
//!
//! Images are `[1, height, width, channels]`, tokens `[images, tokens, channels]`, on every device.

mod convolution;
mod custom;
mod frozen;
mod images;
mod norm;
mod recompute;
mod tokens;

pub(super) use convolution::{Convolution, deconvolution};
pub use custom::pull;
pub use frozen::{FrozenConvolution, max_pool};
pub(super) use images::{avg_pool, double_nearest, from_planes, gather, to_planes};
pub(super) use norm::{group_norm, layer_norm};
pub(super) use recompute::Recompute;
pub(super) use tokens::{Linear, attention};

use candle_core::{Result, Tensor};

/// Concatenates weights and biases, because an operation has at most three inputs.
fn joined(weight: &Tensor, bias: Option<&Tensor>) -> Result<Tensor> {
    match bias {
        Some(bias) => Tensor::cat(&[&weight.flatten_all()?, bias], 0),
        None => weight.flatten_all(),
    }
}

/// Splits the output of [`joined`] into weights of `shape` and biases, if any.
fn parted(weights: &Tensor, shape: &[usize]) -> Result<(Tensor, Option<Tensor>)> {
    let (count, all) = (shape.iter().product(), weights.elem_count());
    let weight = weights.narrow(0, 0, count)?.reshape(shape)?;
    let bias = (all > count).then(|| weights.narrow(0, count, all - count));
    Ok((weight, bias.transpose()?))
}

/// ReLU. Unlike candle's, it has gradient 0 at 0, and keeps NaN.
fn rectified(x: &Tensor) -> Result<Tensor> {
    x.le(0.0)?.where_cond(&x.zeros_like()?, x)
}

#[cfg(test)]
mod tests;
