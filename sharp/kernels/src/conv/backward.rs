//! Gradients of convolutions: with respect to their weights, and to their input.
//!
//! Two shapes have them: stride 1 with as much padding as keeps the image's size, and blocks that do
//! not overlap (kernel = stride, no padding). Blocks become pixels of more channels first, so that
//! only the first shape is computed. The transposed convolution's gradients are those of the
//! convolution of blocks that it transposes.

use std::ops::Range;

use rayon::prelude::*;

use crate::conv::{Algorithm, Conv2d, ConvOptions, ConvSpec};
use crate::gemm::block::{ProductBlock, scratch_len};
use crate::gemm::micro::MicroTile;
use crate::gemm::{Epilogue, PackedMatrix, Tasks};
use crate::math::relu;
use crate::rows::RowWindow;
use crate::simd::Simd;
use crate::workspace::{SharedOut, Workspace};

/// Pixels whose products are summed by one task: a constant, so that sums do not depend on threads.
const PIXELS_PER_TASK: usize = 4096;

/// An image as it went into a convolution.
#[derive(Debug, Clone, Copy)]
pub struct ConvInput<'a> {
    /// `[height][width][channels]`.
    pub data: &'a [f32],
    pub height: usize,
    pub width: usize,
    /// Whether the convolution rectified it.
    pub relu: bool,
}

impl ConvSpec {
    /// Whether this convolution has gradients here.
    pub fn has_gradients(&self) -> bool {
        self.is_blocks() || (self.stride == 1 && self.kernel == 2 * self.padding + 1)
    }

    fn is_blocks(&self) -> bool {
        self.kernel == self.stride && self.padding == 0 && self.kernel > 1
    }

    /// The 1×1 convolution of whole blocks, whose weights are the same numbers in the same order.
    fn of_blocks(&self) -> Self {
        Self {
            in_channels: self.in_channels * self.kernel * self.kernel,
            kernel: 1,
            stride: 1,
            ..*self
        }
    }
}

/// Blocks of `size × size` pixels as pixels: `[height][width][channels]` to
/// `[height / size][width / size][channels · size · size]`, a block's row and column fastest.
fn blocks_as_pixels(
    data: &[f32],
    (height, width, channels): (usize, usize, usize),
    size: usize,
) -> Vec<f32> {
    let mut out = vec![0.0; data.len()];
    each_of_blocks((height, width, channels), size, |block, image| {
        out[block] = data[image];
    });
    out
}

/// The inverse of [`blocks_as_pixels`]; the shape is the image's.
fn pixels_as_blocks(
    data: &[f32],
    (height, width, channels): (usize, usize, usize),
    size: usize,
) -> Vec<f32> {
    let mut out = vec![0.0; data.len()];
    each_of_blocks((height, width, channels), size, |block, image| {
        out[image] = data[block];
    });
    out
}

/// Tells where each element lies among the blocks and in the image.
fn each_of_blocks(
    (height, width, channels): (usize, usize, usize),
    size: usize,
    mut pair: impl FnMut(usize, usize),
) {
    assert!(height.is_multiple_of(size) && width.is_multiple_of(size));
    let area = size * size;
    for y in 0..height {
        for x in 0..width {
            let block = (y / size * (width / size) + x / size) * channels * area;
            let block = block + y % size * size + x % size;
            let image = (y * width + x) * channels;
            for c in 0..channels {
                pair(block + c * area, image + c);
            }
        }
    }
}

