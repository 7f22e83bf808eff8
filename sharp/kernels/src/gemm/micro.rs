//! Microkernels: a tile of `mr` × `nr` products, one kernel per instruction set.
//!
//! `A` is stored row by row, `STRIDE` floats apart; `B` is packed, `nr` columns per step of k. The
//! row distance is a constant so that every row is addressed from one pointer. The distance is a
//! power of two plus one cache line, so that the rows of a tile map to different cache sets.

use crate::simd::{InstructionSet, Simd};

/// Longest run of the inner dimension k that is summed at once. Longer sums are split into runs of this length, which
/// also limits their rounding error.
pub(crate) const KC: usize = 512;

/// Row distances of `A` for which kernels exist.
const STRIDES: [usize; 4] = [64 + 16, 128 + 16, 256 + 16, KC + 16];

/// Smallest supported row distance for runs of `k`.
pub(crate) fn stride_for(k: usize) -> usize {
    STRIDES[index_for(k)]
}

fn index_for(k: usize) -> usize {
    match k {
        0..=64 => 0,
        65..=128 => 1,
        129..=256 => 2,
        _ => 3,
    }
}

/// Computes `c = a b + init` for a whole tile. The sum over k is completed before `init` is added, so that a sum over
/// several runs of k is a sum of short sums.
///
/// Arguments: the number of steps `k`; `a`; `b`; `c` and the distance between its rows; `init` and the distance between
/// its rows (0 to use one row for all).
///
/// # Safety
/// `a` must be readable for `mr` rows of `k`, `b` for `k * nr`, and `init` for `mr` rows of `nr`; `c` must be writable
/// for `mr` rows of `nr`. `init` may alias `c`. The machine must support the instruction set.
pub(crate) type Micro =
    unsafe fn(usize, *const f32, *const f32, *mut f32, usize, *const f32, usize);

/// Tile shape and kernels of an instruction set.
#[derive(Clone, Copy)]
pub(crate) struct MicroTile {
    pub(crate) mr: usize,
    pub(crate) nr: usize,
    kernels: [Micro; 4],
}

impl MicroTile {
    /// Largest `mr * nr` of all instruction sets.
    pub(crate) const MAX: usize = 14 * 32;

    pub(crate) fn of(simd: Simd) -> Self {
        /// A kernel for each row distance in `STRIDES`.
        macro_rules! kernels {
            ($kernel:path) => {{
                use $kernel as kernel;
                [
                    kernel::<{ STRIDES[0] }>,
                    kernel::<{ STRIDES[1] }>,
                    kernel::<{ STRIDES[2] }>,
                    kernel::<{ STRIDES[3] }>,
                ]
            }};
        }
        let (mr, nr, kernels): (_, _, [Micro; 4]) = match simd.instruction_set() {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => (14, 32, kernels!(x86::avx512)),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => (6, 16, kernels!(x86::avx2)),
            _ => (4, 8, kernels!(self::portable)),
        };
        Self { mr, nr, kernels }
    }

    /// Kernel for rows of `A` that are `stride_for(k)` apart.
    pub(crate) fn kernel(&self, k: usize) -> Micro {
        self.kernels[index_for(k)]
    }
}

/// 4 × 8 without fused multiply-add.
///
/// # Safety
/// See [`Micro`].
unsafe fn portable<const STRIDE: usize>(
    k: usize,
    a: *const f32,
    b: *const f32,
    c: *mut f32,
    c_stride: usize,
    init: *const f32,
    init_stride: usize,
) {
    let mut acc = [[0.0_f32; 8]; 4];
    for i in 0..k {
        // SAFETY: `b` has `k` steps of eight.
        let b = unsafe { b.add(i * 8).cast::<[f32; 8]>().read() };
        for (r, row) in acc.iter_mut().enumerate() {
            // SAFETY: `a` has four rows of `k`.
            let a = unsafe { *a.add(r * STRIDE + i) };
            for (sum, b) in row.iter_mut().zip(b) {
                *sum += a * b;
            }
        }
    }
    for (r, row) in acc.iter_mut().enumerate() {
        // SAFETY: `init` and `c` have four rows of eight; arrays of f32 are aligned as f32 is.
        unsafe {
            let init = init.add(r * init_stride).cast::<[f32; 8]>().read();
            for (sum, init) in row.iter_mut().zip(init) {
                *sum += init;
            }
            c.add(r * c_stride).cast::<[f32; 8]>().write(*row);
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    /// Number of steps of k by which `B` is prefetched. Prefetching beyond a panel's end is useful because the next
    /// panel follows it in memory. Saves a tenth of the time if `B` is read from the last-level cache.
    const AHEAD: usize = 32;

    /// Defines a kernel for a tile of `$rows` rows by two vectors of `$lanes` columns. Each row has two accumulators
    /// and one broadcast of `A`; all rows share two vectors of `B`.
    macro_rules! kernel {
        ($name:ident, $features:literal, $rows:literal x $lanes:literal, $zero:ident,
         $load:ident, $splat:ident, $fma:ident, $add:ident, $store:ident) => {
            /// # Safety
            /// As for [`super::Micro`].
            #[target_feature(enable = $features)]
            pub(super) unsafe fn $name<const STRIDE: usize>(
                k: usize,
                a: *const f32,
                b: *const f32,
                c: *mut f32,
                c_stride: usize,
                init: *const f32,
                init_stride: usize,
            ) {
                const WIDTH: usize = 2 * $lanes;
                let mut acc = [[$zero(); 2]; $rows];
                // Prefetch the output, which is only accessed at the very end.
                for r in 0..$rows {
                    for line in (0..WIDTH).step_by(16) {
                        _mm_prefetch::<_MM_HINT_T0>(c.wrapping_add(r * c_stride + line).cast());
                    }
                }
                for i in 0..k {
                    for line in (0..WIDTH).step_by(16) {
                        let ahead = b.wrapping_add((i + AHEAD) * WIDTH + line);
                        _mm_prefetch::<_MM_HINT_T0>(ahead.cast());
                    }
                    // SAFETY: `b` has `k` steps of `WIDTH`.
                    let (b0, b1) = unsafe {
                        let at = b.add(i * WIDTH);
                        ($load(at), $load(at.add($lanes)))
                    };
                    for (r, row) in acc.iter_mut().enumerate() {
                        // SAFETY: `a` has `$rows` rows of `k`.
                        let a = $splat(unsafe { *a.add(r * STRIDE + i) });
                        row[0] = $fma(a, b0, row[0]);
                        row[1] = $fma(a, b1, row[1]);
                    }
                }
                for (r, row) in acc.iter().enumerate() {
                    // SAFETY: `init` and `c` have `$rows` rows of `WIDTH`.
                    unsafe {
                        let init = init.add(r * init_stride);
                        let c = c.add(r * c_stride);
                        $store(c, $add(row[0], $load(init)));
                        $store(c.add($lanes), $add(row[1], $load(init.add($lanes))));
                    }
                }
            }
        };
    }

    kernel!(
        avx512,
        "avx512f",
        14 x 16,
        _mm512_setzero_ps,
        _mm512_loadu_ps,
        _mm512_set1_ps,
        _mm512_fmadd_ps,
        _mm512_add_ps,
        _mm512_storeu_ps
    );
    kernel!(
        avx2,
        "avx2,fma",
        6 x 8,
        _mm256_setzero_ps,
        _mm256_loadu_ps,
        _mm256_set1_ps,
        _mm256_fmadd_ps,
        _mm256_add_ps,
        _mm256_storeu_ps
    );
}
