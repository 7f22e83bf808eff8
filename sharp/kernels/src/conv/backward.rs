//! Gradients of convolutions with respect to their weights, biases and inputs.
//!
//! The padding must preserve the image's size (up to the stride). Weight gradients support stride 1 only.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

use crate::conv::{Algorithm, Conv2d, ConvSpec};
use crate::gemm::{Epilogue, PackedMatrix, product};
use crate::math::relu;
use crate::rows::{RowOp, RowWindow};
use crate::simd::Simd;
use crate::workspace::SharedOut;

/// Pixels whose products one task sums. A constant, so that results do not depend on the number of threads.
const PIXELS_PER_TASK: usize = 4096;

/// Input image of a convolution.
#[derive(Debug, Clone, Copy)]
pub struct ConvInput<'a> {
    /// Pixels, `[height][width][channels]`.
    pub data: &'a [f32],
    pub height: usize,
    pub width: usize,
    /// True if the convolution applied ReLU to its input.
    pub relu: bool,
}

/// Gradient with respect to the weights, in their layout `[out][in][kernel][kernel]`.
///
/// `upstream`, `[rows][columns][out]`, is the gradient with respect to the convolution's result
/// before any ReLU. Sums over 4096 pixels are accumulated in f32, and these partial sums are added
/// in f64.
///
/// # Panics
/// If a length is wrong, or the convolution changes the image's size.
pub fn weight_gradient(
    simd: Simd,
    spec: ConvSpec,
    input: ConvInput<'_>,
    upstream: &[f32],
) -> Vec<f32> {
    assert!(keeps_size(&spec), "{spec:?}");
    let pixels = input.height * input.width;
    assert_eq!(input.data.len(), pixels * spec.in_channels, "input");
    assert_eq!(upstream.len(), pixels * spec.out_channels, "upstream");
    let rows_per_task = (PIXELS_PER_TASK / input.width.max(1)).max(1);
    let parts: Vec<Vec<f32>> = (0..input.height.div_ceil(rows_per_task))
        .into_par_iter()
        .with_max_len(1)
        .map(|part| {
            let first = part * rows_per_task;
            let rows = first..input.height.min(first + rows_per_task);
            part_of_weight_gradient(simd, spec, &input, upstream, rows)
        })
        .collect();
    let area = spec.kernel * spec.kernel;
    let mut out = vec![0.0; spec.weight_len()];
    for (o, out) in out.chunks_exact_mut(spec.in_channels * area).enumerate() {
        for c in 0..spec.in_channels {
            for tap in 0..area {
                let at = (tap * spec.in_channels + c) * spec.out_channels + o;
                let sum: f64 = parts.iter().map(|part| f64::from(part[at])).sum();
                out[c * area + tap] = sum as f32;
            }
        }
    }
    out
}

/// Contribution of some output rows to the weight gradient, `[tap][in][out]`.
///
/// Computed as a matrix product over pixels. Each channel of the zero-padded image is stored as one
/// row. Each tap of the kernel then reads the same row at a different offset.
fn part_of_weight_gradient(
    simd: Simd,
    spec: ConvSpec,
    input: &ConvInput<'_>,
    upstream: &[f32],
    rows: Range<usize>,
) -> Vec<f32> {
    let (c, n, pad) = (spec.in_channels, spec.out_channels, spec.padding);
    let width = input.width + 2 * pad;
    let k = rows.len() * width;
    // The last tap reads `2 * pad` elements beyond the last row.
    let plane = (rows.len() + 2 * pad) * width + 2 * pad;
    let mut planes = vec![0.0; c * plane];
    for y in 0..rows.len() + 2 * pad {
        let Some(row) = (rows.start + y).checked_sub(pad) else {
            continue;
        };
        if row >= input.height {
            continue;
        }
        let pixels = &input.data[row * input.width * c..][..input.width * c];
        // A row stays in the L1 cache while its channels are extracted.
        for channel in 0..c {
            let out = &mut planes[channel * plane + y * width + pad..][..input.width];
            let values = pixels[channel..].iter().step_by(c);
            if input.relu {
                out.iter_mut()
                    .zip(values)
                    .for_each(|(out, v)| *out = relu(*v));
            } else {
                out.iter_mut().zip(values).for_each(|(out, v)| *out = *v);
            }
        }
    }
    let packed = PackedMatrix::pack(simd, k, n, None, |at, o| {
        let (y, x) = (at / width, at % width);
        if x < input.width {
            upstream[((rows.start + y) * input.width + x) * n + o]
        } else {
            0.0
        }
    });
    let m = spec.kernel * spec.kernel * c;
    let mut out = vec![0.0; m * n];
    let copy = |row: usize, ks: Range<usize>, dst: &mut [f32]| {
        let (tap, channel) = (row / c, row % c);
        let shift = tap / spec.kernel * width + tap % spec.kernel;
        dst.copy_from_slice(&planes[channel * plane + shift..][ks]);
    };
    let shared = SharedOut::new(&mut out);
    // SAFETY: rows are contiguous and do not overlap.
    unsafe { product(&packed, m, Epilogue::None, shared, copy, |row| row * n) };
    out
}

