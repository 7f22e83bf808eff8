//! Convolution as a matrix product: output pixels by (kernel row, kernel column, input channel).
//!
//! The matrix of patches is never stored; each task copies the runs it needs. In NHWC, a whole kernel row of a patch is
//! contiguous.

use std::ops::Range;

use crate::conv::{ConvOptions, ConvSpec};
use crate::gemm::{Epilogue, PackedMatrix, product};
use crate::math::relu;
use crate::rows::RowWindow;
use crate::simd::Simd;
use crate::workspace::SharedOut;

#[derive(Debug, Clone)]
pub(super) struct Direct {
    spec: ConvSpec,
    weight: PackedMatrix,
}

/// Epilogue that corresponds to the options of a convolution.
pub(super) fn epilogue<'a>(options: &ConvOptions<'a>) -> Epilogue<'a> {
    match (options.residual, options.relu) {
        (None, false) => Epilogue::None,
        (None, true) => Epilogue::Relu,
        (Some(r), false) => Epilogue::Residual(r),
        (Some(r), true) => Epilogue::ResidualRelu(r),
    }
}

impl Direct {
    pub(super) fn new(simd: Simd, spec: ConvSpec, weight: &[f32], bias: Option<&[f32]>) -> Self {
        let ConvSpec {
            in_channels: c,
            out_channels: n,
            kernel,
            ..
        } = spec;
        let area = kernel * kernel;
        let weight = PackedMatrix::pack(simd, area * c, n, bias, |row, col| {
            let (place, channel) = (row / c, row % c);
            weight[(col * c + channel) * area + place]
        });
        Self { spec, weight }
    }

    pub(super) fn run(
        &self,
        input: &RowWindow<'_>,
        out: Range<usize>,
        output: &mut [f32],
        options: ConvOptions<'_>,
    ) {
        let width = self.spec.out_side(input.width());
        let n = self.spec.out_channels;
        let copy = |pixel: usize, ks: Range<usize>, dst: &mut [f32]| {
            self.copy_patch(input, out.start + pixel / width, pixel % width, ks, dst);
            if options.relu_input {
                dst.iter_mut().for_each(|v| *v = relu(*v));
            }
        };
        let (pixels, epilogue) = (out.len() * width, epilogue(&options));
        let shared = SharedOut::new(output);
        // SAFETY: pixels are contiguous and do not overlap.
        unsafe {
            product(&self.weight, pixels, epilogue, shared, copy, |pixel| {
                pixel * n
            })
        };
    }

    /// Copies elements `ks` of the input patch under output pixel (`y`, `x`) to `dst`. Elements beyond the image are
    /// zero.
    #[inline(always)]
    fn copy_patch(
        &self,
        input: &RowWindow<'_>,
        y: usize,
        x: usize,
        ks: Range<usize>,
        mut dst: &mut [f32],
    ) {
        let ConvSpec {
            kernel,
            stride,
            padding,
            in_channels: c,
            ..
        } = self.spec;
        let run = kernel * c;
        // Elements of a kernel row that lie left and right of the image.
        let left = (padding.saturating_sub(x * stride) * c).min(run);
        let right = ((x * stride + kernel).saturating_sub(padding + input.width()) * c).min(run);
        let mut k = ks.start;
        while k < ks.end {
            let (ky, from) = (k / run, k % run);
            let to = run.min(from + ks.end - k);
            let (part, rest) = dst.split_at_mut(to - from);
            dst = rest;
            k += to - from;
            let row = (y * stride + ky).checked_sub(padding);
            match row.filter(|&row| row < input.height()) {
                Some(row) if left == 0 && right == 0 => {
                    let start = (x * stride - padding) * c;
                    part.copy_from_slice(&input.row(row)[start + from..start + to]);
                }
                Some(row) => {
                    let (a, b) = (left.clamp(from, to), (run - right).clamp(from, to));
                    let b = b.max(a);
                    part[..a - from].fill(0.0);
                    if a < b {
                        let start = x * stride * c + a - padding * c;
                        part[a - from..b - from].copy_from_slice(&input.row(row)[start..][..b - a]);
                    }
                    part[b - from..].fill(0.0);
                }
                None => part.fill(0.0),
            }
        }
    }
}
