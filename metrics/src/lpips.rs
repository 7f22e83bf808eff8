//! LPIPS, version 0.1 (Zhang et al. 2018): distance between the network features of two pictures.
//!
//! At each position of each tapped layer, both feature vectors are normalised to unit length, and their squared
//! difference is weighted per channel. The mean over positions is the layer's term; the sum of the terms is the
//! distance. Features are f32, everything after them f64.

use std::sync::Arc;

use rayon::prelude::*;

use crate::backbone::{Extractor, Taps};
use crate::maps::TapMap;
use crate::picture::{Mask, Normalization, Picture};
use crate::simd::with_widest_vectors;
use crate::unavailable::Unavailable;

/// Place of ε in the division by a feature vector's length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Epsilon {
    /// `f / (√Σf² + 1e-10)`, as published.
    Outside,
    /// `f / (√Σf² + 1e-8)`, as in ScanNet++'s toolbox.
    LargerOutside,
    /// `f / √(1e-8 + Σf²)`, as in torchmetrics.
    Inside,
}

impl Epsilon {
    fn reciprocal_length(self, squares: f64) -> f64 {
        match self {
            Self::Outside => 1.0 / (squares.sqrt() + 1e-10),
            Self::LargerOutside => 1.0 / (squares.sqrt() + 1e-8),
            Self::Inside => 1.0 / (1e-8 + squares).sqrt(),
        }
    }
}

/// Range of the pictures' values before the network's own normalisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum InputRange {
    /// −1..1, as the network expects.
    Signed,
    /// 0..1, unchanged.
    Unit,
    /// −1..1, passed to the network without its own normalisation: LPIPS v0.0.
    Raw,
}

impl InputRange {
    fn normalization(self) -> Normalization {
        let (stretch, start) = match self {
            Self::Signed => (2.0, -1.0),
            Self::Unit => (1.0, 0.0),
            Self::Raw => return Normalization::new(2.0, -1.0, [0.0; 3], [1.0; 3]),
        };
        Normalization::new(
            stretch,
            start,
            [-0.030, -0.088, -0.188],
            [0.458, 0.448, 0.450],
        )
    }
}

/// An LPIPS distance, split into the terms of its layers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Distance {
    /// The term of each tapped layer; their sum is the distance.
    pub(crate) layers: Vec<f64>,
    /// Local distances of each layer, if requested.
    pub(crate) maps: Vec<TapMap>,
}

/// For each tap of VGG16, the number of positions on each side that the convolutions since the
/// preceding tap depend on: half the side of their receptive field, rounded down.
const VGG_REACH: [usize; 5] = [2, 2, 3, 3, 3];

impl Distance {
    /// Sum over VGG16's layers, where each layer's mean covers only the positions that no pixel outside the mask
    /// influences. Pixels beyond the picture's border count as inside. Requires maps.
    pub(crate) fn inside_layers(&self, mask: &Mask) -> Result<f64, Unavailable> {
        let mut reached = mask.clone();
        let mut distance = 0.0;
        for (map, reach) in self.maps.iter().zip(VGG_REACH) {
            let inside = reached.eroded(reach, true);
            let values = map.values.iter().zip(inside.values());
            let values = values.filter(|(_, inside)| **inside);
            let sum: f64 = values.map(|(value, _)| f64::from(*value)).sum();
            match inside.count() {
                0 => return Err(Unavailable::EmptyMask),
                count => distance += sum / count as f64,
            }
            reached = inside.halved();
        }
        Ok(distance)
    }
}

/// LPIPS with one network.
#[derive(Debug)]
pub(crate) struct Lpips {
    network: Arc<Extractor>,
    /// Weight of each channel, for each tap.
    linear: Vec<Vec<f64>>,
}

impl Lpips {
    /// Creates the metric with one network; `linear` has a list of channel weights for each tap.
    pub(crate) fn new(network: Arc<Extractor>, linear: &[Vec<f32>]) -> Self {
        let widen = |weights: &Vec<f32>| weights.iter().map(|&w| f64::from(w)).collect();
        Self {
            network,
            linear: linear.iter().map(widen).collect(),
        }
    }

    pub(crate) fn network(&self) -> &Arc<Extractor> {
        &self.network
    }

