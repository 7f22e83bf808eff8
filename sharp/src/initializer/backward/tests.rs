//! Compares with central differences of the initializer in f64, implemented here from its
//! definition.

use super::*;
use crate::initializer::{BaseGaussians, InvalidDepth};
use crate::random::SplitMix64;

const GRID: Grid = Grid {
    layers: 2,
    width: 6,
    height: 4,
    stride: 2,
};

fn random(n: usize, seed: u64) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    (0..n).map(|_| random.between(-1.0, 1.0) as f32).collect()
}

fn upstream(grid: Grid) -> (BaseGradient, Vec<f32>) {
    let blocks = grid.layers * grid.blocks();
    let base = BaseGradient {
        inverse_depth: random(blocks, 1),
        scales: random(blocks, 2),
        global_scale: 0.7,
    };
    (base, random(grid.layers * grid.pixels(), 3))
}

fn gradient(depth: &[f32], grid: Grid, invalid: InvalidDepth) -> Vec<f32> {
    let normalized = NormalizedDepth::new(depth, invalid).unwrap();
    let (base, features) = upstream(grid);
    backward(depth, &normalized, grid, &base, &features).unwrap()
}

/// Pooled inverse depth, scales, global scale, inverse-depth planes of the feature input.
fn forward(depth: &[f64]) -> (Vec<f64>, Vec<f64>, f64, Vec<f64>) {
    let nearest = depth.iter().copied().fold(f64::INFINITY, f64::min);
    let factor = 1.0 / (nearest + 1e-6);
    let inverse: Vec<f64> = depth
        .iter()
        .map(|d| 1.0 / (d * factor).min(100.0))
        .collect();
    let mut pooled = Vec::new();
    for row in 0..GRID.layers * GRID.rows() {
        for column in 0..GRID.columns() {
            let corner = 2 * row * GRID.width + 2 * column;
            let block = [
                corner,
                corner + 1,
                corner + GRID.width,
                corner + GRID.width + 1,
            ];
            pooled.push(
                block
                    .map(|pixel| inverse[pixel])
                    .into_iter()
                    .fold(0.0, f64::max),
            );
        }
    }
    let size = 2.0 * 2.0 / GRID.width as f64;
    let scales = pooled.iter().map(|inverse| size / inverse).collect();
    let features = inverse.iter().map(|inverse| 2.0 * inverse - 1.0).collect();
    (pooled, scales, 1.0 / factor, features)
}

fn loss(depth: &[f64]) -> f64 {
    let (base, planes) = upstream(GRID);
    let (pooled, scales, global_scale, features) = forward(depth);
    let dot = |values: &[f64], weights: &[f32]| -> f64 {
        let pairs = values.iter().zip(weights);
        pairs.map(|(v, w)| v * f64::from(*w)).sum()
    };
    dot(&pooled, &base.inverse_depth)
        + dot(&scales, &base.scales)
        + global_scale * base.global_scale
        + dot(&features, &planes)
}

/// Random depth, metres; some pixels, and one whole block, are beyond the clamp.
fn depth() -> Vec<f32> {
    let mut random = SplitMix64::new(9);
    let mut depth: Vec<f32> = (0..GRID.layers * GRID.pixels())
        .map(|_| random.between(1.2, 9.0) as f32)
        .collect();
    depth[20] = 0.5;
    for pixel in [3, 24, 25, 30, 31] {
        depth[pixel] = 80.0 + pixel as f32;
    }
    depth
}

#[test]
fn the_definition_here_is_the_initializers() {
    let depth = depth();
    let image = vec![0.5; 3 * GRID.pixels()];
    let base = BaseGaussians::new(&image, &depth, GRID, InvalidDepth::Refuse).unwrap();
    let normalized = NormalizedDepth::new(&depth, InvalidDepth::Refuse).unwrap();
    let wide: Vec<f64> = depth.iter().map(|&d| d.into()).collect();
    let (pooled, scales, global_scale, features) = forward(&wide);
    let close = |found: &[f32], expected: &[f64]| {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < 1e-6 * expected.abs().max(1.0));
        }
    };
    close(&base.inverse_depth, &pooled);
    close(&base.scales, &scales);
    close(&[base.global_scale], &[global_scale]);
    close(
        &normalized.feature_input(&image)[3 * GRID.pixels()..],
        &features,
    );
}

