//! Elementary functions written so that the compiler vectorises them.

/// `a * b + c`, fused if `FMA` is true (the target has the instruction).
#[inline(always)]
pub(crate) fn fma<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// `max(x, 0)`, but NaN stays NaN, so that an error never becomes a plausible zero.
#[inline(always)]
pub(crate) fn relu(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

/// The exponential, within 2 units in the last place. Inputs are first clamped to -87..88.
#[inline(always)]
pub(crate) fn exp<const FMA: bool>(x: f32) -> f32 {
    /// Adding this constant leaves the nearest integer in the low bits.
    const ROUND: f32 = 12_582_912.0;
    // ln 2 in two parts: the first has few enough bits for n * LN2_HI to be exact.
    const LN2_HI: f32 = 0.693_359_4;
    const LN2_LO: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87.0, 88.0);
    let t = fma::<FMA>(x, std::f32::consts::LOG2_E, ROUND);
    let n = t - ROUND;
    let r = fma::<FMA>(n, -LN2_LO, fma::<FMA>(n, -LN2_HI, x));
    // Taylor series to the seventh power; |r| ≤ 0.347 leaves a remainder below 6e-9.
    let mut p = 1.0 / 5040.0;
    p = fma::<FMA>(p, r, 1.0 / 720.0);
    p = fma::<FMA>(p, r, 1.0 / 120.0);
    p = fma::<FMA>(p, r, 1.0 / 24.0);
    p = fma::<FMA>(p, r, 1.0 / 6.0);
    p = fma::<FMA>(p, r, 0.5);
    p = fma::<FMA>(p, r, 1.0);
    p = fma::<FMA>(p, r, 1.0);
    p * f32::from_bits((t.to_bits() << 23).wrapping_add(0x3f80_0000))
}

/// GELU with the error function, `x Φ(x)`, absolute error below 3e-7.
#[inline(always)]
pub(crate) fn gelu<const FMA: bool>(x: f32) -> f32 {
    // x Φ(x) = max(x, 0) - |x| erfc(|x| / √2) / 2 has no cancellation.
    fma::<FMA>(-0.5 * x.abs(), tail::<FMA>(x, bell::<FMA>(x)), x.max(0.0))
}

/// The derivative of [`gelu`], `Φ(x) + x φ(x)`, absolute error below 3e-7.
#[inline(always)]
pub(crate) fn gelu_slope<const FMA: bool>(x: f32) -> f32 {
    const DENSITY: f32 = 0.398_942_3;
    let bell = bell::<FMA>(x);
    let half = 0.5 * tail::<FMA>(x, bell);
    let phi = if x > 0.0 { 1.0 - half } else { half };
    fma::<FMA>(x * DENSITY, bell, phi)
}

/// exp(-x²/2).
#[inline(always)]
fn bell<const FMA: bool>(x: f32) -> f32 {
    // exp(-60) is negligible, and products of smaller values would be subnormal, which is a hundred times slower.
    exp::<FMA>((-0.5 * x * x).max(-60.0))
}

/// erfc(|x| / √2), given exp(-x²/2).
#[inline(always)]
fn tail<const FMA: bool>(x: f32, bell: f32) -> f32 {
    // erfc(z) = t P(t) exp(-z²) with t = 1 / (1 + 0.4 z): minimax fit over 0 ≤ z ≤ 10 with an absolute error of 8e-10.
    const P: [f32; 8] = [
        0.224_961_86,
        0.236_721_02,
        0.136_603_34,
        0.420_518_64,
        -0.396_837_47,
        0.708_776_1,
        -0.408_138_25,
        0.077_394_72,
    ];
    let z = x.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / fma::<FMA>(z, 0.4, 1.0);
    let mut p = P[7];
    for &c in P[..7].iter().rev() {
        p = fma::<FMA>(p, t, c);
    }
    p * t * bell
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Simd, per_instruction_set};

    per_instruction_set! { fn exps(x: &mut [f32]) = exps_body }

    #[inline(always)]
    fn exps_body<const FMA: bool>(x: &mut [f32]) {
        x.iter_mut().for_each(|v| *v = exp::<FMA>(*v));
    }

    per_instruction_set! { fn gelus(x: &mut [f32]) = gelus_body }

    #[inline(always)]
    fn gelus_body<const FMA: bool>(x: &mut [f32]) {
        x.iter_mut().for_each(|v| *v = gelu::<FMA>(*v));
    }

    fn grid(from: f32, to: f32) -> Vec<f32> {
        (0..=200_000)
            .map(|i| from + (to - from) * (i as f32 / 200_000.0))
            .collect()
    }

    #[test]
    fn exp_is_within_two_ulp() {
        for simd in Simd::available() {
            let x = grid(-86.0, 87.0);
            let mut y = x.clone();
            exps(simd, &mut y);
            for (x, y) in x.iter().zip(y) {
                let exact = f64::from(*x).exp();
                assert!(
                    (f64::from(y) / exact - 1.0).abs() < 2.4e-7,
                    "{simd:?} exp({x}) = {y}"
                );
            }
        }
    }

    /// Φ by its power series or continued fraction in f64.
    fn phi(x: f64) -> f64 {
        let z = x.abs() / std::f64::consts::SQRT_2;
        let erfc = if z < 3.0 {
            let (mut term, mut sum) = (z, z);
            for n in 1..200 {
                term *= -z * z / f64::from(n);
                sum += term / f64::from(2 * n + 1);
            }
            1.0 - 2.0 / std::f64::consts::PI.sqrt() * sum
        } else {
            let mut f = 0.0;
            for n in (1..60).rev() {
                f = f64::from(n) / 2.0 / (z + f);
            }
            (-z * z).exp() / std::f64::consts::PI.sqrt() / (z + f)
        };
        if x < 0.0 {
            0.5 * erfc
        } else {
            1.0 - 0.5 * erfc
        }
    }

    #[test]
    fn gelu_is_that_of_the_error_function() {
        for simd in Simd::available() {
            let x = grid(-12.0, 12.0);
            let mut y = x.clone();
            gelus(simd, &mut y);
            for (x, y) in x.iter().zip(y) {
                let exact = f64::from(*x) * phi(f64::from(*x));
                let error = (f64::from(y) - exact).abs();
                assert!(
                    error < 3e-7_f64.max(1.2e-7 * exact),
                    "{simd:?} gelu({x}) = {y}, {exact}"
                );
            }
            // The tanh approximation is off by up to 5e-4 and must not pass.
            let mut one = [1.0];
            gelus(simd, &mut one);
            assert!((one[0] - 0.841_344_7).abs() < 3e-7);
        }
    }
}
