//! Matrix products with packed weights and fused epilogues.
//!
//! * [`PackedMatrix`]: weights and bias, packed once.
//! * [`matmul`]: rows of activations times packed weights.
//!
//! Private: `micro` (one kernel per instruction set), `block` (the loop around it).

pub(crate) mod block;
pub(crate) mod micro;
pub(crate) mod packed;

pub use packed::PackedMatrix;

use std::ops::Range;

use block::{ProductBlock, scratch_len};
use micro::MicroTile;

use crate::workspace::{SharedOut, run_tasks};

/// Operation applied to a product `A B + bias` before it is stored.
#[derive(Debug, Clone, Copy)]
pub enum Epilogue<'a> {
    None,
    /// `max(·, 0)`.
    Relu,
    /// Exact GELU, `x Φ(x)`, with the error function (not the tanh approximation).
    Gelu,
    /// Adds the output's previous content: `C += A B + bias`.
    Add,
    /// Adds an array that has the output's layout.
    Residual(&'a [f32]),
    /// [`Self::Residual`], then `max(·, 0)`.
    ResidualRelu(&'a [f32]),
}

/// Maximum number of rows of a task. That many rows of inputs, at most `KC` values per row at a
/// time, fill a large part of a 1 MiB L2 cache. The weights are read once for all of these rows.
pub(crate) const MAX_TASK_ROWS: usize = 296;
/// Maximum number of columns of a task. Each task copies the rows it needs, so narrower tasks would repeat that copy
/// more often.
const MAX_COLUMNS: usize = 2048;
/// Minimum number of columns of a task. Tasks are not split further, even if some threads have no work.
const FEWEST_COLUMNS: usize = 128;

/// Partition of a product into equally sized tasks of whole tiles; affects only speed.
struct Tasks {
    rows: TaskCut,
    panels: TaskCut,
    mr: usize,
    m: usize,
}

/// Splits a number of row tiles or panels into equal shares, one per task. The last share may be smaller.
struct TaskCut {
    total: usize,
    share: usize,
}

impl TaskCut {
    fn new(total: usize, most: usize) -> Self {
        let shares = total.div_ceil(most.max(1)).max(1);
        let share = total.div_ceil(shares).max(1);
        Self { total, share }
    }

    fn count(&self) -> usize {
        self.total.div_ceil(self.share)
    }

    fn get(&self, index: usize) -> Range<usize> {
        let start = index * self.share;
        start..self.total.min(start + self.share)
    }
}

impl Tasks {
    pub(crate) fn new(tile: &MicroTile, m: usize, n: usize) -> Self {
        let rows = TaskCut::new(m.div_ceil(tile.mr), MAX_TASK_ROWS / tile.mr);
        let enough = 3 * rayon::current_num_threads();
        let mut columns = MAX_COLUMNS;
        let mut panels = TaskCut::new(n.div_ceil(tile.nr), columns / tile.nr);
        while rows.count() * panels.count() < enough && columns > FEWEST_COLUMNS {
            columns /= 2;
            panels = TaskCut::new(panels.total, columns / tile.nr);
        }
        Self {
            rows,
            panels,
            mr: tile.mr,
            m,
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.rows.count() * self.panels.count()
    }

    pub(crate) fn rows_per_task(&self) -> usize {
        self.rows.share * self.mr
    }

    /// Rows and panels of task `index`.
    pub(crate) fn get(&self, index: usize) -> (Range<usize>, Range<usize>) {
        let rows = self.rows.get(index / self.panels.count());
        let panels = self.panels.get(index % self.panels.count());
        (rows.start * self.mr..self.m.min(rows.end * self.mr), panels)
    }
}

/// `C = epilogue(A B + bias)`: `a` is `[m][k]`, `b` `k` × `n`, `c` `[m][n]`.
///
/// Sums over k are accumulated in order, in runs of 512, so that the result depends neither on `m` nor on the number of
/// threads. Relative L2 error against exact arithmetic is below 1e-6.
///
/// # Panics
/// If a length is wrong.
pub fn matmul(a: &[f32], b: &PackedMatrix, c: &mut [f32], m: usize, epilogue: Epilogue<'_>) {
    let (k, n) = (b.k(), b.n());
    assert_eq!(a.len(), m * k, "A is {m} x {k}");
    assert_eq!(c.len(), m * n, "C is {m} x {n}");
    if let Epilogue::Residual(r) | Epilogue::ResidualRelu(r) = epilogue {
        assert_eq!(r.len(), c.len(), "the residual is {m} x {n}");
    }
    let copy = |row: usize, ks, dst: &mut [f32]| dst.copy_from_slice(&a[row * k..][ks]);
    // SAFETY: rows are contiguous and do not overlap.
    unsafe { product(b, m, epilogue, SharedOut::new(c), copy, |row| row * n) };
}

/// Product of `m` rows with packed weights, split into tasks over all threads. `copy` and `offset` are as in
/// [`ProductBlock::run`].
///
/// # Safety
/// Rows must not overlap in the output, and no other thread may access them while this runs.
pub(crate) unsafe fn product(
    b: &PackedMatrix,
    m: usize,
    epilogue: Epilogue<'_>,
    out: SharedOut<'_>,
    copy: impl Fn(usize, Range<usize>, &mut [f32]) + Sync,
    offset: impl Fn(usize) -> usize + Sync,
) {
    let tile = MicroTile::of(b.simd());
    let tasks = Tasks::new(&tile, m, b.n());
    let len = scratch_len(&tile, tasks.rows_per_task(), b.k());
    run_tasks(tasks.count(), len, |index, scratch| {
        let (rows, panels) = tasks.get(index);
        let block = ProductBlock {
            b: b.view(),
            rows,
            panels,
            epilogue,
            out,
            out_stride: b.n(),
        };
        // SAFETY: every task owns disjoint rows or panels.
        unsafe { block.run(scratch, &copy, &offset) };
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Simd;
    use crate::testing::{noise, relative_error, with_threads};

    /// The product in f64, with the bias.
    fn exact(a: &[f32], w: &[f32], bias: &[f32], m: usize, k: usize, n: usize) -> Vec<f64> {
        let mut c = Vec::with_capacity(m * n);
        for row in a.chunks_exact(k).take(m) {
            for (w, b) in w.chunks_exact(k).zip(bias) {
                let dot: f64 = row
                    .iter()
                    .zip(w)
                    .map(|(x, y)| f64::from(*x) * f64::from(*y))
                    .sum();
                c.push(dot + f64::from(*b));
            }
        }
        c
    }

    const SHAPES: [(usize, usize, usize); 9] = [
        (1, 1, 1),
        (14, 64, 32),
        (15, 65, 33),
        (577, 96, 70),
        (3, 600, 17),
        (29, 256, 96),
        (113, 257, 64),
        (30, 1030, 45),
        (16, 512, 40),
    ];

    #[test]
    fn products_match_exact_arithmetic_at_every_level_and_thread_count() {
        for (m, k, n) in SHAPES {
            let (a, w) = (noise(1, m * k), noise(2, n * k));
            let (bias, residual) = (noise(3, n), noise(4, m * n));
            let exact = exact(&a, &w, &bias, m, k, n);
            for simd in Simd::available() {
                let packed = PackedMatrix::from_out_in(simd, &w, Some(&bias), n, k);
                let run = |epilogue, c: &mut [f32], threads| {
                    with_threads(threads, || {
                        matmul(&a, &packed, c, m, epilogue);
                    });
                };
                let mut plain = vec![f32::NAN; m * n];
                run(Epilogue::None, &mut plain, 1);
                assert!(
                    relative_error(&plain, &exact) < 1e-6,
                    "{simd:?} {m} {k} {n}"
                );
                let mut again = vec![f32::NAN; m * n];
                run(Epilogue::None, &mut again, 3);
                assert_eq!(plain, again, "{simd:?} {m} {k} {n}");

                let mut relu = vec![f32::NAN; m * n];
                run(Epilogue::Relu, &mut relu, 2);
                assert!(plain.iter().zip(&relu).all(|(p, r)| p.max(0.0) == *r));
                let mut added = vec![f32::NAN; m * n];
                run(Epilogue::Residual(&residual), &mut added, 2);
                assert!((0..m * n).all(|i| plain[i] + residual[i] == added[i]));
                run(Epilogue::ResidualRelu(&residual), &mut relu, 2);
                assert!((0..m * n).all(|i| added[i].max(0.0) == relu[i]));
                let mut onto = residual.clone();
                run(Epilogue::Add, &mut onto, 2);
                let sum: Vec<f64> = (0..m * n)
                    .map(|i| exact[i] + f64::from(residual[i]))
                    .collect();
                assert!(relative_error(&onto, &sum) < 1e-6, "{simd:?} {m} {k} {n}");
            }
        }
    }

    #[test]
    fn gelu_is_applied_to_sum_and_bias() {
        let (m, k, n) = (17, 40, 35);
        let (a, w, bias) = (noise(1, m * k), noise(2, n * k), noise(3, n));
        for simd in Simd::available() {
            let packed = PackedMatrix::from_out_in(simd, &w, Some(&bias), n, k);
            let (mut plain, mut gelu) = (vec![0.0; m * n], vec![0.0; m * n]);
            matmul(&a, &packed, &mut plain, m, Epilogue::None);
            matmul(&a, &packed, &mut gelu, m, Epilogue::Gelu);
            for (p, g) in plain.iter().zip(gelu) {
                let expected = crate::math::gelu::<false>(*p);
                assert!((expected - g).abs() < 1e-6, "{simd:?} gelu({p}) = {g}");
            }
        }
    }

    #[test]
    fn elements_and_columns_pack_alike() {
        let w = noise(5, 6);
        let simd = Simd::detect();
        let a = PackedMatrix::from_out_in(simd, &w, None, 2, 3);
        let b = PackedMatrix::pack(simd, 3, 2, None, |row, column| w[column * 3 + row]);
        assert_eq!(*a.view().data, *b.view().data);
        assert_eq!((a.k(), a.n()), (3, 2));
    }
}
