//! The two terms of the perceptual loss at one layer, with their gradient.

use super::super::sum_over;
use std::borrow::Cow;

use rayon::prelude::*;
use sharp_kernels::{Epilogue, PackedMatrix, Simd, matmul};

/// Weights of the two terms.
pub(super) struct Terms<'a> {
    pub(super) features: f64,
    pub(super) gram: f64,
    pub(super) gram_per_pixel: bool,
    /// Weight of each pixel, by which its features are multiplied before they are compared.
    pub(super) weight: Option<&'a [f32]>,
}

impl Terms<'_> {
    /// The value and the gradient with respect to F̂ of `k ‖F̂ − F‖²/(D·H·W) + j ‖M̂ − M‖²/D²`, for F of `H·W` rows and
    /// D columns. M is `Fᵀ F`, divided by `H·W` if `gram_per_pixel` is set.
    pub(super) fn compare(
        &self,
        [predicted, target]: [&[f32]; 2],
        channels: usize,
    ) -> (f64, Vec<f32>) {
        let [x, y] = [predicted, target].map(|map| self.weighted(map.into(), channels));
        let pixels = x.len() / channels;
        let share = self.features / x.len() as f64;
        let features = sum_over(x.len(), |i| {
            let d = f64::from(x[i]) - f64::from(y[i]);
            (d * d * share, (2.0 * d * share) as f32)
        });
        let (mut value, mut gradient) = (features.value, features.gradient);
        if self.gram != 0.0 {
            let share = self.gram / (channels * channels) as f64;
            let divisor = if self.gram_per_pixel {
                pixels as f64
            } else {
                1.0
            };
            let difference = {
                let [x, y] = [&x, &y].map(|map| gram(map, channels));
                sum_over(x.len(), |i| {
                    let d = (f64::from(x[i]) - f64::from(y[i])) / divisor;
                    (d * d * share, (4.0 * d * share / divisor) as f32)
                })
            };
            value += difference.value;
            let simd = Simd::detect();
            let symmetric = &difference.gradient;
            let matrix = PackedMatrix::from_out_in(simd, symmetric, None, channels, channels);
            matmul(&x, &matrix, &mut gradient, pixels, Epilogue::Add);
        }
        (value, self.weighted(gradient.into(), channels).into_owned())
    }

    fn weighted<'m>(&self, mut map: Cow<'m, [f32]>, channels: usize) -> Cow<'m, [f32]> {
        if let Some(weight) = self.weight {
            let pixels = map.to_mut().chunks_exact_mut(channels).zip(weight);
            pixels.for_each(|(pixel, weight)| pixel.iter_mut().for_each(|v| *v *= weight));
        }
        map
    }
}

/// `Fᵀ F`, without normalisation.
fn gram(map: &[f32], channels: usize) -> Vec<f32> {
    /// Channels that a task transposes at once: one cache line.
    const LINE: usize = 16;
    let pixels = map.len() / channels;
    let mut transposed = vec![0.0; map.len()];
    let lines = transposed.par_chunks_mut(LINE * pixels).enumerate();
    lines.for_each(|(line, out)| {
        for (p, pixel) in map.chunks_exact(channels).enumerate() {
            for (row, v) in out.chunks_exact_mut(pixels).zip(&pixel[line * LINE..]) {
                row[p] = *v;
            }
        }
    });
    let mut out = vec![0.0; channels * channels];
    let columns = PackedMatrix::from_out_in(Simd::detect(), &transposed, None, channels, pixels);
    matmul(&transposed, &columns, &mut out, channels, Epilogue::None);
    out
}
