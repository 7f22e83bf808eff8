//! The two terms of the perceptual loss at one layer, with their gradient.

use super::super::sum_over;
use super::conv::FeatureMap;
use rayon::prelude::*;
use sharp_kernels::{Epilogue, PackedMatrix, Simd, matmul};

/// Weights of the terms.
pub(super) struct Terms<'a> {
    pub(super) features: f64,
    pub(super) gram: f64,
    /// By which the features of each pixel are multiplied first.
    pub(super) weight: Option<&'a [f32]>,
}

impl Terms<'_> {
    /// `k ‖F̂ − F‖²/(D·H·W) + j ‖M̂ − M‖²/D²` with `M = Fᵀ F/(H·W)` for F of `H·W` rows and D columns,
    /// and its gradient with respect to F̂.
    pub(super) fn compare(&self, predicted: &FeatureMap, target: &FeatureMap) -> (f64, FeatureMap) {
        let (x, y) = (self.weighted(predicted), self.weighted(target));
        let (x, y) = (
            x.as_ref().unwrap_or(predicted),
            y.as_ref().unwrap_or(target),
        );
        let (channels, pixels) = (x.channels, x.height * x.width);
        let share = self.features / x.data.len() as f64;
        let features = sum_over(x.data.len(), |i| {
            let d = f64::from(x.data[i]) - f64::from(y.data[i]);
            (d * d * share, (2.0 * d * share) as f32)
        });
        let (mut value, mut gradient) = (features.value, features.gradient);
        if self.gram != 0.0 {
            let share = self.gram / (channels * channels) as f64;
            let difference = {
                let (x, y) = (gram(x), gram(y));
                sum_over(x.len(), |i| {
                    let d = (f64::from(x[i]) - f64::from(y[i])) / pixels as f64;
                    (d * d * share, (4.0 * d * share / pixels as f64) as f32)
                })
            };
            value += difference.value;
            let simd = Simd::detect();
            let symmetric = &difference.gradient;
            let matrix = PackedMatrix::from_out_in(simd, symmetric, None, channels, channels);
            matmul(&x.data, &matrix, &mut gradient, pixels, Epilogue::Add);
        }
        let mut gradient = FeatureMap {
            data: gradient,
            ..*predicted
        };
        if let Some(weighted) = self.weighted(&gradient) {
            gradient = weighted;
        }
        (value, gradient)
    }

    fn weighted(&self, map: &FeatureMap) -> Option<FeatureMap> {
        let weight = self.weight?;
        let mut map = map.clone();
        let pixels = map.data.chunks_exact_mut(map.channels).zip(weight);
        pixels.for_each(|(pixel, weight)| pixel.iter_mut().for_each(|v| *v *= weight));
        Some(map)
    }
}

/// `Fᵀ F`, not divided.
fn gram(map: &FeatureMap) -> Vec<f32> {
    /// Channels that a task transposes at once: a line of the cache.
    const LINE: usize = 16;
    let (channels, pixels) = (map.channels, map.height * map.width);
    let mut transposed = vec![0.0; map.data.len()];
    let lines = transposed.par_chunks_mut(LINE * pixels).enumerate();
    lines.for_each(|(line, out)| {
        for (p, pixel) in map.data.chunks_exact(channels).enumerate() {
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
