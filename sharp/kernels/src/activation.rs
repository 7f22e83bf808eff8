//! GELU over a slice and its gradient, for callers that do not fuse GELU into a matrix product.

use rayon::prelude::*;

use crate::math;
use crate::simd::{Simd, per_instruction_set};

/// Number of values per task.
const CHUNK: usize = 1 << 14;

/// Applies GELU, `x Φ(x)`, to every value; the absolute error is below 3e-7.
pub fn gelu(simd: Simd, x: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; x.len()];
    let chunks = out.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK));
    chunks.for_each(|(out, x)| forward(simd, x, out));
    out
}

/// Gradient with respect to the input of [`gelu`], given the gradient with respect to its output.
///
/// # Panics
/// If the lengths differ.
pub fn gelu_gradient(simd: Simd, x: &[f32], upstream: &[f32]) -> Vec<f32> {
    assert_eq!(x.len(), upstream.len(), "upstream");
    let mut out = upstream.to_vec();
    let chunks = out.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK));
    chunks.for_each(|(out, x)| backward(simd, x, out));
    out
}

per_instruction_set! {
    fn forward(x: &[f32], out: &mut [f32]) = forward_body
}

#[inline(always)]
fn forward_body<const FMA: bool>(x: &[f32], out: &mut [f32]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = math::gelu::<FMA>(*x);
    }
}

per_instruction_set! {
    /// Multiplies the gradient by GELU's slope.
    fn backward(x: &[f32], out: &mut [f32]) = backward_body
}

#[inline(always)]
fn backward_body<const FMA: bool>(x: &[f32], out: &mut [f32]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out *= math::gelu_slope::<FMA>(*x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_the_slope_of_the_function() {
        let x: Vec<f32> = (-5000..=5000).map(|k| k as f32 / 1000.0).collect();
        let upstream = vec![2.0; x.len()];
        // Φ by the Taylor series of erf.
        let phi = |x: f64| {
            let z = x / std::f64::consts::SQRT_2;
            let (mut term, mut sum) = (z, z);
            for n in 1..200 {
                let n = f64::from(n);
                term *= -z * z / n;
                sum += term / (2.0 * n + 1.0);
            }
            0.5 + sum / std::f64::consts::PI.sqrt()
        };
        for simd in Simd::available() {
            let found = gelu_gradient(simd, &x, &upstream);
            for (x, found) in x.iter().zip(found) {
                let wide = f64::from(*x);
                let density = (-0.5 * wide * wide).exp() / std::f64::consts::TAU.sqrt();
                let slope = phi(wide) + wide * density;
                assert!(
                    (f64::from(found) / 2.0 - slope).abs() < 1e-6,
                    "{simd:?} {x}"
                );
            }
            for (x, found) in x.iter().zip(gelu(simd, &x)) {
                let exact = f64::from(*x) * phi(f64::from(*x));
                assert!((f64::from(found) - exact).abs() < 1e-6, "{simd:?} {x}");
            }
        }
    }
}