/// Gradient of the weights, in their layout `[out][in][kernel][kernel]`, from that of the output
/// (`[rows][columns][out]`, before any rectification). Sums over 4096 pixels are made in f32, sums of those in f64.
///
/// # Panics
/// When a length is wrong, or the convolution does not [have gradients](ConvSpec::has_gradients).
pub fn weight_gradient(
    simd: Simd,
    spec: ConvSpec,
    input: ConvInput<'_>,
    upstream: &[f32],
) -> Vec<f32> {
    assert!(spec.has_gradients(), "{spec:?}");
    let shape = (input.height, input.width, spec.in_channels);
    assert_eq!(input.data.len(), shape.0 * shape.1 * shape.2, "input");
    if spec.is_blocks() {
        let data = blocks_as_pixels(input.data, shape, spec.kernel);
        let blocks = ConvInput {
            data: &data,
            height: input.height / spec.kernel,
            width: input.width / spec.kernel,
            ..input
        };
        return weight_gradient(simd, spec.of_blocks(), blocks, upstream);
    }
    let pixels = input.height * input.width;
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

/// The contribution of some output rows to the weights' gradient, `[tap][in][out]`.
///
/// A product over pixels: with zeros around the image, the input under a tap is the input shifted by
/// a constant, so channels lie as rows in memory and each tap reads them from another place.
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
    // The last tap reads this far beyond the last row.
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
        // A row stays in the first cache while its channels are picked out.
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
    let shared = SharedOut::new(&mut out);
    let tile = MicroTile::of(simd);
    let tasks = Tasks::new(&tile, m, n);
    let mut scratch = vec![0.0; scratch_len(&tile, tasks.rows_per_task(), k) + 16];
    let aligned = scratch.as_ptr().align_offset(64);
    let scratch = &mut scratch[aligned.min(16)..];
    for (rows, panels) in (0..tasks.count()).map(|task| tasks.get(task)) {
        let block = ProductBlock {
            b: packed.view(),
            rows,
            panels,
            epilogue: Epilogue::None,
            out: shared,
            out_stride: n,
        };
        let copy = |row: usize, ks: Range<usize>, dst: &mut [f32]| {
            let (tap, channel) = (row / c, row % c);
            let shift = tap / spec.kernel * width + tap % spec.kernel;
            dst.copy_from_slice(&planes[channel * plane + shift..][ks]);
        };
        // SAFETY: blocks run one after the other, and nobody else has `out`.
        unsafe { block.run(scratch, copy, |row| row * n) };
    }
    out
}

/// Gradient of the bias `[out]`: sums over the pixels of the output's, in f64.
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

/// Weights of the convolution of stride 1 that is the gradient with respect to the input of one of
/// stride 1 and shape `spec`: input and output channels exchanged, the kernel's taps in reverse.
///
/// # Panics
/// When the length is wrong.
pub fn turned_weights(spec: &ConvSpec, weight: &[f32]) -> Vec<f32> {
    assert_eq!(weight.len(), spec.weight_len(), "weights of {spec:?}");
    let area = spec.kernel * spec.kernel;
    let mut turned = Vec::with_capacity(weight.len());
    for i in 0..spec.in_channels {
        for o in 0..spec.out_channels {
            let taps = &weight[(o * spec.in_channels + i) * area..][..area];
            turned.extend(taps.iter().rev());
        }
    }
    turned
}

/// The map from the output's gradient to the input's, with packed weights.
#[derive(Debug, Clone)]
pub struct InputGradient {
    spec: ConvSpec,
    conv: Conv2d,
}

impl InputGradient {
    /// `weight` is the convolution's, `[out][in][kernel][kernel]`.
    ///
    /// # Panics
    /// When a length is wrong, or the convolution does not [have gradients](ConvSpec::has_gradients).
    pub fn new(simd: Simd, spec: ConvSpec, weight: &[f32], algorithm: Algorithm) -> Self {
        assert!(spec.has_gradients(), "{spec:?}");
        assert_eq!(weight.len(), spec.weight_len(), "weights of {spec:?}");
        let same = if spec.is_blocks() {
            spec.of_blocks()
        } else {
            spec
        };
        let back = ConvSpec {
            in_channels: same.out_channels,
            out_channels: same.in_channels,
            ..same
        };
        let turned = turned_weights(&same, weight);
        let conv = Conv2d::new(simd, back, &turned, None, false, algorithm);
        Self { spec, conv }
    }

    /// `[height][width][in]` of the input's size from `[rows][columns][out]`. Where the convolution
    /// rectified its `input`, nothing passes through what was not positive.
    ///
    /// # Panics
    /// When a length is wrong.
    pub fn run(
        &self,
        input: ConvInput<'_>,
        upstream: &[f32],
        workspace: &mut Workspace,
    ) -> Vec<f32> {
        let size = if self.spec.is_blocks() {
            self.spec.kernel
        } else {
            1
        };
        let (rows, columns) = (input.height / size, input.width / size);
        let window = RowWindow::whole(upstream, rows, columns, self.spec.out_channels);
        let mut out = vec![0.0; input.height * input.width * self.spec.in_channels];
        let options = ConvOptions::default();
        self.conv
            .run_rows_with(&window, 0..rows, &mut out, options, workspace);
        if size > 1 {
            let shape = (input.height, input.width, self.spec.in_channels);
            out = pixels_as_blocks(&out, shape, size);
        }
        if input.relu {
            keep_where_positive(&mut out, input.data);
        }
        out
    }
}

