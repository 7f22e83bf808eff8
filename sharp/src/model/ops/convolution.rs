//! Convolutions and transposed convolutions.

use std::borrow::Cow;
use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::Module;
use rayon::prelude::*;
use sharp_kernels::conv::backward::{
    ConvInput, InputGradient, bias_gradient, keep_where_positive, weight_gradient,
};
use sharp_kernels::{Conv2d, ConvOptions, ConvSpec, RowOp, RowWindow, TransposedConv2x2};

use super::custom::{Back, Operation, Pass, View, apply};
use super::{joined, parted, rectified};
use crate::model::compute::Kernels;

/// A convolution and the operations fused into it.
#[derive(Clone)]
pub(in crate::model) struct Convolution {
    pub(in crate::model) spec: ConvSpec,
    /// Applies ReLU to the input first.
    pub(in crate::model) relu_input: bool,
    /// Applies ReLU to the result, after the residual is added.
    pub(in crate::model) relu: bool,
    /// Constant weights, packed for the forward and the backward direction.
    pub(in crate::model) packed: Option<Arc<(Conv2d, InputGradient)>>,
}

impl Convolution {
    /// `weight` is `[out, in, kernel, kernel]`; `residual` is added to the result.
    pub(in crate::model) fn run(
        &self,
        kernels: Option<Kernels>,
        x: &Tensor,
        weight: &Tensor,
        bias: Option<&Tensor>,
        residual: Option<&Tensor>,
    ) -> Result<Tensor> {
        let ConvSpec {
            in_channels,
            out_channels,
            kernel,
            stride,
            ..
        } = self.spec;
        if kernel > 1 && kernel == stride && kernels.is_none_or(|kernels| kernels.learning) {
            let channels = kernel * kernel * in_channels;
            let weight = weight.permute((0, 2, 3, 1))?;
            let weight = weight.reshape((out_channels, channels, 1, 1))?;
            let of_pixels = Self {
                spec: point(channels, out_channels),
                ..self.clone()
            };
            let x = &blocks_as_pixels(x, kernel)?;
            return of_pixels.run(kernels, x, &weight, bias, residual);
        }
        let weights = &joined(weight, bias)?;
        let inputs: Vec<&Tensor> = [x, weights].into_iter().chain(residual).collect();
        apply(kernels, self.clone(), &inputs)
    }
}

impl Operation for Convolution {
    const NAME: &'static str = "sharp-convolution";

    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        let ConvSpec {
            in_channels,
            out_channels,
            kernel,
            stride,
            padding,
        } = self.spec;
        let shape = [out_channels, in_channels, kernel, kernel];
        let (weight, bias) = parted(&inputs[1], &shape)?;
        let x = if self.relu_input {
            rectified(&inputs[0])?
        } else {
            inputs[0].clone()
        };
        let y = match kernel {
            1 => candle_nn::Linear::new(weight.flatten_from(1)?, None).forward(&x)?,
            _ => {
                let planes = x.permute((0, 3, 1, 2))?.contiguous()?;
                let y = planes.conv2d(&weight, padding, 1, 1, 1)?;
                y.permute((0, 2, 3, 1))?.contiguous()?
            }
        };
        // Candle does not support gradients of convolutions for every stride, so the result is subsampled instead.
        let mut y = every(&y, stride)?;
        for term in bias.iter().chain(inputs.get(2)) {
            y = y.broadcast_add(term)?;
        }
        if self.relu { rectified(&y) } else { Ok(y) }
    }

    fn by_kernels(&self, kernels: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        let fresh = || {
            let (weight, bias) = split(&self.spec, inputs[1]);
            Cow::Owned(kernels.conv2d(self.spec, weight, bias))
        };
        let packed = self.packed.as_deref();
        let conv = packed.map_or_else(fresh, |(conv, _)| Cow::Borrowed(conv));
        let (height, width, _) = inputs[0].image();
        let (rows, columns) = conv.out_size(height, width);
        let mut out = vec![0.0; rows * columns * self.spec.out_channels];
        let options = ConvOptions {
            relu_input: self.relu_input,
            residual: inputs.get(2).map(|residual| residual.values),
            relu: self.relu,
        };
        conv.run_rows_with(&inputs[0].window(), 0..rows, &mut out, options);
        (out, vec![1, rows, columns, self.spec.out_channels])
    }

    fn back(&self, kernels: Kernels, pass: &Pass<'_>) -> Option<Vec<Option<Back>>> {
        let (height, width, _) = pass.inputs[0].image();
        let input = ConvInput {
            data: pass.inputs[0].values,
            height,
            width,
            relu: self.relu_input,
        };
        let upstream = pass.upstream(self.relu);
        let packed = self.packed.as_deref().map(|(_, back)| back);
        Some(gradients(kernels, self.spec, input, upstream, pass, packed))
    }
}

