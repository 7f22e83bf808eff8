//! Gradients of group normalisation.

use rayon::prelude::*;

use super::{GroupNorm, PIXELS_PER_TASK};
use crate::math::fma;
use crate::simd::{Simd, per_instruction_set};

/// Gradients of a group normalisation.
#[derive(Debug, Clone, PartialEq)]
pub struct NormGradient {
    /// Gradient of the input, in the input's layout.
    pub input: Vec<f32>,
    /// Gradient of the scales, `[channels]`.
    pub gamma: Vec<f32>,
    /// Gradient of the shifts, `[channels]`.
    pub beta: Vec<f32>,
}

/// Sums over a channel's pixels: of x, x², the gradient g, and g x.
type Sums = [f64; 4];

impl GroupNorm {
    /// Computes all gradients from `upstream`, the gradient of the output before ReLU, and the input `x`; both are
    /// `[pixels][channels]`. Sums are accumulated in f64.
    ///
    /// With x̂ = (x − μ)/s over the N values of a group, the gradient of the input is `(γ g − mean(γ g) − x̂ · mean(γ g
    /// x̂)) / s`.
    ///
    /// # Panics
    /// If a length is wrong.
    pub fn backward(&self, simd: Simd, x: &[f32], upstream: &[f32]) -> NormGradient {
        let channels = self.gamma.len();
        assert!(x.len().is_multiple_of(channels), "pixels of {channels}");
        assert_eq!(upstream.len(), x.len(), "upstream");
        let sums = self.sums(simd, x, upstream);
        let width = channels / self.groups;
        let count = (x.len() / self.groups) as f64;
        let (mut gamma, mut beta) = (vec![0.0; channels], vec![0.0; channels]);
        let mut linear = Linear {
            of_upstream: vec![0.0; channels],
            of_input: vec![0.0; channels],
            constant: vec![0.0; channels],
        };
        for group in 0..self.groups {
            let range = group * width..(group + 1) * width;
            let total = |k: usize| sums[range.clone()].iter().map(|s| s[k]).sum::<f64>();
            let mean = total(0) / count;
            let variance = (total(1) / count - mean * mean).max(0.0);
            let inverse = 1.0 / (variance + f64::from(self.eps)).sqrt();
            let (mut plain, mut weighted) = (0.0, 0.0);
            for c in range.clone() {
                let [_, _, g, gx] = sums[c];
                let normal = inverse * (gx - mean * g);
                gamma[c] = normal as f32;
                beta[c] = g as f32;
                plain += f64::from(self.gamma[c]) * g / count;
                weighted += f64::from(self.gamma[c]) * normal / count;
            }
            let of_input = -inverse * inverse * weighted;
            let constant = -inverse * plain - of_input * mean;
            for c in range {
                linear.of_upstream[c] = (inverse * f64::from(self.gamma[c])) as f32;
                linear.of_input[c] = of_input as f32;
                linear.constant[c] = constant as f32;
            }
        }
        let mut input = vec![0.0; x.len()];
        let chunk = PIXELS_PER_TASK * channels;
        let values = x.par_chunks(chunk).zip(upstream.par_chunks(chunk));
        let all = input.par_chunks_mut(chunk).zip(values);
        all.for_each(|(out, (x, g))| apply(simd, x, g, &linear, out));
        NormGradient { input, gamma, beta }
    }

    fn sums(&self, simd: Simd, x: &[f32], upstream: &[f32]) -> Vec<Sums> {
        let channels = self.gamma.len();
        let chunk = PIXELS_PER_TASK * channels;
        let both = x.par_chunks(chunk).zip(upstream.par_chunks(chunk));
        let parts: Vec<Vec<Sums>> = both
            .map(|(x, g)| {
                let mut sums = vec![[0.0; 4]; channels];
                add_sums(simd, x, g, &mut sums);
                sums
            })
            .collect();
        let mut sums = vec![[0.0; 4]; channels];
        for part in &parts {
            for (sums, part) in sums.iter_mut().zip(part) {
                for k in 0..4 {
                    sums[k] += part[k];
                }
            }
        }
        sums
    }
}

/// Gradient of the input as a per-channel linear map: `of_upstream · g + of_input · x + constant`.
struct Linear {
    of_upstream: Vec<f32>,
    of_input: Vec<f32>,
    constant: Vec<f32>,
}

per_instruction_set! {
    /// Applies a [`Linear`] to a run of pixels.
    fn apply(x: &[f32], g: &[f32], linear: &Linear, out: &mut [f32]) = apply_body
}

