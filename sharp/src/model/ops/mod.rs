//! The operations of the network's layers: by candle on any device, or by our kernels, as candle's custom operations, on
//! the CPU.
//!
//! Images are `[1, height, width, channels]`, tokens `[images, tokens, channels]`, on every device.

mod convolution;
mod custom;
mod frozen;
mod images;
mod norm;
mod tokens;

pub(super) use convolution::{Convolution, deconvolution};
pub use custom::pull;
pub use frozen::{FrozenConvolution, max_pool};
pub(super) use images::{avg_pool, double_nearest, from_planes, gather, to_planes};
pub(super) use norm::{group_norm, layer_norm};
pub(super) use tokens::{Linear, attention};

use candle_core::{Result, Tensor};

/// Weights with biases behind them: an operation has three inputs at most.
fn joined(weight: &Tensor, bias: Option<&Tensor>) -> Result<Tensor> {
    match bias {
        Some(bias) => Tensor::cat(&[&weight.flatten_all()?, bias], 0),
        None => weight.flatten_all(),
    }
}

/// Weights of `shape`, and the biases behind them, if any.
fn parted(weights: &Tensor, shape: &[usize]) -> Result<(Tensor, Option<Tensor>)> {
    let (count, all) = (shape.iter().product(), weights.elem_count());
    let weight = weights.narrow(0, 0, count)?.reshape(shape)?;
    let bias = (all > count).then(|| weights.narrow(0, count, all - count));
    Ok((weight, bias.transpose()?))
}

/// Unlike candle's, this passes no gradient at 0; NaN stays NaN.
fn rectified(x: &Tensor) -> Result<Tensor> {
    x.le(0.0)?.where_cond(&x.zeros_like()?, x)
}

#[cfg(test)]
mod tests;