fn split<'a>(spec: &ConvSpec, weights: View<'a>) -> (&'a [f32], Option<&'a [f32]>) {
    let (weight, bias) = weights.values.split_at(spec.weight_len());
    (weight, (!bias.is_empty()).then_some(bias))
}

/// Keeps the pixels whose row and column are multiples of `step`.
pub(super) fn every(x: &Tensor, step: usize) -> Result<Tensor> {
    if step == 1 {
        return Ok(x.clone());
    }
    let (_, height, width, channels) = x.dims4()?;
    let [rows, columns] = [height, width].map(|side| side.div_ceil(step));
    x.pad_with_zeros(1, 0, rows * step - height)?
        .pad_with_zeros(2, 0, columns * step - width)?
        .reshape((rows, step, columns, step * channels))?
        .narrow(1, 0, 1)?
        .narrow(3, 0, channels)?
        .contiguous()?
        .reshape((1, rows, columns, channels))
}

/// Gradients of a convolution's input, of the weights followed by the biases, and of the residual
/// added to the result.
pub(super) fn gradients(
    kernels: Kernels,
    spec: ConvSpec,
    input: ConvInput<'_>,
    upstream: Cow<'_, [f32]>,
    pass: &Pass<'_>,
    packed: Option<&InputGradient>,
) -> Vec<Option<Back>> {
    let (weight, bias) = split(&spec, pass.inputs[1]);
    let of_input = pass.wants(0).then(|| {
        let fresh = || {
            let back = InputGradient::new(kernels.simd, spec, weight, kernels.convolution);
            Cow::Owned(back)
        };
        let back = packed.map_or_else(fresh, Cow::Borrowed);
        let mut values = back.run(&upstream, input.height, input.width);
        if input.relu {
            keep_where_positive(&mut values, input.data);
        }
        Back::Values(values)
    });
    let of_weights = pass.wants(1).then(|| {
        let mut values = weight_gradient(kernels.simd, spec, input, &upstream);
        if bias.is_some() {
            values.extend(bias_gradient(&upstream, spec.out_channels));
        }
        Back::Values(values)
    });
    let of_residual = match upstream {
        Cow::Borrowed(_) => Back::Upstream,
        Cow::Owned(values) => Back::Values(values),
    };
    let of_residual = pass.wants(2).then_some(of_residual);
    vec![of_input, of_weights, of_residual]
}

/// Transposed 2×2 convolution of stride 2; `weight` is `[in, out, 2, 2]`.
pub(in crate::model) fn deconvolution(
    kernels: Option<Kernels>,
    x: &Tensor,
    weight: &Tensor,
    bias: Option<&Tensor>,
) -> Result<Tensor> {
    let (input, output, ..) = weight.dims4()?;
    let weights = &joined(weight, bias)?;
    apply(kernels, Deconvolution { input, output }, &[x, weights])
}

