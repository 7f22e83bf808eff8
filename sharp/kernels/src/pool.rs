//! Pooling of NHWC images.

use std::ops::Range;

use rayon::prelude::*;

use crate::rows::{RowOp, RowWindow, expect, window_rows};
use crate::simd::{Simd, per_instruction_set};

/// Max pooling without padding.
#[derive(Debug, Clone, Copy)]
pub struct MaxPool {
    simd: Simd,
    size: usize,
    stride: usize,
    ceil: bool,
}

impl MaxPool {
    /// Creates a pooling over windows of `size` × `size`, one every `stride` pixels.
    ///
    /// `ceil`: if true, a last window that extends beyond the image is kept and pools only the
    /// pixels it covers (PyTorch's `ceil_mode`). Such a window must still start inside the image.
    ///
    /// # Panics
    /// If `size` or `stride` is zero.
    pub fn new(simd: Simd, size: usize, stride: usize, ceil: bool) -> Self {
        assert!(size > 0 && stride > 0, "windows of {size}, every {stride}");
        Self {
            simd,
            size,
            stride,
            ceil,
        }
    }

    fn out_side(&self, side: usize) -> usize {
        let beyond = if self.ceil { self.stride - 1 } else { 0 };
        let Some(room) = (side + beyond).checked_sub(self.size) else {
            return 0;
        };
        // Windows that start beyond the image are dropped.
        (room / self.stride + 1).min(side.div_ceil(self.stride))
    }
}

impl RowOp for MaxPool {
    fn out_size(&self, height: usize, width: usize) -> (usize, usize) {
        (self.out_side(height), self.out_side(width))
    }

    fn out_channels(&self, in_channels: usize) -> usize {
        in_channels
    }

    fn in_rows(&self, out: Range<usize>, in_height: usize) -> Range<usize> {
        window_rows(out, in_height, self.size, self.stride, 0)
    }

    fn run_rows(&self, input: &RowWindow<'_>, out: Range<usize>, output: &mut [f32]) {
        let width = expect(self, input, &out, output);
        if output.is_empty() {
            return;
        }
        let c = input.channels();
        output
            .par_chunks_mut(width * c)
            .enumerate()
            .for_each(|(i, output)| {
                let y = (out.start + i) * self.stride;
                for y in y..(y + self.size).min(input.height()) {
                    let first = y == (out.start + i) * self.stride;
                    max_row(
                        self.simd,
                        input.row(y),
                        output,
                        c,
                        self.size,
                        self.stride,
                        first,
                    );
                }
            });
    }
}

per_instruction_set! {
    /// Adds one input row to the maxima in `output`: each maximum is updated with the row's part of
    /// its window. For the `first` row, previous values are ignored.
    fn max_row(
        input: &[f32],
        output: &mut [f32],
        channels: usize,
        size: usize,
        stride: usize,
        first: bool,
    ) = max_row_body
}

#[inline(always)]
fn max_row_body<const FMA: bool>(
    input: &[f32],
    output: &mut [f32],
    channels: usize,
    size: usize,
    stride: usize,
    first: bool,
) {
    let width = input.len() / channels;
    for (x, output) in output.chunks_exact_mut(channels).enumerate() {
        for place in x * stride..(x * stride + size).min(width) {
            let pixel = &input[place * channels..][..channels];
            if first && place == x * stride {
                output.copy_from_slice(pixel);
            } else {
                for (max, v) in output.iter_mut().zip(pixel) {
                    // Propagates NaN, which must not disappear before it reaches a score.
                    *max = if *max >= *v || max.is_nan() { *max } else { *v };
                }
            }
        }
    }
}

/// L2 pooling of DISTS: the root of the local mean of squares under a 3×3 Hann window (`[1 2 1]ᵀ [1 2 1] / 16`), with
/// stride 2 and zero padding.
///
/// `sqrt(Σ w x² + 1e-12)`. Each side of the output is half the input's, rounded up.
#[derive(Debug, Clone, Copy)]
pub struct L2Pool {
    simd: Simd,
}

impl L2Pool {
    /// Creates the pooling for an instruction set.
    pub fn new(simd: Simd) -> Self {
        Self { simd }
    }
}

impl RowOp for L2Pool {
    fn out_size(&self, height: usize, width: usize) -> (usize, usize) {
        (height.div_ceil(2), width.div_ceil(2))
    }

    fn out_channels(&self, in_channels: usize) -> usize {
        in_channels
    }

    fn in_rows(&self, out: Range<usize>, in_height: usize) -> Range<usize> {
        window_rows(out, in_height, 3, 2, 1)
    }

    fn run_rows(&self, input: &RowWindow<'_>, out: Range<usize>, output: &mut [f32]) {
        let width = expect(self, input, &out, output);
        if output.is_empty() {
            return;
        }
        let c = input.channels();
        output
            .par_chunks_mut(width * c)
            .enumerate()
            .for_each(|(i, output)| {
                let y = 2 * (out.start + i);
                let row = |y: usize| (y < input.height()).then(|| input.row(y));
                let rows = [y.checked_sub(1).and_then(row), row(y), row(y + 1)];
                l2_row(self.simd, rows, output, c);
            });
    }
}

per_instruction_set! {
    /// Computes one output row from three input rows; rows beyond the image are `None`.
    fn l2_row(rows: [Option<&[f32]>; 3], output: &mut [f32], channels: usize) = l2_row_body
}