#[inline(always)]
fn apply_body<const FMA: bool>(x: &[f32], g: &[f32], linear: &Linear, out: &mut [f32]) {
    let channels = linear.constant.len();
    let (of_upstream, of_input) = (
        &linear.of_upstream[..channels],
        &linear.of_input[..channels],
    );
    let constant = &linear.constant[..channels];
    let pixels = x.chunks_exact(channels).zip(g.chunks_exact(channels));
    for (out, (x, g)) in out.chunks_exact_mut(channels).zip(pixels) {
        for c in 0..channels {
            let of_input = fma::<FMA>(of_input[c], x[c], constant[c]);
            out[c] = fma::<FMA>(of_upstream[c], g[c], of_input);
        }
    }
}

per_instruction_set! {
    /// Accumulates the [`Sums`] over a run of pixels.
    fn add_sums(x: &[f32], g: &[f32], sums: &mut [Sums]) = add_sums_body
}

#[inline(always)]
fn add_sums_body<const FMA: bool>(x: &[f32], g: &[f32], sums: &mut [Sums]) {
    const WIDE: usize = 8;
    let channels = sums.len();
    for first in (0..channels).step_by(WIDE) {
        let lanes = WIDE.min(channels - first);
        let mut totals = [[0.0_f64; WIDE]; 4];
        let pixels = x.chunks_exact(channels).zip(g.chunks_exact(channels));
        for (x, g) in pixels {
            let (mut xs, mut gs) = ([0.0_f32; WIDE], [0.0_f32; WIDE]);
            if lanes == WIDE {
                xs.copy_from_slice(&x[first..first + WIDE]);
                gs.copy_from_slice(&g[first..first + WIDE]);
            } else {
                xs[..lanes].copy_from_slice(&x[first..first + lanes]);
                gs[..lanes].copy_from_slice(&g[first..first + lanes]);
            }
            for l in 0..WIDE {
                // Products of two f32 are exact in f64, so a fused multiply-add would give the same
                // result.
                let (x, g) = (f64::from(xs[l]), f64::from(gs[l]));
                totals[0][l] += x;
                totals[1][l] += x * x;
                totals[2][l] += g;
                totals[3][l] += g * x;
            }
        }
        for l in 0..lanes {
            for k in 0..4 {
                sums[first + l][k] += totals[k][l];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{noise, relative_error, with_threads};

    const EPS: f64 = 1e-5;

    /// Σ upstream · normalised, in f64.
    fn loss(x: &[f64], gamma: &[f64], beta: &[f64], groups: usize, upstream: &[f32]) -> f64 {
        let channels = gamma.len();
        let (width, pixels) = (channels / groups, x.len() / channels);
        let mut sum = 0.0;
        for group in 0..groups {
            let places = || {
                (0..pixels).flat_map(move |p| {
                    (group * width..(group + 1) * width).map(move |c| (p * channels + c, c))
                })
            };
            let n = (pixels * width) as f64;
            let mean = places().map(|(at, _)| x[at]).sum::<f64>() / n;
            let variance = places().map(|(at, _)| (x[at] - mean).powi(2)).sum::<f64>() / n;
            let deviation = (variance + EPS).sqrt();
            sum += places()
                .map(|(at, c)| {
                    f64::from(upstream[at]) * ((x[at] - mean) / deviation * gamma[c] + beta[c])
                })
                .sum::<f64>();
        }
        sum
    }

    #[test]
    fn gradients_are_those_of_central_differences() {
        let (channels, groups, pixels) = (6, 3, 35);
        let x: Vec<f32> = noise(1, pixels * channels)
            .iter()
            .map(|v| v + 2.0)
            .collect();
        let (gamma, beta) = (noise(2, channels), noise(3, channels));
        let upstream = noise(4, x.len());
        let norm = GroupNorm::new(groups, &gamma, &beta, EPS as f32);
        let found = norm.backward(Simd::detect(), &x, &upstream);
        let wide = |v: &[f32]| v.iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
        let all = [wide(&x), wide(&gamma), wide(&beta)];
        for (which, found) in [&found.input, &found.gamma, &found.beta]
            .into_iter()
            .enumerate()
        {
            let exact: Vec<f64> = (0..found.len())
                .map(|k| {
                    let at = |step: f64| {
                        let mut all = all.clone();
                        all[which][k] += step;
                        loss(&all[0], &all[1], &all[2], groups, &upstream)
                    };
                    (at(1e-5) - at(-1e-5)) / 2e-5
                })
                .collect();
            assert!(relative_error(found, &exact) < 1e-5, "{which}");
        }
    }

    #[test]
    fn threads_change_nothing() {
        let x = noise(1, 4 * 10_000);
        let upstream = noise(2, x.len());
        let norm = GroupNorm::new(2, &[1.0; 4], &[0.0; 4], 1e-5);
        let run = |threads| with_threads(threads, || norm.backward(Simd::detect(), &x, &upstream));
        assert_eq!(run(1), run(3));
    }
}