#[test]
fn every_gradient_is_that_of_central_differences() {
    let depth = depth();
    let found = gradient(&depth, GRID, InvalidDepth::Refuse);
    let wide: Vec<f64> = depth.iter().map(|&d| d.into()).collect();
    for pixel in 0..depth.len() {
        let h = 1e-4 * wide[pixel];
        let slope = |h: f64| {
            let moved = |step: f64| {
                let mut moved = wide.clone();
                moved[pixel] += step;
                loss(&moved)
            };
            (moved(h) - moved(-h)) / (2.0 * h)
        };
        let expected = (4.0 * slope(h / 2.0) - slope(h)) / 3.0;
        let difference = (f64::from(found[pixel]) - expected).abs();
        assert!(
            difference <= 1e-5 * expected.abs(),
            "{pixel}: {} {expected}",
            found[pixel]
        );
    }
    assert_eq!([found[3], found[24], found[31]], [0.0; 3]);
}

/// One layer of one block of 2 × 2.
const BLOCK: Grid = Grid {
    layers: 1,
    width: 2,
    height: 2,
    stride: 2,
};

fn block_gradient(depth: [f32; 4], global_scale: f64, invalid: InvalidDepth) -> Vec<f32> {
    let normalized = NormalizedDepth::new(&depth, invalid).unwrap();
    let base = BaseGradient {
        inverse_depth: vec![if global_scale == 0.0 { 1.0 } else { 0.0 }],
        scales: vec![0.0],
        global_scale,
    };
    backward(&depth, &normalized, BLOCK, &base, &[0.0; 4]).unwrap()
}

#[test]
fn ties_of_the_global_minimum_are_split_and_a_blocks_go_to_the_first() {
    let depth = [3.0, 2.0, 2.0, 2.0];
    let third = 1.0_f32 / 3.0;
    let found = block_gradient(depth, 1.0, InvalidDepth::Refuse);
    assert_eq!(found, [0.0, third, third, third]);
    // Pooled inverse depth is (m + 1e-6) / m. The first pixel gets -(m + 1e-6) / m²; the minimum
    // returns 1 / m, a third to each pixel.
    let found = block_gradient(depth, 0.0, InvalidDepth::Refuse);
    for (found, expected) in found
        .iter()
        .zip([0.0, -0.5 + 0.5 / 3.0, 0.5 / 3.0, 0.5 / 3.0])
    {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

#[test]
fn invalid_depth_has_no_gradient() {
    let depth = [0.0, f32::NAN, 4.0, f32::INFINITY];
    let found = block_gradient(depth, 2.0, InvalidDepth::Skip);
    assert_eq!(found, [0.0, 0.0, 2.0, 0.0]);
}

#[test]
fn hostile_depth_stays_finite() {
    let n = GRID.layers * GRID.pixels();
    for (near, far) in [(1e-4, 1e6), (1e-30, 1e30), (1e6, 1e6), (1e-4, 1e-4)] {
        let depth: Vec<f32> = (0..n)
            .map(|k| if k % 5 == 1 { near } else { far })
            .collect();
        let found = gradient(&depth, GRID, InvalidDepth::Refuse);
        assert!(found.iter().all(|v| v.is_finite()), "{near} {far}");
    }
}

#[test]
fn lengths_that_do_not_fit_are_errors() {
    let depth = depth();
    let normalized = NormalizedDepth::new(&depth, InvalidDepth::Refuse).unwrap();
    let (base, features) = upstream(GRID);
    let found = backward(&depth, &normalized, GRID, &base, &features[1..]);
    let what = "gradient of features";
    let (expected, n) = (features.len(), features.len() - 1);
    let expected = InitializerError::Length {
        what,
        expected,
        found: n,
    };
    assert_eq!(found.unwrap_err(), expected);
}
