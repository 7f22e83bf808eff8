//! Sixteen f32 lanes on three instruction sets, chosen at run time.
//!
//! All three perform the same IEEE operations in the same order (fused where the code uses
//! `mul_add`), and so give the same bits. The portable implementation is meant for processors whose
//! baseline has a fused multiply-add (every 64-bit ARM); on x86 it is a slow fallback for
//! processors older than AVX2.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(super) use avx512::Avx512;
pub(super) use portable::Portable;
// The network's kernels and this renderer share detection and pinning of the instruction set.
pub(super) use sharp_kernels::{Simd, per_instruction_set};

/// Element type of a lane: f32, or f64 for tests that examine effects below f32 rounding.
pub(super) trait Scalar: Copy + Default + From<f32> + std::ops::AddAssign {
    /// Rounds to this type.
    fn of(x: f64) -> Self;
}

impl Scalar for f32 {
    fn of(x: f64) -> Self {
        x as Self
    }
}

/// Sixteen values, one for each pixel of a 4×4 block.
///
/// Implementations with intrinsics may only run inside a function compiled for their instruction set, which
/// [`per_instruction_set`] ensures.
pub(super) trait Lanes: Copy {
    /// One boolean per lane.
    type Mask: Copy;
    type Scalar: Scalar;

    fn splat(x: Self::Scalar) -> Self;
    fn from_array(x: &[Self::Scalar; 16]) -> Self;
    fn to_array(self) -> [Self::Scalar; 16];
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    /// `self * b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `c - self * b`, rounded once.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    /// Multiplies by 2ᵏ, where `n` is k + 1.5 · 2²³ for an integer k: adds the low nine bits of `n`'s representation to
    /// the exponent.
    fn scaled_by_low_bits(self, n: Self) -> Self;
    fn le(self, other: Self) -> Self::Mask;
    /// Lanes of `mask` in which `self > other`.
    fn gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask;
    /// Lanes of `mask` in which `self > other` is false.
    fn not_gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask;
    /// The value where the mask is set, else zero.
    fn masked(self, mask: Self::Mask) -> Self;
    /// `a` where the mask is set, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    fn any(mask: Self::Mask) -> bool;
    /// Sum of the lanes, by adding halves until one value is left.
    fn sum(self) -> Self::Scalar;

    #[inline(always)]
    fn zero() -> Self {
        Self::splat(Self::Scalar::default())
    }

    /// 2^self for −126 ≤ self ≤ 127, with a relative error of 1.2e-7; at least 2⁻¹²⁶ below that range; exactly 1 at 0.
    #[inline(always)]
    fn exp2(self) -> Self {
        const ROUND: f32 = 12_582_912.0; // 1.5 · 2²³
        let constant = |x: f32| Self::splat(x.into());
        let x = self.max(constant(-126.0));
        let shifted = x.add(constant(ROUND));
        let fraction = x.sub(shifted.sub(constant(ROUND)));
        // Minimax of relative error over ±1/2 with the constant fixed at 1.
        let mut sum = constant(EXP2_COEFFICIENTS[4]);
        for k in (0..4).rev() {
            sum = sum.mul_add(fraction, constant(EXP2_COEFFICIENTS[k]));
        }
        sum.mul_add(fraction, constant(1.0))
            .scaled_by_low_bits(shifted)
    }
}

#[expect(
    clippy::approx_constant,
    reason = "a fitted coefficient near ln 2, not ln 2"
)]
const EXP2_COEFFICIENTS: [f32; 5] = [
    0.693_147,
    0.240_222_42,
    0.055_507_336,
    0.009_671_513,
    0.001_326_472_7,
];

#[cfg(test)]
mod tests {
    use super::*;

    fn exp2_of(simd: Simd, x: &[f32; 16]) -> [f32; 16] {
        fn body<L: Lanes<Scalar = f32>>(x: &[f32; 16], out: &mut [f32; 16]) {
            *out = L::from_array(x).exp2().to_array();
        }
        per_instruction_set! {
            fn run(x: &[f32; 16], out: &mut [f32; 16]) = body::<Avx512>, body::<Avx2>, body::<Portable>
        }
        let mut out = [0.0; 16];
        run(simd, x, &mut out);
        out
    }

    #[test]
    fn lanes_are_summed_in_one_order_on_every_level() {
        fn body<L: Lanes<Scalar = f32>>(x: &[f32; 16], out: &mut f32) {
            *out = L::from_array(x).sum();
        }
        per_instruction_set! {
            fn run(x: &[f32; 16], out: &mut f32) = body::<Avx512>, body::<Avx2>, body::<Portable>
        }
        let mut random = 1_u32;
        for _ in 0..1000 {
            let x: [f32; 16] = std::array::from_fn(|_| {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (random as f32 / 4e9 - 0.5) * 2_f32.powi((random >> 20) as i32 % 20)
            });
            let exact: f64 = x.iter().map(|v| f64::from(*v)).sum();
            let size: f32 = x.iter().map(|v| v.abs()).sum();
            for simd in Simd::available() {
                let mut found = 0.0;
                run(simd, &x, &mut found);
                assert!((f64::from(found) - exact).abs() <= f64::from(4.0 * f32::EPSILON * size));
                let mut portable = 0.0;
                run(Simd::available()[0], &x, &mut portable);
                assert_eq!(found.to_bits(), portable.to_bits());
            }
        }
    }

    #[test]
    fn exp2_is_accurate_and_the_same_on_every_level() {
        let mut worst = 0.0_f64;
        for step in 0..20_000 {
            let x: [f32; 16] =
                std::array::from_fn(|lane| (step * 16 + lane) as f32 * (-126.0 / 320_000.0));
            let all: Vec<_> = Simd::available()
                .into_iter()
                .map(|simd| exp2_of(simd, &x).map(f32::to_bits))
                .collect();
            assert!(all.iter().all(|bits| *bits == all[0]));
            for lane in 0..16 {
                let truth = f64::from(x[lane]).exp2();
                let found = f64::from(f32::from_bits(all[0][lane]));
                worst = worst.max((found / truth - 1.0).abs());
            }
        }
        assert!(worst < 2e-7, "{worst:e}");
        assert_eq!(exp2_of(Simd::detect(), &[0.0; 16]), [1.0; 16]);
        let far = exp2_of(Simd::detect(), &[-1e30; 16]);
        assert!(far[0] > 0.0 && far[0] < 1e-37);
    }
}
