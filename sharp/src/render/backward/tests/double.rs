//! The lanes in f64: run the production kernel without the effects of rounding to f32.

use crate::render::simd::{Lanes, Scalar};

impl Scalar for f64 {
    fn of(x: f64) -> Self {
        x
    }
}

#[derive(Clone, Copy)]
pub(super) struct Double([f64; 16]);

fn map2(a: Double, b: Double, f: impl Fn(f64, f64) -> f64) -> Double {
    Double(std::array::from_fn(|i| f(a.0[i], b.0[i])))
}

impl Lanes for Double {
    type Mask = [bool; 16];
    type Scalar = f64;

    fn splat(x: f64) -> Self {
        Self([x; 16])
    }
    fn from_array(x: &[f64; 16]) -> Self {
        Self(*x)
    }
    fn to_array(self) -> [f64; 16] {
        self.0
    }
    fn add(self, other: Self) -> Self {
        map2(self, other, |a, b| a + b)
    }
    fn sub(self, other: Self) -> Self {
        map2(self, other, |a, b| a - b)
    }
    fn mul(self, other: Self) -> Self {
        map2(self, other, |a, b| a * b)
    }
    fn div(self, other: Self) -> Self {
        map2(self, other, |a, b| a / b)
    }
    fn mul_add(self, b: Self, c: Self) -> Self {
        self.mul(b).add(c)
    }
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        c.sub(self.mul(b))
    }
    fn min(self, other: Self) -> Self {
        map2(self, other, f64::min)
    }
    fn max(self, other: Self) -> Self {
        map2(self, other, f64::max)
    }
    fn scaled_by_low_bits(self, _: Self) -> Self {
        unreachable!("only `exp2` of f32 needs it")
    }
    fn le(self, other: Self) -> Self::Mask {
        std::array::from_fn(|i| self.0[i] <= other.0[i])
    }
    fn gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask {
        std::array::from_fn(|i| mask[i] && self.0[i] > other.0[i])
    }
    fn not_gt_where(self, other: Self, mask: Self::Mask) -> Self::Mask {
        std::array::from_fn(|i| mask[i] && self.0[i] <= other.0[i])
    }
    fn masked(self, mask: Self::Mask) -> Self {
        Self::select(mask, self, Self([0.0; 16]))
    }
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(
            |i| if mask[i] { a.0[i] } else { b.0[i] },
        ))
    }
    fn any(mask: Self::Mask) -> bool {
        mask.contains(&true)
    }
    fn sum(self) -> f64 {
        self.0.iter().sum()
    }
    fn exp2(self) -> Self {
        Self(self.0.map(f64::exp2))
    }
}