/// Turns each block into one pixel: `[1, height, width, channels]` to `[1, height / size, width / size, size² ·
/// channels]`.
fn blocks_as_pixels(x: &Tensor, size: usize) -> Result<Tensor> {
    let (_, h, w, c) = x.dims4()?;
    x.reshape((h / size, size, w / size, size, c))?
        .permute((0, 2, 1, 3, 4))?
        .reshape((1, h / size, w / size, size * size * c))
}

/// Spec of a 1×1 convolution.
pub(super) fn point(in_channels: usize, out_channels: usize) -> ConvSpec {
    ConvSpec {
        in_channels,
        out_channels,
        kernel: 1,
        stride: 1,
        padding: 0,
    }
}

struct Deconvolution {
    input: usize,
    output: usize,
}

impl Operation for Deconvolution {
    const NAME: &'static str = "sharp-deconvolution";

    /// Multiplies the channels of each input pixel by a matrix. The product holds the pixels of the
    /// 2×2 output block.
    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        let Self { input, output } = *self;
        let (weight, bias) = parted(&inputs[1], &[input, output, 2, 2])?;
        let weight = weight.permute((2, 3, 1, 0))?.reshape((4 * output, input))?;
        let bias = bias.map(|bias| Tensor::cat(&[&bias; 4], 0)).transpose()?;
        let y = candle_nn::Linear::new(weight, bias).forward(&inputs[0])?;
        let (_, h, w, _) = y.dims4()?;
        y.reshape((h, w, 2, 2, output))?
            .permute((0, 2, 1, 3, 4))?
            .reshape((1, 2 * h, 2 * w, output))
    }

    fn by_kernels(&self, kernels: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        let Self { input, output } = *self;
        let (weight, bias) = inputs[1].values.split_at(4 * input * output);
        let bias = (!bias.is_empty()).then_some(bias);
        let deconv = TransposedConv2x2::new(kernels.simd, input, output, weight, bias);
        let (height, width, _) = inputs[0].image();
        let (rows, columns) = (2 * height, 2 * width);
        let mut out = vec![0.0; rows * columns * output];
        deconv.run_rows(&inputs[0].window(), 0..rows, &mut out);
        (out, vec![1, rows, columns, output])
    }

    /// The gradient of a transposed convolution is the convolution of 2×2 blocks that it
    /// transposes. That convolution is computed as a 1×1 convolution over pixels whose channels
    /// hold the values of a block.
    fn back(&self, kernels: Kernels, pass: &Pass<'_>) -> Option<Vec<Option<Back>>> {
        let x = pass.inputs[0].values;
        let (height, width, input) = pass.inputs[0].image();
        let (output, channels) = (self.output, 4 * self.output);
        let mut blocks = vec![0.0; pass.upstream.len()];
        let rows = blocks.par_chunks_mut(width * channels);
        let rows = rows.zip(pass.upstream.par_chunks(width * channels));
        rows.for_each(|(pixels, upstream)| {
            for (x, pixel) in pixels.chunks_exact_mut(channels).enumerate() {
                for (k, v) in pixel.iter_mut().enumerate() {
                    let (o, row, column) = (k / 4, k / 2 % 2, 2 * x + k % 2);
                    *v = upstream[(row * 2 * width + column) * output + o];
                }
            }
        });
        let spec = point(channels, input);
        let (weight, bias) = split(&spec, pass.inputs[1]);
        let of_input = pass.wants(0).then(|| {
            let conv = kernels.conv2d(spec, weight, None);
            let mut values = vec![0.0; x.len()];
            let window = RowWindow::whole(&blocks, height, width, channels);
            conv.run_rows(&window, 0..height, &mut values);
            Back::Values(values)
        });
        let of_weights = pass.wants(1).then(|| {
            let blocks = ConvInput {
                data: &blocks,
                height,
                width,
                relu: false,
            };
            let mut values = weight_gradient(kernels.simd, spec, blocks, x);
            if bias.is_some() {
                values.extend(bias_gradient(pass.upstream, output));
            }
            Back::Values(values)
        });
        Some(vec![of_input, of_weights])
    }
}