    /// Distances of predictions from their target, with one pass of the network over each picture.
    /// Returns, for each prediction, one distance per element of `epsilons`. The target is the
    /// first of `pictures`, which must all have the same size.
    pub(crate) fn distances(
        &self,
        pictures: &[&Picture],
        range: InputRange,
        epsilons: &[Epsilon],
        with_maps: bool,
        strip: Option<usize>,
    ) -> Result<Vec<Vec<Distance>>, Unavailable> {
        let (width, height) = pictures[0].dimensions();
        let normalization = range.normalization();
        let taps = self.linear.len();
        let nothing = Distance {
            layers: vec![0.0; taps],
            maps: vec![TapMap::default(); if with_maps { taps } else { 0 }],
        };
        let mut distances = vec![vec![nothing; epsilons.len()]; pictures.len() - 1];
        let sizes = self.network.stream(
            (width as usize, height as usize),
            pictures.len(),
            strip,
            |picture, y, out| normalization.row(pictures[picture], y, out),
            |Taps { tap, size, rows }| {
                let mut squares = vec![0.0; rows[0].len() / size.channels];
                rows[0]
                    .par_chunks(size.row_len())
                    .zip(squares.par_chunks_mut(size.width))
                    .for_each(|(row, out)| squared_lengths(row, size.channels, out));
                let target = rows[0]
                    .par_chunks(size.row_len())
                    .zip(squares.par_chunks(size.width));
                for (prediction, distances) in rows[1..].iter().zip(&mut distances) {
                    let pairs = prediction.par_chunks(size.row_len()).zip(target.clone());
                    for (&epsilon, distance) in epsilons.iter().zip(distances) {
                        let rows: Vec<Vec<f64>> = pairs
                            .clone()
                            .map(|(a, (b, squares))| {
                                let mut out = vec![0.0; size.width];
                                let weights = &self.linear[tap];
                                distance_row(a, b, squares, weights, epsilon, &mut out);
                                out
                            })
                            .collect();
                        for row in &rows {
                            distance.layers[tap] += row.iter().sum::<f64>();
                            if let Some(map) = distance.maps.get_mut(tap) {
                                map.values.extend(row.iter().map(|&d| d as f32));
                            }
                        }
                    }
                }
            },
        )?;
        for distance in distances.iter_mut().flatten() {
            for (sum, size) in distance.layers.iter_mut().zip(&sizes) {
                *sum /= size.width as f64 * size.height as f64;
            }
            for (map, size) in distance.maps.iter_mut().zip(&sizes) {
                (map.width, map.height) = (size.width, size.height);
            }
        }
        Ok(distances)
    }
}

/// Squared length of the feature vector at each position of a row.
fn squared_lengths(row: &[f32], channels: usize, out: &mut [f64]) {
    with_widest_vectors!(squared_lengths_body(row, channels, out):
        fn(row: &[f32], channels: usize, out: &mut [f64]));
}

#[inline(always)]
fn squared_lengths_body(row: &[f32], channels: usize, out: &mut [f64]) {
    for (vector, out) in row.chunks_exact(channels).zip(out) {
        *out = squared_length(vector.as_chunks().0);
    }
}

/// Squared length of a feature vector, given in blocks of 8 channels; the number of channels at
/// every tap is a multiple of 64.
#[inline(always)]
fn squared_length(vector: &[[f32; 8]]) -> f64 {
    let mut sum = [0.0_f64; 8];
    for values in vector {
        for i in 0..8 {
            sum[i] += f64::from(values[i]) * f64::from(values[i]);
        }
    }
    sum.iter().sum()
}

/// Weighted squared distance from the target at each position of a row. The target's squared lengths are already known.
fn distance_row(
    a: &[f32],
    target: &[f32],
    squares: &[f64],
    weights: &[f64],
    epsilon: Epsilon,
    out: &mut [f64],
) {
    with_widest_vectors!(distance_row_body(a, target, squares, weights, epsilon, out):
        fn(a: &[f32], target: &[f32], squares: &[f64], weights: &[f64], epsilon: Epsilon, out: &mut [f64]));
}

#[inline(always)]
fn distance_row_body(
    a: &[f32],
    target: &[f32],
    squares: &[f64],
    weights: &[f64],
    epsilon: Epsilon,
    out: &mut [f64],
) {
    let channels = weights.len();
    let (weights, _) = weights.as_chunks::<8>();
    for (((a, b), b_squares), out) in a
        .chunks_exact(channels)
        .zip(target.chunks_exact(channels))
        .zip(squares)
        .zip(out)
    {
        let ((a, _), (b, _)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
        let a_scale = epsilon.reciprocal_length(squared_length(a));
        let b_scale = epsilon.reciprocal_length(*b_squares);
        let mut sum = [0.0_f64; 8];
        for ((a, b), weights) in a.iter().zip(b).zip(weights) {
            for i in 0..8 {
                let d = f64::from(a[i]) * a_scale - f64::from(b[i]) * b_scale;
                sum[i] += weights[i] * (d * d);
            }
        }
        *out = sum.iter().sum();
    }
}
