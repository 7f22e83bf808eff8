//! Layer normalisation of tokens, group normalisation of images.

mod backward;

pub use backward::NormGradient;

use rayon::prelude::*;

use crate::math::{fma, relu};
use crate::simd::{Simd, per_instruction_set};

/// Number of partial sums over a token; the same for every instruction set.
const LANES: usize = 16;

/// Normalises every row of `x` (`[rows][dim]`, `dim` the length of `gamma`) to mean 0 and
/// variance 1, then scales by `gamma` and shifts by `beta`:
/// `(x - mean) / sqrt(variance + eps) · gamma + beta`, population variance.
///
/// # Panics
/// If a length is wrong.
pub fn layer_norm(simd: Simd, x: &[f32], gamma: &[f32], beta: &[f32], eps: f32, out: &mut [f32]) {
    const ROWS_PER_TASK: usize = 16;
    let dim = gamma.len();
    assert!(dim > 0 && x.len().is_multiple_of(dim), "rows of {dim}");
    assert_eq!(beta.len(), dim, "as many shifts as scales");
    assert_eq!(out.len(), x.len(), "output");
    out.par_chunks_mut(ROWS_PER_TASK * dim)
        .zip(x.par_chunks(ROWS_PER_TASK * dim))
        .for_each(|(out, x)| normalise_rows(simd, x, gamma, beta, eps, out));
}

per_instruction_set! {
    /// Layer normalisation of some rows.
    fn normalise_rows(
        x: &[f32],
        gamma: &[f32],
        beta: &[f32],
        eps: f32,
        out: &mut [f32],
    ) = normalise_rows_body
}

#[inline(always)]
fn normalise_rows_body<const FMA: bool>(
    x: &[f32],
    gamma: &[f32],
    beta: &[f32],
    eps: f32,
    out: &mut [f32],
) {
    let dim = gamma.len();
    for (x, out) in x.chunks_exact(dim).zip(out.chunks_exact_mut(dim)) {
        let (whole, tail) = x.as_chunks::<LANES>();
        let mut sums = [0.0_f32; LANES];
        for chunk in whole {
            for l in 0..LANES {
                sums[l] += chunk[l];
            }
        }
        for (sum, v) in sums.iter_mut().zip(tail) {
            *sum += v;
        }
        // Split the mean into two parts, because its rounding error would otherwise be amplified if
        // the variance is small.
        let exact = total(&sums) / dim as f64;
        let mean = exact as f32;
        let rest = (exact - f64::from(mean)) as f32;
        let mut squares = [0.0_f32; LANES];
        for chunk in whole {
            for l in 0..LANES {
                let v = chunk[l] - mean - rest;
                squares[l] = fma::<FMA>(v, v, squares[l]);
            }
        }
        for (sum, v) in squares.iter_mut().zip(tail) {
            let v = v - mean - rest;
            *sum = fma::<FMA>(v, v, *sum);
        }
        let variance = total(&squares) / dim as f64;
        let factor = (1.0 / (variance + f64::from(eps)).sqrt()) as f32;
        for i in 0..dim {
            out[i] = fma::<FMA>((x[i] - mean - rest) * factor, gamma[i], beta[i]);
        }
    }
}

fn total(lanes: &[f32; LANES]) -> f64 {
    let mut sum = 0.0;
    for &lane in lanes {
        sum += f64::from(lane);
    }
    sum
}

/// Group normalisation of an NHWC image: each group of neighbouring channels is normalised to mean 0 and variance 1
/// over all pixels, then each channel is scaled and shifted.
#[derive(Debug, Clone)]
pub struct GroupNorm {
    groups: usize,
    gamma: Vec<f32>,
    beta: Vec<f32>,
    eps: f32,
}

/// Pixels summed by one task. A constant, so that results do not depend on the number of threads.
const PIXELS_PER_TASK: usize = 4096;

