//! Matrices packed for the microkernels.

use crate::gemm::micro::{KC, MicroTile};
use crate::simd::Simd;
use crate::workspace::Aligned;

/// A `k` × `n` matrix (the weights), packed for one instruction set, with a bias per column.
///
/// The matrix is split into runs of at most `KC` rows, and each run into panels of `nr` columns. A panel is stored row
/// by row. Columns are zero-padded to whole panels.
#[derive(Debug, Clone)]
pub struct PackedMatrix {
    simd: Simd,
    k: usize,
    n: usize,
    data: Aligned,
    bias: Aligned,
}

impl PackedMatrix {
    /// Packs the weights of a linear layer, `[n][k]` (outputs × inputs, as PyTorch stores
    /// them), and its bias `[n]`.
    ///
    /// # Panics
    /// If a length is wrong or a dimension is zero.
    pub fn from_out_in(
        simd: Simd,
        weight: &[f32],
        bias: Option<&[f32]>,
        n: usize,
        k: usize,
    ) -> Self {
        assert_eq!(weight.len(), n * k, "weights of {n} outputs x {k} inputs");
        Self::with(simd, k, n, bias, |data, nr| {
            pack_transposed(data, nr, n, |col| &weight[col * k..][..k]);
        })
    }

    /// Packs the matrix whose element in row `row` and column `col` is `value(row, col)`.
    pub(crate) fn pack(
        simd: Simd,
        k: usize,
        n: usize,
        bias: Option<&[f32]>,
        value: impl Fn(usize, usize) -> f32,
    ) -> Self {
        Self::with(simd, k, n, bias, |data, nr| {
            pack_into(data, nr, k, n, value)
        })
    }

    /// Allocates the matrix; `fill(data, nr)` packs the elements.
    fn with(
        simd: Simd,
        k: usize,
        n: usize,
        bias: Option<&[f32]>,
        fill: impl FnOnce(&mut [f32], usize),
    ) -> Self {
        assert!(k > 0 && n > 0, "a matrix of {k} x {n}");
        let nr = MicroTile::of(simd).nr;
        let n_padded = n.next_multiple_of(nr);
        let mut data = Aligned::zeros(k * n_padded);
        fill(&mut data, nr);
        let mut padded_bias = Aligned::zeros(n_padded);
        if let Some(bias) = bias {
            assert_eq!(bias.len(), n, "one bias per output");
            padded_bias[..n].copy_from_slice(bias);
        }
        Self {
            simd,
            k,
            n,
            data,
            bias: padded_bias,
        }
    }

    /// Number of rows, which are the layer's inputs.
    pub fn k(&self) -> usize {
        self.k
    }

    /// Number of columns, which are the layer's outputs.
    pub fn n(&self) -> usize {
        self.n
    }

    pub fn simd(&self) -> Simd {
        self.simd
    }

    pub(crate) fn view(&self) -> PackedView<'_> {
        PackedView {
            simd: self.simd,
            k: self.k,
            n: self.n,
            data: &self.data,
            bias: &self.bias,
        }
    }
}

/// A packed matrix in a borrowed buffer.
#[derive(Clone, Copy)]
pub(crate) struct PackedView<'a> {
    pub(crate) simd: Simd,
    pub(crate) k: usize,
    pub(crate) n: usize,
    pub(crate) data: &'a [f32],
    /// Biases, padded like the columns.
    pub(crate) bias: &'a [f32],
}

impl PackedView<'_> {
    /// Panel `panel` of the run that starts at row `k0`: `min(KC, k - k0)` rows of `nr` columns.
    #[inline(always)]
    pub(crate) fn panel(&self, nr: usize, k0: usize, panel: usize) -> &[f32] {
        let kc = KC.min(self.k - k0);
        let n_padded = self.n.next_multiple_of(nr);
        &self.data[k0 * n_padded + panel * kc * nr..][..kc * nr]
    }
}

/// Packs a matrix into `data`. Padding columns are not written: they must already be zero, or the caller must ignore
/// them.
#[inline(always)]
pub(crate) fn pack_into(
    data: &mut [f32],
    nr: usize,
    k: usize,
    n: usize,
    value: impl Fn(usize, usize) -> f32,
) {
    let n_padded = n.next_multiple_of(nr);
    for k0 in (0..k).step_by(KC) {
        let kc = KC.min(k - k0);
        let run = &mut data[k0 * n_padded..][..kc * n_padded];
        for (panel, out) in run.chunks_exact_mut(kc * nr).enumerate() {
            let cols = nr.min(n - panel * nr);
            for (row, out) in out.chunks_exact_mut(nr).enumerate() {
                for (col, out) in out[..cols].iter_mut().enumerate() {
                    *out = value(k0 + row, panel * nr + col);
                }
            }
        }
    }
}

/// Like [`pack_into`], for a matrix given by columns of equal length.
pub(crate) fn pack_transposed<'a>(
    data: &mut [f32],
    nr: usize,
    n: usize,
    column: impl Fn(usize) -> &'a [f32],
) {
    let n_padded = n.next_multiple_of(nr);
    for col in 0..n {
        let (panel, lane) = (col / nr, col % nr);
        for (run, part) in column(col).chunks(KC).enumerate() {
            let start = run * KC * n_padded + panel * part.len() * nr;
            for (out, v) in data[start..].chunks_exact_mut(nr).zip(part) {
                out[lane] = *v;
            }
        }
    }
}

/// Like [`pack_into`], for a matrix given by rows: `row(k)` has `n` elements.
pub(crate) fn pack_rows<'a>(
    data: &mut [f32],
    nr: usize,
    k: usize,
    n: usize,
    row: impl Fn(usize) -> &'a [f32],
) {
    let n_padded = n.next_multiple_of(nr);
    for k0 in (0..k).step_by(KC) {
        let kc = KC.min(k - k0);
        for i in 0..kc {
            for (panel, part) in row(k0 + i).chunks(nr).enumerate() {
                let start = k0 * n_padded + (panel * kc + i) * nr;
                data[start..][..part.len()].copy_from_slice(part);
            }
        }
    }
}
