//! The innermost kernels: a tile of `mr` × `nr` products, one per instruction set.
//!
//! `A` lies row by row, `STRIDE` floats apart; `B` is packed, `nr` columns per step of k. The
//! row distance is a constant so that every row is reached from one pointer, and is a multiple
//! of a cache line plus one line, so that the rows of a tile fall into different cache sets.

use crate::simd::{InstructionSet, Simd};

/// The longest run of k that is summed in one go. Longer sums are made of such runs, which
/// also keeps the rounding error of long sums down.
pub(crate) const KC: usize = 512;

/// The distances between rows of `A` that kernels exist for.
const STRIDES: [usize; 4] = [64 + 16, 128 + 16, 256 + 16, KC + 16];

/// The smallest row distance for runs of `k`.
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

/// `c = a b + init` for a whole tile: the sum over k is made first, so that the sum of several
/// runs is a sum of short sums. Arguments: the number of steps `k`; `a`, `b`; `c` and
/// the distance of its rows; `init` and the distance of its rows, 0 to use one row for all.
///
/// # Safety
/// `a` must be readable for `mr` rows of `k`, `b` for `k * nr`, `init` and `c` readable and
/// writable for their `mr` rows of `nr`; `init` may be `c`. The machine must have the level.
pub(crate) type Micro =
    unsafe fn(usize, *const f32, *const f32, *mut f32, usize, *const f32, usize);

/// Shape of a level's tile, and its kernels.
#[derive(Clone, Copy)]
pub(crate) struct Tile {
    pub(crate) mr: usize,
    pub(crate) nr: usize,
    kernels: [Micro; 4],
}

impl Tile {
    /// The largest `mr * nr` of all levels.
    pub(crate) const MAX: usize = 14 * 32;

    pub(crate) fn of(simd: Simd) -> Self {
        match simd.instruction_set() {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => Self {
                mr: 14,
                nr: 32,
                kernels: [
                    x86::avx512::<{ STRIDES[0] }>,
                    x86::avx512::<{ STRIDES[1] }>,
                    x86::avx512::<{ STRIDES[2] }>,
                    x86::avx512::<{ STRIDES[3] }>,
                ],
            },
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => Self {
                mr: 6,
                nr: 16,
                kernels: [
                    x86::avx2::<{ STRIDES[0] }>,
                    x86::avx2::<{ STRIDES[1] }>,
                    x86::avx2::<{ STRIDES[2] }>,
                    x86::avx2::<{ STRIDES[3] }>,
                ],
            },
            _ => Self {
                mr: 4,
                nr: 8,
                kernels: [
                    portable::<{ STRIDES[0] }>,
                    portable::<{ STRIDES[1] }>,
                    portable::<{ STRIDES[2] }>,
                    portable::<{ STRIDES[3] }>,
                ],
            },
        }
    }

    /// The kernel for rows of `A` that are `stride_for(k)` apart.
    pub(crate) fn kernel(&self, k: usize) -> Micro {
        self.kernels[index_for(k)]
    }
}

/// 4 × 8 without fused multiply-add.
///
/// # Safety
/// As [`Micro`].
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

    /// How many steps ahead `B` is fetched: the next panel follows this one, so that fetching
    /// beyond the end is of use. Worth a tenth of the time where `B` comes from the last cache.
    const AHEAD: usize = 32;

    /// 14 × 32: 28 accumulators, two vectors of `B`, one broadcast of `A`.
    ///
    /// # Safety
    /// As [`super::Micro`].
    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn avx512<const STRIDE: usize>(
        k: usize,
        a: *const f32,
        b: *const f32,
        c: *mut f32,
        c_stride: usize,
        init: *const f32,
        init_stride: usize,
    ) {
        let mut acc = [[_mm512_setzero_ps(); 2]; 14];
        // The output is touched at the very end; its lines can arrive meanwhile.
        for r in 0..14 {
            _mm_prefetch::<_MM_HINT_T0>(c.wrapping_add(r * c_stride).cast());
            _mm_prefetch::<_MM_HINT_T0>(c.wrapping_add(r * c_stride + 16).cast());
        }
        for i in 0..k {
            _mm_prefetch::<_MM_HINT_T0>(b.wrapping_add((i + AHEAD) * 32).cast());
            _mm_prefetch::<_MM_HINT_T0>(b.wrapping_add((i + AHEAD) * 32 + 16).cast());
            // SAFETY: `b` has `k` steps of 32.
            let (b0, b1) = unsafe {
                let at = b.add(i * 32);
                (_mm512_loadu_ps(at), _mm512_loadu_ps(at.add(16)))
            };
            for (r, row) in acc.iter_mut().enumerate() {
                // SAFETY: `a` has 14 rows of `k`.
                let a = _mm512_set1_ps(unsafe { *a.add(r * STRIDE + i) });
                row[0] = _mm512_fmadd_ps(a, b0, row[0]);
                row[1] = _mm512_fmadd_ps(a, b1, row[1]);
            }
        }
        for (r, row) in acc.iter().enumerate() {
            // SAFETY: `init` and `c` have 14 rows of 32.
            unsafe {
                let init = init.add(r * init_stride);
                let c = c.add(r * c_stride);
                let (i0, i1) = (_mm512_loadu_ps(init), _mm512_loadu_ps(init.add(16)));
                _mm512_storeu_ps(c, _mm512_add_ps(row[0], i0));
                _mm512_storeu_ps(c.add(16), _mm512_add_ps(row[1], i1));
            }
        }
    }

    /// 6 × 16: 12 accumulators, two vectors of `B`, one broadcast of `A`.
    ///
    /// # Safety
    /// As [`super::Micro`].
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn avx2<const STRIDE: usize>(
        k: usize,
        a: *const f32,
        b: *const f32,
        c: *mut f32,
        c_stride: usize,
        init: *const f32,
        init_stride: usize,
    ) {
        let mut acc = [[_mm256_setzero_ps(); 2]; 6];
        for r in 0..6 {
            _mm_prefetch::<_MM_HINT_T0>(c.wrapping_add(r * c_stride).cast());
        }
        for i in 0..k {
            _mm_prefetch::<_MM_HINT_T0>(b.wrapping_add((i + AHEAD) * 16).cast());
            // SAFETY: `b` has `k` steps of 16.
            let (b0, b1) = unsafe {
                let at = b.add(i * 16);
                (_mm256_loadu_ps(at), _mm256_loadu_ps(at.add(8)))
            };
            for (r, row) in acc.iter_mut().enumerate() {
                // SAFETY: `a` has six rows of `k`.
                let a = _mm256_set1_ps(unsafe { *a.add(r * STRIDE + i) });
                row[0] = _mm256_fmadd_ps(a, b0, row[0]);
                row[1] = _mm256_fmadd_ps(a, b1, row[1]);
            }
        }
        for (r, row) in acc.iter().enumerate() {
            // SAFETY: `init` and `c` have six rows of 16.
            unsafe {
                let init = init.add(r * init_stride);
                let c = c.add(r * c_stride);
                let (i0, i1) = (_mm256_loadu_ps(init), _mm256_loadu_ps(init.add(8)));
                _mm256_storeu_ps(c, _mm256_add_ps(row[0], i0));
                _mm256_storeu_ps(c.add(8), _mm256_add_ps(row[1], i1));
            }
        }
    }
}