/// Zeroes a gradient where a rectified value was not positive.
///
/// # Panics
/// When lengths differ.
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
    use crate::rows::RowOp;
    use crate::testing::{noise, relative_error, with_threads};

    const SPECS: [(usize, usize, usize, usize, usize, usize, usize); 6] = [
        // in, out, kernel, stride, padding, height, width
        (3, 5, 3, 1, 1, 7, 6),
        (16, 32, 3, 1, 1, 70, 64),
        (8, 6, 1, 1, 0, 9, 4),
        (4, 7, 2, 2, 0, 6, 8),
        (5, 16, 4, 4, 0, 8, 8),
        (3, 2, 5, 1, 2, 6, 9),
    ];

    fn spec(
        (in_channels, out_channels, kernel, stride, padding, ..): (
            usize,
            usize,
            usize,
            usize,
            usize,
            usize,
            usize,
        ),
    ) -> ConvSpec {
        ConvSpec {
            in_channels,
            out_channels,
            kernel,
            stride,
            padding,
        }
    }

    /// Calls `term(weight, input, output)` with the indices of every product of the convolution.
    fn products(spec: ConvSpec, (h, w): (usize, usize), mut term: impl FnMut(usize, usize, usize)) {
        let (rows, columns) = (h / spec.stride, w / spec.stride);
        for y in 0..rows {
            for x in 0..columns {
                for o in 0..spec.out_channels {
                    for c in 0..spec.in_channels {
                        for ky in 0..spec.kernel {
                            for kx in 0..spec.kernel {
                                let iy = (y * spec.stride + ky).checked_sub(spec.padding);
                                let ix = (x * spec.stride + kx).checked_sub(spec.padding);
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
                                        (y * columns + x) * spec.out_channels + o,
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
        for sizes in SPECS {
            let spec = spec(sizes);
            let (h, w) = (sizes.5, sizes.6);
            let x = noise(1, h * w * spec.in_channels);
            let weight = noise(2, spec.weight_len());
            let out = (h / spec.stride) * (w / spec.stride);
            let upstream = noise(3, out * spec.out_channels);
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
                        let found = back.run(input, &upstream, &mut Workspace::new());
                        assert!(relative_error(&found, &dx) < 5e-6, "{simd:?} {spec:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn threads_change_nothing() {
        let spec = spec(SPECS[1]);
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

    #[test]
    fn blocks_lie_as_the_convolution_reads_them() {
        let (shape, size) = ((4, 6, 3), 2);
        let x = noise(4, 4 * 6 * 3);
        let blocks = blocks_as_pixels(&x, shape, size);
        assert_eq!(pixels_as_blocks(&blocks, shape, size), x);
        // Row 1, column 2 of blocks, channel 1, its second row and first column.
        assert_eq!(blocks[(3 + 2) * 12 + 4 + 2], x[((2 + 1) * 6 + 4) * 3 + 1]);
    }

    #[test]
    fn the_transposed_convolution_has_the_gradients_of_its_transpose() {
        let (inputs, outputs, h, w) = (6, 5, 3, 4);
        let weight = noise(1, inputs * outputs * 4);
        let x = noise(2, h * w * inputs);
        let upstream = noise(3, 4 * h * w * outputs);
        let deconv = crate::TransposedConv2x2::new(Simd::detect(), inputs, outputs, &weight, None);
        let mut y = vec![0.0; upstream.len()];
        let window = RowWindow::whole(&x, h, w, inputs);
        deconv.run_rows(&window, 0..2 * h, &mut y, &mut Workspace::new());
        // ⟨Wx, u⟩ = ⟨x, Wᵀu⟩, and the convolution of blocks with the same numbers is Wᵀ.
        let transpose = ConvSpec {
            in_channels: outputs,
            out_channels: inputs,
            kernel: 2,
            stride: 2,
            padding: 0,
        };
        let conv = Conv2d::new(
            Simd::detect(),
            transpose,
            &weight,
            None,
            false,
            Algorithm::Direct,
        );
        let mut dx = vec![0.0; x.len()];
        let window = RowWindow::whole(&upstream, 2 * h, 2 * w, outputs);
        conv.run_rows(&window, 0..h, &mut dx, &mut Workspace::new());
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            let both = a.iter().zip(b);
            both.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        assert!((dot(&y, &upstream) - dot(&x, &dx)).abs() < 1e-3 * dot(&y, &y).sqrt());
    }
}
