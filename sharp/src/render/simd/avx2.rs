//! AVX2 with FMA: two registers hold a block.

use super::Lanes;
use std::arch::x86_64::*;

#[derive(Clone, Copy)]
pub(in crate::render) struct Avx2([__m256; 2]);

/// Evaluates an expression on the registers `i` = 0 and 1. Not a closure, which might not be inlined.
macro_rules! both {
    (|$i:ident| $each:expr) => {{
        // SAFETY: runs only where `per_instruction_set` detected the instruction set and compiled for it; pointers are
        // to sixteen floats.
        unsafe {
            [
                {
                    let $i = 0;
                    $each
                },
                {
                    let $i = 1;
                    $each
                },
            ]
        }
    }};
}

impl Lanes for Avx2 {
    type Mask = [__m256; 2];
    type Scalar = f32;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(both!(|_i| _mm256_set1_ps(x)))
    }
    #[inline(always)]
    fn from_array(x: &[f32; 16]) -> Self {
        Self(both!(|i| _mm256_loadu_ps(x.as_ptr().add(8 * i))))
    }
    #[inline(always)]
    fn to_array(self) -> [f32; 16] {
        let mut out = [0.0; 16];
        both!(|i| _mm256_storeu_ps(out.as_mut_ptr().add(8 * i), self.0[i]));
        out
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(both!(|i| _mm256_add_ps(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(both!(|i| _mm256_sub_ps(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(both!(|i| _mm256_mul_ps(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(both!(|i| _mm256_div_ps(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(both!(|i| _mm256_fmadd_ps(self.0[i], b.0[i], c.0[i])))
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self(both!(|i| _mm256_fnmadd_ps(self.0[i], b.0[i], c.0[i])))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(both!(|i| _mm256_min_ps(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(both!(|i| _mm256_max_ps(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn scaled_by_low_bits(self, n: Self) -> Self {
        Self(both!(|i| _mm256_castsi256_ps(_mm256_add_epi32(
            _mm256_castps_si256(self.0[i]),
            _mm256_slli_epi32::<23>(_mm256_castps_si256(n.0[i])),
        ))))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        both!(|i| _mm256_cmp_ps::<_CMP_LE_OQ>(self.0[i], other.0[i]))
    }
    #[inline(always)]
    fn gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask {
        both!(|i| _mm256_and_ps(mask[i], _mm256_cmp_ps::<_CMP_GT_OQ>(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn not_gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask {
        both!(|i| _mm256_and_ps(mask[i], _mm256_cmp_ps::<_CMP_NGT_UQ>(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn masked(self, mask: Self::Mask) -> Self {
        Self(both!(|i| _mm256_and_ps(self.0[i], mask[i])))
    }
    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self(both!(|i| _mm256_blendv_ps(b.0[i], a.0[i], mask[i])))
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        let [low, high] = both!(|i| _mm256_movemask_ps(mask[i]));
        low | high != 0
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: runs only where `per_instruction_set` detected the instruction set and compiled
        // for it; pointers are to sixteen floats.
        unsafe {
            let eight = _mm256_add_ps(self.0[0], self.0[1]);
            let four = _mm_add_ps(
                _mm256_castps256_ps128(eight),
                _mm256_extractf128_ps::<1>(eight),
            );
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
        }
    }
}
