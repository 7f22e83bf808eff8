//! Products of a block of rows with packed panels: the loop around the microkernels.

use std::ops::Range;

use crate::gemm::micro::{KC, MicroTile, stride_for};
use crate::gemm::packed::PackedView;
use crate::gemm::{Epilogue, MAX_TASK_ROWS};
use crate::math::{gelu, relu};
use crate::simd::per_instruction_set;
use crate::workspace::SharedOut;

/// Maximum number of rows of a tile, over all instruction sets.
const MAX_ROWS: usize = 16;
/// Maximum number of row tiles of a block, over all instruction sets.
const MAX_TILES: usize = MAX_TASK_ROWS / 4;

/// One task's share of a product `A B`: some rows of `A`, some panels of `B`.
pub(crate) struct ProductBlock<'a> {
    pub(crate) b: PackedView<'a>,
    /// Rows of the whole product that this block computes.
    pub(crate) rows: Range<usize>,
    pub(crate) panels: Range<usize>,
    pub(crate) epilogue: Epilogue<'a>,
    pub(crate) out: SharedOut<'a>,
    /// Distance between rows in `out`, in elements; used only if the rows are equally spaced.
    pub(crate) out_stride: usize,
}

/// Scratch size, in floats, that [`ProductBlock::run`] needs for `rows` rows and runs of `k`.
pub(crate) fn scratch_len(tile: &MicroTile, rows: usize, k: usize) -> usize {
    rows.next_multiple_of(tile.mr) * stride_for(k.min(KC))
}

impl ProductBlock<'_> {
    /// Computes the block. `copy(row, k, dst)` writes columns `k` of row `row` of `A` to `dst`; `offset(row)` returns
    /// where the row starts in the output (and in the residual).
    ///
    /// # Safety
    /// While this runs, no other thread may access the columns of `panels` in those output rows.
    pub(crate) unsafe fn run(
        &self,
        scratch: &mut [f32],
        copy: impl Fn(usize, Range<usize>, &mut [f32]),
        offset: impl Fn(usize) -> usize,
    ) {
        let k = self.b.k;
        let stride = stride_for(k.min(KC));
        for k0 in (0..k).step_by(KC) {
            let k1 = k.min(k0 + KC);
            for (i, row) in self.rows.clone().enumerate() {
                copy(row, k0..k1, &mut scratch[i * stride..][..k1 - k0]);
            }
            // SAFETY: the caller upholds this function's contract.
            unsafe { self.multiply(scratch, k0, &offset) };
        }
    }

    /// Multiplies the run of k that starts at `k0`. The run's part of `A` is in `a`, with rows
    /// [`stride_for`] apart.
    ///
    /// # Safety
    /// As for [`Self::run`].
    #[inline(always)]
    pub(crate) unsafe fn multiply(&self, a: &[f32], k0: usize, offset: &impl Fn(usize) -> usize) {
        let tile = MicroTile::of(self.b.simd);
        let (mr, nr, n) = (tile.mr, tile.nr, self.b.n);
        let kernel = tile.kernel(self.b.k.min(KC));
        let stride = stride_for(self.b.k.min(KC));
        let kc = KC.min(self.b.k - k0);
        let last = k0 + kc == self.b.k;
        // Later runs of k accumulate onto the output of the earlier ones.
        let load = k0 > 0 || matches!(self.epilogue, Epilogue::Add);
        assert!(a.len() >= self.rows.len().next_multiple_of(mr) * stride);
        // Offset of each tile's first row, if the tile's rows are equally spaced by `out_stride`.
        let mut starts = [None; MAX_TILES];
        let tiles = self.rows.len().div_ceil(mr);
        for (t, start) in starts[..tiles].iter_mut().enumerate() {
            let first = self.rows.start + t * mr;
            let at = offset(first);
            *start = (first + mr <= self.rows.end
                && (1..mr).all(|r| offset(first + r) == at + r * self.out_stride))
            .then_some(at);
        }
        let mut spare = [0.0_f32; MicroTile::MAX];
        for panel in self.panels.clone() {
            let b = self.b.panel(nr, k0, panel);
            let col = panel * nr;
            let cols = nr.min(n - col);
            let bias = &self.b.bias[col..][..nr];
            for (t, start) in starts[..tiles].iter().enumerate() {
                let a = a[t * mr * stride..].as_ptr();
                if let (Some(start), true) = (start, cols == nr) {
                    let span = (mr - 1) * self.out_stride + nr;
                    let c = self.out.pointer(start + col, span);
                    let (init, init_stride) = if load {
                        (c.cast_const(), self.out_stride)
                    } else {
                        (bias.as_ptr(), 0)
                    };
                    // SAFETY: `a` has `mr` rows of `kc` floats by the assertion above; `b` and `bias` are whole panels;
                    // the tile at `c` is in bounds, and exclusively ours by the caller's contract; a `Simd` proves that
                    // the machine supports the instruction set.
                    unsafe { kernel(kc, a, b.as_ptr(), c, self.out_stride, init, init_stride) };
                    if last {
                        let at: [usize; MAX_ROWS] =
                            std::array::from_fn(|r| start + col + r * self.out_stride);
                        let part = Part {
                            at: &at[..mr],
                            cols,
                        };
                        self.finish(c, self.out_stride, &part, bias);
                    }
                    continue;
                }
                let mut at = [0; MAX_ROWS];
                let rows = mr.min(self.rows.len() - t * mr);
                for (r, at) in at[..rows].iter_mut().enumerate() {
                    *at = offset(self.rows.start + t * mr + r) + col;
                }
                let part = Part {
                    at: &at[..rows],
                    cols,
                };
                if load {
                    // SAFETY: these elements are exclusively ours by the caller's contract.
                    unsafe { part.gather(&self.out, &mut spare, nr) };
                }
                let c = spare.as_mut_ptr();
                let (init, init_stride) = if load {
                    (c.cast_const(), nr)
                } else {
                    (bias.as_ptr(), 0)
                };
                // SAFETY: as for the direct call above, except that the output is a whole tile
                // owned by this function.
                unsafe { kernel(kc, a, b.as_ptr(), c, nr, init, init_stride) };
                if last {
                    self.finish(c, nr, &part, bias);
                }
                // SAFETY: these elements are exclusively ours by the caller's contract.
                unsafe { part.scatter(&spare, nr, &self.out) };
            }
        }
    }

    /// Applies the epilogue to the tile at `c`, which has just been written.
    fn finish(&self, c: *mut f32, c_stride: usize, part: &Part<'_>, bias: &[f32]) {
        if !matches!(self.epilogue, Epilogue::None) {
            finish(self.b.simd, c, c_stride, part, self.epilogue, bias);
        }
    }
}

