//! Transposed 2×2 convolution of stride 2: every input pixel becomes a 2×2 block.

use std::ops::Range;

use crate::gemm::{Epilogue, PackedMatrix, product};
use crate::rows::{RowOp, RowWindow, expect};
use crate::simd::Simd;
use crate::workspace::SharedOut;

/// `out[2y + i][2x + j][o] = bias[o] + Σ_c in[y][x][c] · w[c][o][i][j]`.
///
/// Kernel size and stride are equal, so blocks do not overlap. Computed as two matrix products, one for the even and
/// one for the odd output rows; each row of a product is a pair of neighbouring output pixels.
#[derive(Debug, Clone)]
pub struct TransposedConv2x2 {
    in_channels: usize,
    out_channels: usize,
    /// Weights for the even and the odd output rows: `[in][2 columns][out]`.
    weights: [PackedMatrix; 2],
}

impl TransposedConv2x2 {
    /// Packs weights `[in][out][2][2]` (PyTorch's layout) and a bias `[out]`.
    ///
    /// # Panics
    /// If a length is wrong.
    pub fn new(
        simd: Simd,
        in_channels: usize,
        out_channels: usize,
        weight: &[f32],
        bias: Option<&[f32]>,
    ) -> Self {
        assert_eq!(weight.len(), in_channels * out_channels * 4, "weights");
        let bias = bias.map(|bias| {
            assert_eq!(bias.len(), out_channels, "one bias per output channel");
            [bias, bias].concat()
        });
        let half = |i: usize| {
            PackedMatrix::pack(
                simd,
                in_channels,
                2 * out_channels,
                bias.as_deref(),
                |c, col| {
                    let (j, o) = (col / out_channels, col % out_channels);
                    weight[((c * out_channels + o) * 2 + i) * 2 + j]
                },
            )
        };
        Self {
            in_channels,
            out_channels,
            weights: [half(0), half(1)],
        }
    }
}

impl RowOp for TransposedConv2x2 {
    fn out_size(&self, height: usize, width: usize) -> (usize, usize) {
        (2 * height, 2 * width)
    }

    fn out_channels(&self, _in_channels: usize) -> usize {
        self.out_channels
    }

    fn in_rows(&self, out: Range<usize>, in_height: usize) -> Range<usize> {
        let start = (out.start / 2).min(in_height);
        start..out.end.div_ceil(2).clamp(start, in_height)
    }

    fn run_rows(&self, input: &RowWindow<'_>, out: Range<usize>, output: &mut [f32]) {
        assert_eq!(input.channels(), self.in_channels, "input channels");
        expect(self, input, &out, output);
        let (width, c) = (input.width(), self.in_channels);
        let n = 2 * self.out_channels;
        let shared = SharedOut::new(output);
        for (i, weight) in self.weights.iter().enumerate() {
            // Input rows that contribute to the output rows of this parity.
            let first = (out.start + 1 - i) / 2;
            let rows = (out.end + 1 - i) / 2 - first;
            let copy = |pixel: usize, ks: Range<usize>, dst: &mut [f32]| {
                let row = input.row(first + pixel / width);
                dst.copy_from_slice(&row[pixel % width * c..][ks]);
            };
            let offset = |pixel: usize| {
                let y = 2 * (first + pixel / width) + i - out.start;
                (y * width + pixel % width) * n
            };
            // SAFETY: each product row is one pair of output pixels, and the two products write to different output
            // rows.
            unsafe { product(weight, rows * width, Epilogue::None, shared, copy, offset) };
        }
    }
}
