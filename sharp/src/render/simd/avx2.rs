//! AVX2 with FMA: two registers hold a block.

use super::Lanes;
use std::arch::x86_64::*;

#[derive(Clone, Copy)]
pub(in crate::render) struct Avx2([__m256; 2]);

impl Lanes for Avx2 {
    type Mask = [__m256; 2];

    #[inline(always)]
    fn splat(x: f32) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe { Self([_mm256_set1_ps(x); 2]) }
    }
    #[inline(always)]
    fn from_array(x: &[f32; 16]) -> Self {
        // SAFETY: sixteen readable floats; instruction set as below.
        unsafe {
            Self([
                _mm256_loadu_ps(x.as_ptr()),
                _mm256_loadu_ps(x.as_ptr().add(8)),
            ])
        }
    }
    #[inline(always)]
    fn to_array(self) -> [f32; 16] {
        let mut out = [0.0; 16];
        // SAFETY: sixteen writable floats; instruction set as below.
        unsafe {
            _mm256_storeu_ps(out.as_mut_ptr(), self.0[0]);
            _mm256_storeu_ps(out.as_mut_ptr().add(8), self.0[1]);
        }
        out
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_add_ps(self.0[0], other.0[0]),
                _mm256_add_ps(self.0[1], other.0[1]),
            ])
        }
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_sub_ps(self.0[0], other.0[0]),
                _mm256_sub_ps(self.0[1], other.0[1]),
            ])
        }
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_mul_ps(self.0[0], other.0[0]),
                _mm256_mul_ps(self.0[1], other.0[1]),
            ])
        }
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_fmadd_ps(self.0[0], b.0[0], c.0[0]),
                _mm256_fmadd_ps(self.0[1], b.0[1], c.0[1]),
            ])
        }
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_fnmadd_ps(self.0[0], b.0[0], c.0[0]),
                _mm256_fnmadd_ps(self.0[1], b.0[1], c.0[1]),
            ])
        }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_min_ps(self.0[0], other.0[0]),
                _mm256_min_ps(self.0[1], other.0[1]),
            ])
        }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_max_ps(self.0[0], other.0[0]),
                _mm256_max_ps(self.0[1], other.0[1]),
            ])
        }
    }
    #[inline(always)]
    fn scaled_by_low_bits(self, n: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_castsi256_ps(_mm256_add_epi32(
                    _mm256_castps_si256(self.0[0]),
                    _mm256_slli_epi32::<23>(_mm256_castps_si256(n.0[0])),
                )),
                _mm256_castsi256_ps(_mm256_add_epi32(
                    _mm256_castps_si256(self.0[1]),
                    _mm256_slli_epi32::<23>(_mm256_castps_si256(n.0[1])),
                )),
            ])
        }
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            [
                _mm256_cmp_ps::<_CMP_LE_OQ>(self.0[0], other.0[0]),
                _mm256_cmp_ps::<_CMP_LE_OQ>(self.0[1], other.0[1]),
            ]
        }
    }
    #[inline(always)]
    fn gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            [
                _mm256_and_ps(mask[0], _mm256_cmp_ps::<_CMP_GT_OQ>(self.0[0], other.0[0])),
                _mm256_and_ps(mask[1], _mm256_cmp_ps::<_CMP_GT_OQ>(self.0[1], other.0[1])),
            ]
        }
    }
    #[inline(always)]
    fn not_gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            [
                _mm256_and_ps(mask[0], _mm256_cmp_ps::<_CMP_NGT_UQ>(self.0[0], other.0[0])),
                _mm256_and_ps(mask[1], _mm256_cmp_ps::<_CMP_NGT_UQ>(self.0[1], other.0[1])),
            ]
        }
    }
    #[inline(always)]
    fn masked(self, mask: Self::Mask) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_and_ps(self.0[0], mask[0]),
                _mm256_and_ps(self.0[1], mask[1]),
            ])
        }
    }
    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe {
            Self([
                _mm256_blendv_ps(b.0[0], a.0[0], mask[0]),
                _mm256_blendv_ps(b.0[1], a.0[1], mask[1]),
            ])
        }
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        // SAFETY: runs only where `per_level` compiled and detected the instruction set.
        unsafe { _mm256_movemask_ps(_mm256_or_ps(mask[0], mask[1])) != 0 }
    }
}