impl GroupNorm {
    /// Creates a normalisation with `groups` groups; `gamma` and `beta` have one element per channel.
    ///
    /// # Panics
    /// If the number of channels is not a multiple of `groups`, or the lengths differ.
    pub fn new(groups: usize, gamma: &[f32], beta: &[f32], eps: f32) -> Self {
        assert!(
            groups > 0 && gamma.len().is_multiple_of(groups) && !gamma.is_empty(),
            "{groups} groups of {} channels",
            gamma.len()
        );
        assert_eq!(gamma.len(), beta.len(), "as many shifts as scales");
        Self {
            groups,
            gamma: gamma.to_vec(),
            beta: beta.to_vec(),
            eps,
        }
    }

    /// Normalises `x` (`[pixels][channels]`) into `out`, then applies ReLU if `relu`.
    ///
    /// Sums are accumulated in f64: over the millions of values of a group, f32 would lose digits.
    ///
    /// # Panics
    /// If a length is wrong.
    pub fn run(&self, simd: Simd, x: &[f32], relu: bool, out: &mut [f32]) {
        let channels = self.gamma.len();
        assert!(x.len().is_multiple_of(channels), "pixels of {channels}");
        assert_eq!(out.len(), x.len(), "output");
        let affine = self.affine(simd, x);
        out.par_chunks_mut(PIXELS_PER_TASK * channels)
            .zip(x.par_chunks(PIXELS_PER_TASK * channels))
            .for_each(|(out, x)| apply(simd, x, &affine, relu, out));
    }

    /// The per-channel affine map that is equivalent to normalising this image.
    fn affine(&self, simd: Simd, x: &[f32]) -> Affine {
        let channels = self.gamma.len();
        let parts: Vec<Vec<[f64; 2]>> = x
            .par_chunks(PIXELS_PER_TASK * channels)
            .map(|x| {
                let mut sums = vec![[0.0; 2]; channels];
                moments(simd, x, &mut sums);
                sums
            })
            .collect();
        let width = channels / self.groups;
        let count = (x.len() / self.groups) as f64;
        let mut affine = Affine::default();
        for group in 0..self.groups {
            let range = group * width..(group + 1) * width;
            let [mut sum, mut square] = [0.0; 2];
            for [s, q] in parts.iter().flat_map(|part| &part[range.clone()]) {
                sum += s;
                square += q;
            }
            let mean = sum / count;
            let variance = (square / count - mean * mean).max(0.0);
            let factor = 1.0 / (variance + f64::from(self.eps)).sqrt();
            for c in range {
                let scale = f64::from(self.gamma[c]) * factor;
                let rounded = mean as f32;
                let rest = mean - f64::from(rounded);
                affine.mean.push(rounded);
                affine.scale.push(scale as f32);
                affine
                    .shift
                    .push((f64::from(self.beta[c]) - rest * scale) as f32);
            }
        }
        affine
    }
}

/// `(x - mean) · scale + shift` for every channel. `shift` also compensates the rounding of `mean`.
#[derive(Default)]
struct Affine {
    mean: Vec<f32>,
    scale: Vec<f32>,
    shift: Vec<f32>,
}

per_instruction_set! {
    /// Adds every channel's sum and sum of squares over the pixels of `x`.
    fn moments(x: &[f32], sums: &mut [[f64; 2]]) = moments_body
}

#[inline(always)]
fn moments_body<const FMA: bool>(x: &[f32], sums: &mut [[f64; 2]]) {
    // Two cache lines of each pixel at a time.
    const WIDE: usize = 2 * LANES;
    let channels = sums.len();
    for first in (0..channels).step_by(WIDE) {
        let lanes = WIDE.min(channels - first);
        let (mut sum, mut square) = ([0.0_f64; WIDE], [0.0_f64; WIDE]);
        if lanes == WIDE {
            for pixel in x.chunks_exact(channels) {
                let mut v = [0.0_f32; WIDE];
                v.copy_from_slice(&pixel[first..first + WIDE]);
                for l in 0..WIDE {
                    // The square is exact in f64, so a fused multiply-add would give the same
                    // result.
                    let v = f64::from(v[l]);
                    sum[l] += v;
                    square[l] += v * v;
                }
            }
        } else {
            for pixel in x.chunks_exact(channels) {
                for (l, v) in pixel[first..].iter().enumerate() {
                    let v = f64::from(*v);
                    sum[l] += v;
                    square[l] += v * v;
                }
            }
        }
        for l in 0..lanes {
            sums[first + l][0] += sum[l];
            sums[first + l][1] += square[l];
        }
    }
}