#[inline(always)]
fn l2_row_body<const FMA: bool>(rows: [Option<&[f32]>; 3], output: &mut [f32], channels: usize) {
    const HANN: [f32; 3] = [1.0, 2.0, 1.0];
    for (x, output) in output.chunks_exact_mut(channels).enumerate() {
        output.fill(0.0);
        for (row, wy) in rows.iter().zip(HANN) {
            let Some(row) = row else {
                continue;
            };
            for (dx, wx) in HANN.into_iter().enumerate() {
                let pixel = (2 * x + dx)
                    .checked_sub(1)
                    .and_then(|x| row.get(x * channels..(x + 1) * channels));
                let Some(pixel) = pixel else {
                    continue;
                };
                let weight = wy * wx / 16.0;
                for (sum, v) in output.iter_mut().zip(pixel) {
                    *sum += weight * (v * v);
                }
            }
        }
        output.iter_mut().for_each(|v| *v = (*v + 1e-12).sqrt());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::noise;

    fn run(op: &impl RowOp, image: &[f32], shape: [usize; 3], strip: usize) -> Vec<f32> {
        let [height, width, channels] = shape;
        let (h, w) = op.out_size(height, width);
        let row = w * op.out_channels(channels);
        let mut out = vec![f32::NAN; h * row];
        for y in (0..h).step_by(strip) {
            let rows = y..h.min(y + strip);
            let needed = op.in_rows(rows.clone(), height);
            let data = &image[needed.start * width * channels..needed.end * width * channels];
            let window = RowWindow::new(data, needed, height, width, channels);
            let out = &mut out[rows.start * row..rows.end * row];
            op.run_rows(&window, rows, out);
        }
        out
    }

    #[test]
    fn sizes_of_floor_and_ceil() {
        let simd = Simd::detect();
        let side = |ceil, n| MaxPool::new(simd, 3, 2, ceil).out_size(n, n).0;
        assert_eq!([3, 4, 5, 6, 7].map(|n| side(false, n)), [1, 1, 2, 2, 3]);
        assert_eq!([3, 4, 5, 6, 7].map(|n| side(true, n)), [1, 2, 2, 3, 3]);
        // As in PyTorch, a single window may extend beyond the image by less than a stride.
        assert_eq!([1, 2].map(|n| side(true, n)), [0, 1]);
        let two = MaxPool::new(simd, 2, 2, false);
        assert_eq!(two.out_size(5, 4), (2, 2));
        // The last window of stride 3 would start beyond the image of 3, so it is dropped.
        assert_eq!(MaxPool::new(simd, 2, 3, true).out_size(3, 4), (1, 2));
    }

    #[test]
    fn max_pooling_in_any_strips_at_every_level() {
        let shape = [9, 8, 19];
        let image = noise(1, 9 * 8 * 19);
        for (size, stride, ceil) in [(2, 2, false), (3, 2, false), (3, 2, true)] {
            for simd in Simd::available() {
                let op = MaxPool::new(simd, size, stride, ceil);
                let (h, w) = op.out_size(9, 8);
                let found = run(&op, &image, shape, h);
                for (i, &found) in found.iter().enumerate() {
                    let (y, x, c) = (i / (w * 19), i / 19 % w, i % 19);
                    let mut max = f32::MIN;
                    for y in y * stride..(y * stride + size).min(9) {
                        for x in x * stride..(x * stride + size).min(8) {
                            max = max.max(image[(y * 8 + x) * 19 + c]);
                        }
                    }
                    assert_eq!(found, max);
                }
                assert_eq!(found, run(&op, &image, shape, 1));
            }
        }
    }

    #[test]
    fn nan_is_not_lost() {
        let image = [1.0, f32::NAN, 3.0, 2.0];
        let op = MaxPool::new(Simd::detect(), 2, 2, false);
        assert!(run(&op, &image, [2, 2, 1], 1)[0].is_nan());
    }

    #[test]
    fn l2_pooling_matches_its_definition_in_any_strips() {
        for shape in [[7, 6, 20], [1, 1, 3], [8, 5, 1]] {
            let [h, w, c] = shape;
            let image = noise(2, h * w * c);
            for simd in Simd::available() {
                let op = L2Pool::new(simd);
                let (oh, ow) = op.out_size(h, w);
                let found = run(&op, &image, shape, oh);
                for (i, &found) in found.iter().enumerate() {
                    let (y, x, ch) = (i / (ow * c), i / c % ow, i % c);
                    let mut sum = 0.0;
                    for (dy, dx) in (0..3).flat_map(|dy| (0..3).map(move |dx| (dy, dx))) {
                        let (iy, ix) = (2 * y + dy, 2 * x + dx);
                        if (1..=h).contains(&iy) && (1..=w).contains(&ix) {
                            let v = f64::from(image[((iy - 1) * w + ix - 1) * c + ch]);
                            sum += v * v * [1.0, 2.0, 1.0][dy] * [1.0, 2.0, 1.0][dx] / 16.0;
                        }
                    }
                    let exact = (sum + 1e-12).sqrt();
                    assert!((f64::from(found) - exact).abs() < 1e-6 * exact.max(1.0));
                }
                assert_eq!(found, run(&op, &image, shape, 1));
            }
        }
    }

    #[test]
    fn l2_pooling_of_zeros_is_the_root_of_the_epsilon() {
        let found = run(&L2Pool::new(Simd::detect()), &[0.0; 4], [2, 2, 1], 1);
        assert_eq!(found, [1e-6]);
    }
}
