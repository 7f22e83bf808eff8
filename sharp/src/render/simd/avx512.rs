//! AVX-512: one register holds a block.

use super::Lanes;
use std::arch::x86_64::*;

#[derive(Clone, Copy)]
pub(in crate::render) struct Avx512(__m512);

macro_rules! sound {
    ($intrinsics:expr) => {{
        // SAFETY: runs only where `per_instruction_set` detected the instruction set and compiled for it; pointers are
        // to sixteen floats.
        unsafe { $intrinsics }
    }};
}

impl Lanes for Avx512 {
    type Mask = __mmask16;
    type Scalar = f32;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(sound!(_mm512_set1_ps(x)))
    }
    #[inline(always)]
    fn from_array(x: &[f32; 16]) -> Self {
        Self(sound!(_mm512_loadu_ps(x.as_ptr())))
    }
    #[inline(always)]
    fn to_array(self) -> [f32; 16] {
        let mut out = [0.0; 16];
        sound!(_mm512_storeu_ps(out.as_mut_ptr(), self.0));
        out
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(sound!(_mm512_add_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(sound!(_mm512_sub_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(sound!(_mm512_mul_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(sound!(_mm512_div_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(sound!(_mm512_fmadd_ps(self.0, b.0, c.0)))
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self(sound!(_mm512_fnmadd_ps(self.0, b.0, c.0)))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(sound!(_mm512_min_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(sound!(_mm512_max_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn scaled_by_low_bits(self, n: Self) -> Self {
        Self(sound!(_mm512_castsi512_ps(_mm512_add_epi32(
            _mm512_castps_si512(self.0),
            _mm512_slli_epi32::<23>(_mm512_castps_si512(n.0)),
        ))))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        sound!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0))
    }
    #[inline(always)]
    fn gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask {
        sound!(_mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(mask, self.0, other.0))
    }
    #[inline(always)]
    fn not_gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask {
        sound!(_mm512_mask_cmp_ps_mask::<_CMP_NGT_UQ>(
            mask, self.0, other.0
        ))
    }
    #[inline(always)]
    fn masked(self, mask: Self::Mask) -> Self {
        Self(sound!(_mm512_maskz_mov_ps(mask, self.0)))
    }
    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self(sound!(_mm512_mask_mov_ps(b.0, mask, a.0)))
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        mask != 0
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        sound!({
            let high = _mm512_extractf32x8_ps::<1>(self.0);
            let eight = _mm256_add_ps(_mm512_castps512_ps256(self.0), high);
            let four = _mm_add_ps(
                _mm256_castps256_ps128(eight),
                _mm256_extractf128_ps::<1>(eight),
            );
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
        })
    }
}
