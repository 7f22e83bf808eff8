//! Layers with parameters. Images are `[1, height, width, channels]`.

use candle_core::{Result, Tensor};
use candle_nn::Module;
use sharp_kernels::ConvSpec;

use super::compute::Kernels;
use super::ops;
use super::params::{Params, Weight};

/// A convolution: 3×3 with one pixel of padding, 1×1, disjoint blocks, or over a whole map.
pub(super) struct Conv {
    weight: Weight,
    bias: Option<Weight>,
    kernels: Option<Kernels>,
    operation: ops::Convolution,
}

impl Conv {
    /// 3×3, stride 1, one pixel of zero padding.
    pub(super) fn spatial(p: &Params<'_>, input: usize, output: usize, bias: bool) -> Self {
        Self::new(p, (input, output), (3, 1, 1), bias)
    }

    /// 3×3, stride 2, one pixel of zero padding.
    pub(super) fn halving(p: &Params<'_>, input: usize, output: usize) -> Self {
        Self::new(p, (input, output), (3, 2, 1), true)
    }

    /// `side × side` without padding, which reduces a map of that size to one pixel.
    pub(super) fn whole(p: &Params<'_>, input: usize, output: usize, side: usize) -> Self {
        Self::new(p, (input, output), (side, 1, 0), true)
    }

    /// 1×1 convolution.
    pub(super) fn point(p: &Params<'_>, input: usize, output: usize, bias: bool) -> Self {
        Self::new(p, (input, output), (1, 1, 0), bias)
    }

    /// `size × size` convolution with stride `size`.
    pub(super) fn blocks(p: &Params<'_>, input: usize, output: usize, size: usize) -> Self {
        Self::new(p, (input, output), (size, size, 0), true)
    }

    fn new(
        p: &Params<'_>,
        (in_channels, out_channels): (usize, usize),
        (kernel, stride, padding): (usize, usize, usize),
        bias: bool,
    ) -> Self {
        Self {
            weight: p.get("weight", &[out_channels, in_channels, kernel, kernel]),
            bias: bias.then(|| p.get("bias", &[out_channels])),
            kernels: p.kernels,
            operation: ops::Convolution {
                spec: ConvSpec {
                    in_channels,
                    out_channels,
                    kernel,
                    stride,
                    padding,
                },
                relu_input: false,
                relu: false,
                packed: None,
            },
        }
    }

    /// Makes the convolution apply ReLU to its input first.
    pub(super) fn after_relu(mut self) -> Self {
        self.operation.relu_input = true;
        self
    }

    /// Makes the convolution apply ReLU to its result.
    pub(super) fn then_relu(mut self) -> Self {
        self.operation.relu = true;
        self
    }

    /// Convolves `x` and adds `residual` to the result.
    pub(super) fn forward_plus(&self, x: &Tensor, residual: &Tensor) -> Result<Tensor> {
        self.run(x, Some(residual))
    }

    fn run(&self, x: &Tensor, residual: Option<&Tensor>) -> Result<Tensor> {
        let bias = self.bias.as_ref().map(Weight::get).transpose()?;
        let weight = self.weight.get()?;
        self.operation
            .run(self.kernels, x, &weight, bias.as_ref(), residual)
    }
}

impl Module for Conv {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        self.run(x, None)
    }
}

/// A transposed 2×2 convolution with stride 2: every pixel becomes a 2×2 block.
pub(super) struct Deconv {
    weight: Weight,
    bias: Option<Weight>,
    kernels: Option<Kernels>,
}

impl Deconv {
    pub(super) fn new(p: &Params<'_>, input: usize, output: usize, bias: bool) -> Self {
        Self {
            weight: p.get("weight", &[input, output, 2, 2]),
            bias: bias.then(|| p.get("bias", &[output])),
            kernels: p.kernels,
        }
    }
}

impl Module for Deconv {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let bias = self.bias.as_ref().map(Weight::get).transpose()?;
        ops::deconvolution(self.kernels, x, &self.weight.get()?, bias.as_ref())
    }
}

/// Normalisation over groups of channels and all pixels, with a learned scale and shift.
pub(super) struct GroupNorm {
    weight: Weight,
    bias: Weight,
    kernels: Option<Kernels>,
    groups: usize,
    relu: bool,
}

impl GroupNorm {
    const EPS: f32 = 1e-5;

    pub(super) fn new(p: &Params<'_>, width: usize, groups: usize) -> Self {
        Self {
            weight: p.get("weight", &[width]),
            bias: p.get("bias", &[width]),
            kernels: p.kernels,
            groups,
            relu: false,
        }
    }

    /// Makes the normalisation apply ReLU to its result.
    pub(super) fn then_relu(self) -> Self {
        Self { relu: true, ..self }
    }
}

impl Module for GroupNorm {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let affine = [&self.weight.get()?, &self.bias.get()?];
        ops::group_norm(self.kernels, x, affine, (self.groups, Self::EPS, self.relu))
    }
}
