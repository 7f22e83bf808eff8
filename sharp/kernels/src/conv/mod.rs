//! Convolutions of NHWC images. Any range of output rows can be computed from the input rows that
//! it needs.
//!
//! * [`Conv2d`]: square kernels, any stride and padding; direct or Winograd.
//! * [`TransposedConv2x2`]: doubles both sides.
//! * [`backward`](mod@backward): gradients.
//!
//! Private: `direct` (an implicit matrix product), `winograd` and its `transform`.

pub mod backward;
mod direct;
mod transform;
mod transposed;
mod winograd;

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

pub use transposed::TransposedConv2x2;

use crate::rows::{RowOp, RowWindow, expect, window_rows};
use crate::simd::Simd;
use direct::Direct;
use winograd::Winograd;

/// Shape of a convolution: square kernel, equal strides and paddings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvSpec {
    pub in_channels: usize,
    pub out_channels: usize,
    pub kernel: usize,
    pub stride: usize,
    /// Rows and columns of zeros on each side of the image.
    pub padding: usize,
}

impl ConvSpec {
    /// Length of the weights, `[out_channels][in_channels][kernel][kernel]`.
    pub fn weight_len(&self) -> usize {
        self.out_channels * self.in_channels * self.kernel * self.kernel
    }

    fn out_side(&self, side: usize) -> usize {
        match (side + 2 * self.padding).checked_sub(self.kernel) {
            Some(room) => room / self.stride + 1,
            None => 0,
        }
    }
}

/// Algorithm of a convolution; displays as `direct` or `winograd`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// Direct sum of products.
    Direct,
    /// Winograd's F(4×4, 3×3), with a quarter of the multiplications. Supports 3×3 kernels with stride 1, padding 1 and
    /// a multiple of 16 input channels; other convolutions fall back to [`Self::Direct`]. Rounding errors are about
    /// five times those of the direct sum (relative L2 below 5e-6, typically 6e-7).
    Winograd,
}

impl fmt::Display for Algorithm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Direct => "direct",
            Self::Winograd => "winograd",
        })
    }
}

/// Operations fused into a convolution.
#[derive(Debug, Clone, Copy, Default)]
pub struct ConvOptions<'a> {
    /// Applies ReLU to the input as it is read.
    pub relu_input: bool,
    /// Added to the result; same layout as the output.
    pub residual: Option<&'a [f32]>,
    /// Applies ReLU to the result, after the residual is added.
    pub relu: bool,
}

/// A convolution with packed weights.
#[derive(Debug, Clone)]
pub struct Conv2d {
    spec: ConvSpec,
    relu: bool,
    plan: Plan,
}

#[derive(Debug, Clone)]
enum Plan {
    Direct(Direct),
    Winograd(Box<Winograd>),
}

impl Conv2d {
    /// Packs weights `[out][in][kernel][kernel]` (PyTorch's layout) and a bias `[out]`.
    ///
    /// `relu`: true if [`RowOp::run_rows`] should apply ReLU to the result.
    ///
    /// # Panics
    /// If a length is wrong, or the stride or a channel count is zero.
    pub fn new(
        simd: Simd,
        spec: ConvSpec,
        weight: &[f32],
        bias: Option<&[f32]>,
        relu: bool,
        algorithm: Algorithm,
    ) -> Self {
        assert_eq!(weight.len(), spec.weight_len(), "weights of {spec:?}");
        assert!(
            spec.stride > 0 && spec.kernel > 0 && spec.in_channels > 0 && spec.out_channels > 0,
            "{spec:?}"
        );
        let plan = if algorithm == Algorithm::Winograd && Winograd::suits(&spec) {
            Plan::Winograd(Box::new(Winograd::new(simd, &spec, weight, bias)))
        } else {
            Plan::Direct(Direct::new(simd, spec, weight, bias))
        };
        Self { spec, relu, plan }
    }

    pub fn spec(&self) -> ConvSpec {
        self.spec
    }

    /// Algorithm in use; may be [`Algorithm::Direct`] even if Winograd was requested.
    pub fn algorithm(&self) -> Algorithm {
        match self.plan {
            Plan::Direct(_) => Algorithm::Direct,
            Plan::Winograd(_) => Algorithm::Winograd,
        }
    }

    /// Like [`RowOp::run_rows`], with other operations fused in. `options.relu` overrides the `relu` passed to
    /// [`Self::new`].
    ///
    /// # Panics
    /// As for [`RowOp::run_rows`], or if the residual's length differs from the output's.
    pub fn run_rows_with(
        &self,
        input: &RowWindow<'_>,
        out: Range<usize>,
        output: &mut [f32],
        options: ConvOptions<'_>,
    ) {
        assert_eq!(input.channels(), self.spec.in_channels, "input channels");
        expect(self, input, &out, output);
        if let Some(residual) = options.residual {
            assert_eq!(residual.len(), output.len(), "length of the residual");
        }
        match &self.plan {
            Plan::Direct(direct) => direct.run(input, out, output, options),
            Plan::Winograd(winograd) => winograd.run(input, out, output, options),
        }
    }
}

impl RowOp for Conv2d {
    fn out_size(&self, height: usize, width: usize) -> (usize, usize) {
        (self.spec.out_side(height), self.spec.out_side(width))
    }

    fn out_channels(&self, _in_channels: usize) -> usize {
        self.spec.out_channels
    }

    fn in_rows(&self, out: Range<usize>, in_height: usize) -> Range<usize> {
        let ConvSpec {
            kernel,
            stride,
            padding,
            ..
        } = self.spec;
        let out = match self.plan {
            Plan::Direct(_) => out,
            Plan::Winograd(_) => winograd::whole_tiles(out),
        };
        window_rows(out, in_height, kernel, stride, padding)
    }

    fn run_rows(&self, input: &RowWindow<'_>, out: Range<usize>, output: &mut [f32]) {
        let options = ConvOptions {
            relu: self.relu,
            ..ConvOptions::default()
        };
        self.run_rows_with(input, out, output, options);
    }
}

#[cfg(test)]
mod tests;
