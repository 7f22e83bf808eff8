//! Square convolutions with bias and ReLU over a range of rows.

use std::ops::Range;

use rayon::prelude::*;

use super::rows::{Rows, Size};

/// A convolution with its weights, ready to run.
#[derive(Debug)]
pub(crate) struct Convolution {
    kernel: usize,
    stride: usize,
    padding: usize,
    inputs: usize,
    outputs: usize,
    /// [kernel row, kernel column, input channel, output channel].
    weights: Vec<f32>,
    bias: Vec<f32>,
}

/// Pixels that one matrix product computes; rows are cut at multiples of it, so that the same
/// products are formed for any range of rows.
const PIXELS: usize = 128;

impl Convolution {
    /// Packs weights of shape [outputs, inputs, kernel, kernel] and biases of shape [outputs].
    pub(crate) fn new(
        shape: [usize; 3],
        stride: usize,
        padding: usize,
        weights: &[f32],
        bias: &[f32],
    ) -> Self {
        let [outputs, inputs, kernel] = shape;
        let mut packed = vec![0.0; weights.len()];
        for (i, &weight) in weights.iter().enumerate() {
            let (kx, ky) = (i % kernel, i / kernel % kernel);
            let (c, o) = (
                i / (kernel * kernel) % inputs,
                i / (kernel * kernel * inputs),
            );
            packed[((ky * kernel + kx) * inputs + c) * outputs + o] = weight;
        }
        Self {
            kernel,
            stride,
            padding,
            inputs,
            outputs,
            weights: packed,
            bias: bias.to_vec(),
        }
    }

    /// Size of the output for an input of size `input`; `None` if the kernel does not fit.
    pub(crate) fn output(&self, input: Size) -> Option<Size> {
        let side = |n: usize| {
            let room = (n + 2 * self.padding).checked_sub(self.kernel)?;
            Some(room / self.stride + 1)
        };
        Some(Size {
            height: side(input.height)?,
            width: side(input.width)?,
            channels: self.outputs,
        })
    }

    /// The input rows that output row `y` reads, as far as they exist.
    pub(crate) fn needs(&self, y: usize, height: usize) -> Range<usize> {
        let first = y * self.stride;
        first.saturating_sub(self.padding)..(first + self.kernel - self.padding).min(height)
    }

    /// Output rows `rows` with ReLU into `out`, whose pixels are `pitch` values apart: two
    /// convolutions can fill alternating channels of one map.
    pub(crate) fn run(
        &self,
        input: Rows,
        rows: Range<usize>,
        width: usize,
        pitch: usize,
        out: &mut [f32],
    ) {
        let depth = self.kernel * self.kernel * self.inputs;
        out.par_chunks_mut(width * pitch).zip(rows).for_each_init(
            || (vec![0.0; PIXELS * depth], vec![0.0; PIXELS * self.outputs]),
            |(patches, products), (out, y)| {
                for (block, out) in out.chunks_mut(PIXELS * pitch).enumerate() {
                    let first = block * PIXELS;
                    let count = PIXELS.min(width - first);
                    for i in 0..count {
                        self.gather(input, first + i, y, &mut patches[i * depth..][..depth]);
                    }
                    self.multiply(patches, products, count);
                    for i in 0..count {
                        let out = &mut out[i * pitch..][..self.outputs];
                        let sums = &products[i * self.outputs..][..self.outputs];
                        for ((out, &sum), &bias) in out.iter_mut().zip(sums).zip(&self.bias) {
                            *out = (sum + bias).max(0.0);
                        }
                    }
                }
            },
        );
    }

    /// The input under the kernel at output pixel (x, y), zero outside the picture.
    fn gather(&self, input: Rows, x: usize, y: usize, patch: &mut [f32]) {
        let (x0, y0) = (x * self.stride, y * self.stride);
        let line = self.kernel * self.inputs;
        for (ky, patch) in patch.chunks_exact_mut(line).enumerate() {
            let Some(row) = (y0 + ky).checked_sub(self.padding) else {
                patch.fill(0.0);
                continue;
            };
            if row >= input.size.height {
                patch.fill(0.0);
                continue;
            }
            let row = input.row(row);
            for (kx, patch) in patch.chunks_exact_mut(self.inputs).enumerate() {
                match (x0 + kx).checked_sub(self.padding) {
                    Some(x) if x < input.size.width => {
                        patch.copy_from_slice(&row[x * self.inputs..][..self.inputs]);
                    }
                    _ => patch.fill(0.0),
                }
            }
        }
    }

    fn multiply(&self, patches: &[f32], products: &mut [f32], count: usize) {
        let depth = self.kernel * self.kernel * self.inputs;
        assert!(patches.len() >= count * depth && products.len() >= count * self.outputs);
        let (n, k) = (self.outputs as isize, depth as isize);
        // SAFETY: row-major matrices count × depth, depth × outputs and count × outputs lie
        // within the three slices, the first and last by the assertion.
        unsafe {
            gemm::gemm(
                count,
                self.outputs,
                depth,
                products.as_mut_ptr(),
                1,
                n,
                false,
                patches.as_ptr(),
                1,
                k,
                self.weights.as_ptr(),
                1,
                n,
                0.0,
                1.0,
                false,
                false,
                false,
                gemm::Parallelism::None,
            );
        }
    }
}