/// Gradient with respect to the bias, `[out]`: sums of the output's gradient over the pixels, in f64.
pub fn bias_gradient(upstream: &[f32], channels: usize) -> Vec<f32> {
    let parts: Vec<Vec<f64>> = upstream
        .par_chunks(PIXELS_PER_TASK * channels)
        .map(|part| {
            let mut sums = vec![0.0; channels];
            for pixel in part.chunks_exact(channels) {
                for (sum, v) in sums.iter_mut().zip(pixel) {
                    *sum += f64::from(*v);
                }
            }
            sums
        })
        .collect();
    let of = |c: usize| parts.iter().map(|part| part[c]).sum::<f64>() as f32;
    (0..channels).map(of).collect()
}

/// Gradient of a convolution with respect to its input, with packed weights. This gradient is
/// itself a convolution, with input and output channels swapped and the kernel's taps reversed. If
/// the forward stride exceeds 1, zeros are inserted between the pixels of the upstream gradient.
#[derive(Debug, Clone)]
pub struct InputGradient {
    conv: Conv2d,
    stride: usize,
}

impl InputGradient {
    /// Prepares the input gradient of the convolution `spec` with weights `weight`. The gradient is
    /// computed by a convolution with `algorithm`.
    ///
    /// # Panics
    /// If the length is wrong, or the convolution changes an image's size other than by its stride.
    pub fn new(simd: Simd, spec: ConvSpec, weight: &[f32], algorithm: Algorithm) -> Self {
        assert!(spec.kernel == 2 * spec.padding + 1, "{spec:?}");
        assert_eq!(weight.len(), spec.weight_len(), "weights of {spec:?}");
        let area = spec.kernel * spec.kernel;
        let mut turned = Vec::with_capacity(weight.len());
        for i in 0..spec.in_channels {
            for o in 0..spec.out_channels {
                let taps = &weight[(o * spec.in_channels + i) * area..][..area];
                turned.extend(taps.iter().rev());
            }
        }
        let back = ConvSpec {
            in_channels: spec.out_channels,
            out_channels: spec.in_channels,
            stride: 1,
            ..spec
        };
        Self {
            conv: Conv2d::new(simd, back, &turned, None, false, algorithm),
            stride: spec.stride,
        }
    }

    /// Maps the output's gradient to the gradient of an input of `height` × `width`, in the input's layout.
    ///
    /// # Panics
    /// If the gradient's length is wrong.
    pub fn run(&self, upstream: &[f32], height: usize, width: usize) -> Vec<f32> {
        let ConvSpec {
            in_channels: channels,
            out_channels,
            ..
        } = self.conv.spec();
        let mut spread = Cow::Borrowed(upstream);
        if self.stride > 1 {
            let columns = width.div_ceil(self.stride);
            let places = height.div_ceil(self.stride) * columns;
            assert_eq!(upstream.len(), places * channels, "upstream");
            let mut zeros = vec![0.0; height * width * channels];
            for (at, pixel) in upstream.chunks_exact(channels).enumerate() {
                let [y, x] = [at / columns, at % columns].map(|at| at * self.stride);
                zeros[(y * width + x) * channels..][..channels].copy_from_slice(pixel);
            }
            spread = Cow::Owned(zeros);
        }
        let window = RowWindow::whole(&spread, height, width, channels);
        let mut out = vec![0.0; height * width * out_channels];
        self.conv.run_rows(&window, 0..height, &mut out);
        out
    }
}

