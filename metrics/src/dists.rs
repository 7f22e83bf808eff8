//! DISTS (Ding et al. 2020): compares channel means (structure) and covariances (texture) of
//! features.
//!
//! There are six taps: the picture itself and five VGG16 layers with L2 pooling. Features are f32.
//! Means, variances and covariances are computed from f64 sums over the picture: in f32 the
//! covariance, a difference of nearly equal numbers, would be wrong in the third digit.

use std::sync::Arc;

use rayon::prelude::*;

use crate::backbone::{Extractor, Taps};
use crate::picture::{Normalization, Picture};
use crate::simd::with_widest_vectors;
use crate::unavailable::Unavailable;

/// Number of taps: the picture and five layers.
pub(crate) const TAPS: usize = 6;

/// A DISTS score, `1 − Σ structure − Σ texture`, as the terms of both sums.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Similarity {
    /// Weighted similarity of means at each tap.
    pub(crate) structure: [f64; TAPS],
    /// Weighted similarity of covariances at each tap.
    pub(crate) texture: [f64; TAPS],
}

impl Similarity {
    /// The score; may be slightly negative for identical pictures.
    pub(crate) fn score(&self) -> f64 {
        1.0 - (self.structure.iter().sum::<f64>() + self.texture.iter().sum::<f64>())
    }
}

#[derive(Debug)]
pub(crate) struct Dists {
    network: Arc<Extractor>,
    /// Weights of the structure terms, for the channels of all taps; `alpha` and `beta` together sum to 1.
    alpha: Vec<f64>,
    /// Weights of the texture terms, for the channels of all taps.
    beta: Vec<f64>,
}

/// Number of sums per channel over the pixels: a, b, a², b², a b, in this order.
const MOMENTS: usize = 5;

impl Dists {
    /// Creates the metric. `network` is VGG16 with L2 pooling; `alpha` and `beta` have one weight for each of the 1475
    /// channels of all taps.
    pub(crate) fn new(network: Arc<Extractor>, alpha: &[f32], beta: &[f32]) -> Self {
        let all = alpha.iter().chain(beta);
        let sum: f64 = all.map(|&w| f64::from(w)).sum();
        let share = |weights: &[f32]| weights.iter().map(|&w| f64::from(w) / sum).collect();
        Self {
            network,
            alpha: share(alpha),
            beta: share(beta),
        }
    }

    pub(crate) fn network(&self) -> &Extractor {
        &self.network
    }

    /// Compares predictions with their target at full resolution, with one pass of the network over each picture. The
    /// target is the first of `pictures`, which must all have the same size.
    pub(crate) fn compare(
        &self,
        pictures: &[&Picture],
        strip: Option<usize>,
    ) -> Result<Vec<Similarity>, Unavailable> {
        let (width, height) = pictures[0].dimensions();
        let normalization =
            Normalization::new(1.0, 0.0, [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]);
        let mut moments: Vec<[Vec<f64>; TAPS]> = pictures[1..]
            .iter()
            .map(|prediction| {
                let mut taps: [Vec<f64>; TAPS] = Default::default();
                taps[0] = picture_moments([prediction, pictures[0]]);
                taps
            })
            .collect();
        let mut pixels = [f64::from(width) * f64::from(height); TAPS];
        self.network.stream(
            (width as usize, height as usize),
            pictures.len(),
            strip,
            |picture, y, out| normalization.row(pictures[picture], y, out),
            |Taps { tap, size, rows }| {
                pixels[tap + 1] = size.width as f64 * size.height as f64;
                let target = rows[0].par_chunks(size.row_len());
                for (prediction, moments) in rows[1..].iter().zip(&mut moments) {
                    let sums = &mut moments[tap + 1];
                    sums.resize(MOMENTS * size.channels, 0.0);
                    let rows: Vec<Vec<f64>> = prediction
                        .par_chunks(size.row_len())
                        .zip(target.clone())
                        .map(|(a, b)| {
                            let mut sums = vec![0.0; MOMENTS * size.channels];
                            add_moments(a, b, &mut sums);
                            sums
                        })
                        .collect();
                    for row in rows {
                        add(sums, &row);
                    }
                }
            },
        )?;
        let similarities = moments.iter().map(|taps| self.similarity(taps, &pixels));
        Ok(similarities.collect())
    }

    fn similarity(&self, moments: &[Vec<f64>], pixels: &[f64]) -> Similarity {
        let mut similarity = Similarity {
            structure: [0.0; TAPS],
            texture: [0.0; TAPS],
        };
        let mut weights = self.alpha.iter().zip(&self.beta);
        for (tap, (sums, pixels)) in moments.iter().zip(pixels).enumerate() {
            let channels = sums.len() / MOMENTS;
            for (c, (alpha, beta)) in weights.by_ref().take(channels).enumerate() {
                let mean = |moment: usize| sums[moment * channels + c] / pixels;
                let (a, b) = (mean(0), mean(1));
                let (aa, bb) = (mean(2) - a * a, mean(3) - b * b);
                let ab = mean(4) - a * b;
                similarity.structure[tap] += alpha * (2.0 * a * b + C) / (a * a + b * b + C);
                similarity.texture[tap] += beta * (2.0 * ab + C) / (aa + bb + C);
            }
        }
        similarity
    }
}

/// Constant added to numerator and denominator of each similarity, so that two near-zero moments
/// count as equal.
const C: f64 = 1e-6;

/// Moments of the pictures' own values, in 0..1.
fn picture_moments([a, b]: [&Picture; 2]) -> Vec<f64> {
    let (width, height) = a.dimensions();
    let rows: Vec<[f64; 3 * MOMENTS]> = (0..height as usize)
        .into_par_iter()
        .map_init(
            || [0, 1].map(|_| vec![0.0; 3 * width as usize]),
            |[row_a, row_b], y| {
                a.row_f64(0, y, row_a);
                b.row_f64(0, y, row_b);
                let mut sums = [0.0; 3 * MOMENTS];
                for (i, (a, b)) in row_a.iter().zip(row_b.iter()).enumerate() {
                    for (m, value) in [*a, *b, a * a, b * b, a * b].into_iter().enumerate() {
                        sums[3 * m + i % 3] += value;
                    }
                }
                sums
            },
        )
        .collect();
    let mut sums = vec![0.0; 3 * MOMENTS];
    for row in rows {
        add(&mut sums, &row);
    }
    sums
}

fn add(sums: &mut [f64], more: &[f64]) {
    for (sum, more) in sums.iter_mut().zip(more) {
        *sum += more;
    }
}

/// Adds a row's moments to `sums`.
fn add_moments(a: &[f32], b: &[f32], sums: &mut [f64]) {
    with_widest_vectors!(add_moments_body(a, b, sums):
        fn(a: &[f32], b: &[f32], sums: &mut [f64]));
}

#[inline(always)]
fn add_moments_body(a: &[f32], b: &[f32], sums: &mut [f64]) {
    let channels = sums.len() / MOMENTS;
    let (sum_a, rest) = sums.split_at_mut(channels);
    let (sum_b, rest) = rest.split_at_mut(channels);
    let (sum_aa, rest) = rest.split_at_mut(channels);
    let (sum_bb, sum_ab) = rest.split_at_mut(channels);
    for (a, b) in a.chunks_exact(channels).zip(b.chunks_exact(channels)) {
        for c in 0..channels {
            let (a, b) = (f64::from(a[c]), f64::from(b[c]));
            sum_a[c] += a;
            sum_b[c] += b;
            sum_aa[c] += a * a;
            sum_bb[c] += b * b;
            sum_ab[c] += a * b;
        }
    }
}