per_instruction_set! {
    /// Applies an [`Affine`] to a run of pixels.
    fn apply(x: &[f32], affine: &Affine, rectified: bool, out: &mut [f32]) = apply_body
}

#[inline(always)]
fn apply_body<const FMA: bool>(x: &[f32], affine: &Affine, rectified: bool, out: &mut [f32]) {
    let channels = affine.scale.len();
    let (mean, scale) = (&affine.mean[..channels], &affine.scale[..channels]);
    let shift = &affine.shift[..channels];
    for (x, out) in x.chunks_exact(channels).zip(out.chunks_exact_mut(channels)) {
        for c in 0..channels {
            let v = fma::<FMA>(x[c] - mean[c], scale[c], shift[c]);
            out[c] = if rectified { relu(v) } else { v };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{noise, relative_error, with_threads};

    fn standardised(values: &[f64], eps: f64) -> Vec<f64> {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        values
            .iter()
            .map(|v| (v - mean) / (variance + eps).sqrt())
            .collect()
    }

    #[test]
    fn layer_norm_matches_its_definition_at_every_level() {
        for dim in [1, 7, 16, 96, 1024] {
            let rows = 37;
            let x: Vec<f32> = noise(1, rows * dim)
                .iter()
                .map(|v| v * 3.0 + 10.0)
                .collect();
            let (gamma, beta) = (noise(2, dim), noise(3, dim));
            let exact: Vec<f64> = x
                .chunks_exact(dim)
                .flat_map(|row| {
                    let row: Vec<f64> = row.iter().map(|v| f64::from(*v)).collect();
                    let row = standardised(&row, 1e-6);
                    (0..dim)
                        .map(|c| row[c] * f64::from(gamma[c]) + f64::from(beta[c]))
                        .collect::<Vec<_>>()
                })
                .collect();
            for simd in Simd::available() {
                let mut out = vec![f32::NAN; x.len()];
                layer_norm(simd, &x, &gamma, &beta, 1e-6, &mut out);
                let error = relative_error(&out, &exact);
                assert!(error < 1e-6, "{simd:?} {dim}: {error}");
            }
        }
    }

    #[test]
    fn a_wrong_epsilon_is_visible() {
        let x = [1e-3, -1e-3];
        let mut out = [0.0; 2];
        layer_norm(Simd::detect(), &x, &[1.0; 2], &[0.0; 2], 1e-6, &mut out);
        assert!((out[0] - 0.5_f32.sqrt()).abs() < 1e-6, "{out:?}");
    }

    #[test]
    fn group_norm_matches_its_definition_at_every_level_and_thread_count() {
        for (pixels, channels, groups) in [(5000, 32, 8), (9000, 12, 3), (1, 8, 4), (10, 24, 1)] {
            let x: Vec<f32> = noise(1, pixels * channels)
                .iter()
                .map(|v| v + 5.0)
                .collect();
            let (gamma, beta) = (noise(2, channels), noise(3, channels));
            let width = channels / groups;
            let mut exact = vec![0.0; x.len()];
            for group in 0..groups {
                let places: Vec<usize> = (0..x.len())
                    .filter(|i| i % channels / width == group)
                    .collect();
                let values: Vec<f64> = places.iter().map(|&i| f64::from(x[i])).collect();
                for (i, v) in places.iter().zip(standardised(&values, 1e-5)) {
                    let c = i % channels;
                    exact[*i] = v * f64::from(gamma[c]) + f64::from(beta[c]);
                }
            }
            let norm = GroupNorm::new(groups, &gamma, &beta, 1e-5);
            for simd in Simd::available() {
                let run = |relu, threads| {
                    let mut out = vec![f32::NAN; x.len()];
                    with_threads(threads, || norm.run(simd, &x, relu, &mut out));
                    out
                };
                let plain = run(false, 1);
                let error = relative_error(&plain, &exact);
                assert!(error < 1e-6, "{simd:?} {channels}/{groups}: {error}");
                assert_eq!(plain, run(false, 3));
                let relu: Vec<f32> = plain.iter().map(|v| v.max(0.0)).collect();
                assert_eq!(relu, run(true, 2));
            }
        }
    }
}