fn keeps_size(spec: &ConvSpec) -> bool {
    spec.stride == 1 && spec.kernel == 2 * spec.padding + 1
}

/// Backward pass of a ReLU: zeroes `gradient` wherever `value`, the ReLU's output, is not positive.
///
/// # Panics
/// If the lengths differ.
pub fn keep_where_positive(gradient: &mut [f32], value: &[f32]) {
    const CHUNK: usize = 1 << 16;
    assert_eq!(gradient.len(), value.len(), "value");
    let values = value.par_chunks(CHUNK);
    let both = gradient.par_chunks_mut(CHUNK).zip(values);
    both.for_each(|(gradient, value)| {
        for (g, v) in gradient.iter_mut().zip(value) {
            *g = if *v > 0.0 { *g } else { 0.0 };
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{noise, relative_error, with_threads};

    /// Input and output channels, kernel, height, width.
    const SIZES: [[usize; 5]; 4] = [
        [3, 5, 3, 7, 6],
        [16, 32, 3, 70, 64],
        [8, 6, 1, 9, 4],
        [3, 2, 5, 6, 9],
    ];

    fn spec([in_channels, out_channels, kernel, ..]: [usize; 5]) -> ConvSpec {
        ConvSpec {
            in_channels,
            out_channels,
            kernel,
            stride: 1,
            padding: kernel / 2,
        }
    }

    /// Calls `term(weight, input, output)` with the indices of every product of the convolution.
    fn products(spec: ConvSpec, (h, w): (usize, usize), mut term: impl FnMut(usize, usize, usize)) {
        for y in 0..h {
            for x in 0..w {
                for o in 0..spec.out_channels {
                    for c in 0..spec.in_channels {
                        for ky in 0..spec.kernel {
                            for kx in 0..spec.kernel {
                                let iy = (y + ky).checked_sub(spec.padding);
                                let ix = (x + kx).checked_sub(spec.padding);
                                let (Some(iy), Some(ix)) = (iy, ix) else {
                                    continue;
                                };
                                if iy < h && ix < w {
                                    let weight = ((o * spec.in_channels + c) * spec.kernel + ky)
                                        * spec.kernel
                                        + kx;
                                    term(
                                        weight,
                                        (iy * w + ix) * spec.in_channels + c,
                                        (y * w + x) * spec.out_channels + o,
                                    );
                                }
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn gradients_are_the_sums_of_their_products() {
        for sizes in SIZES {
            let spec = spec(sizes);
            let [.., h, w] = sizes;
            let x = noise(1, h * w * spec.in_channels);
            let weight = noise(2, spec.weight_len());
            let upstream = noise(3, h * w * spec.out_channels);
            for relu_input in [false, true] {
                let (mut dw, mut dx) = (vec![0.0; weight.len()], vec![0.0; x.len()]);
                products(spec, (h, w), |k, i, o| {
                    let passes = !relu_input || x[i] > 0.0;
                    if passes {
                        dw[k] += f64::from(x[i]) * f64::from(upstream[o]);
                        dx[i] += f64::from(weight[k]) * f64::from(upstream[o]);
                    }
                });
                for simd in Simd::available() {
                    let input = ConvInput {
                        data: &x,
                        height: h,
                        width: w,
                        relu: relu_input,
                    };
                    let found = weight_gradient(simd, spec, input, &upstream);
                    assert!(relative_error(&found, &dw) < 2e-6, "{simd:?} {spec:?}");
                    for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
                        let back = InputGradient::new(simd, spec, &weight, algorithm);
                        let mut found = back.run(&upstream, h, w);
                        if relu_input {
                            keep_where_positive(&mut found, &x);
                        }
                        assert!(relative_error(&found, &dx) < 5e-6, "{simd:?} {spec:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn threads_change_nothing() {
        let spec = spec(SIZES[1]);
        let (h, w) = (200, 100);
        let x = noise(1, h * w * spec.in_channels);
        let upstream = noise(3, h * w * spec.out_channels);
        let run = |threads| {
            with_threads(threads, || {
                let input = ConvInput {
                    data: &x,
                    height: h,
                    width: w,
                    relu: true,
                };
                let weights = weight_gradient(Simd::detect(), spec, input, &upstream);
                (weights, bias_gradient(&upstream, spec.out_channels))
            })
        };
        assert_eq!(run(1), run(3));
    }
}