/// The part of a tile that lies within the output.
struct Part<'a> {
    /// Offset in the output of each row's first column.
    at: &'a [usize],
    cols: usize,
}

impl Part<'_> {
    /// Copies the part from the output to `tile`, whose rows are `nr` apart.
    ///
    /// # Safety
    /// No other thread may access these elements of `out`.
    unsafe fn gather(&self, out: &SharedOut<'_>, tile: &mut [f32], nr: usize) {
        for (&at, tile) in self.at.iter().zip(tile.chunks_exact_mut(nr)) {
            // SAFETY: the caller upholds this function's contract.
            tile[..self.cols].copy_from_slice(unsafe { out.slice(at, self.cols) });
        }
    }

    /// Copies the part from `tile`, whose rows are `nr` apart, to the output.
    ///
    /// # Safety
    /// As for [`Self::gather`].
    unsafe fn scatter(&self, tile: &[f32], nr: usize, out: &SharedOut<'_>) {
        for (&at, tile) in self.at.iter().zip(tile.chunks_exact(nr)) {
            // SAFETY: the caller upholds this function's contract.
            unsafe { out.slice(at, self.cols) }.copy_from_slice(&tile[..self.cols]);
        }
    }
}

per_instruction_set! {
    /// Applies the epilogue to the tile at `c` while it is in cache.
    fn finish(
        c: *mut f32,
        c_stride: usize,
        part: &Part<'_>,
        epilogue: Epilogue<'_>,
        bias: &[f32],
    ) = finish_body
}

#[inline(always)]
fn finish_body<const FMA: bool>(
    c: *mut f32,
    c_stride: usize,
    part: &Part<'_>,
    epilogue: Epilogue<'_>,
    bias: &[f32],
) {
    for (r, &at) in part.at.iter().enumerate() {
        // SAFETY: the caller has just written the tile at `c`, which has these rows and columns.
        let row = unsafe { std::slice::from_raw_parts_mut(c.add(r * c_stride), part.cols) };
        match epilogue {
            Epilogue::None => {}
            Epilogue::Relu => {
                for v in row {
                    *v = relu(*v);
                }
            }
            Epilogue::Gelu => {
                for v in row {
                    *v = gelu::<FMA>(*v);
                }
            }
            Epilogue::Add => {
                for (v, b) in row.iter_mut().zip(bias) {
                    *v += b;
                }
            }
            Epilogue::Residual(residual) => {
                for (v, x) in row.iter_mut().zip(&residual[at..]) {
                    *v += x;
                }
            }
            Epilogue::ResidualRelu(residual) => {
                for (v, x) in row.iter_mut().zip(&residual[at..]) {
                    *v = relu(*v + x);
                }
            }
        }
    }
}
