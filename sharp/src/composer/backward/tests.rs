//! Compares with central differences of the composer in f64, implemented here from its definition.

use super::*;
use crate::composer::compose;
use crate::initializer::{Grid, InvalidDepth};
use crate::random::SplitMix64;

const LAYERS: usize = 2;
const GRID: Grid = Grid {
    layers: LAYERS,
    width: 8,
    height: 6,
    stride: 2,
};
const TOLERANCE: f64 = 1e-5;

/// Depth with one block of the first layer missing.
fn base() -> BaseGaussians {
    let mut random = SplitMix64::new(17);
    let image: Vec<f32> = (0..3 * GRID.pixels())
        .map(|_| random.between(0.0, 1.0) as f32)
        .collect();
    let mut depth: Vec<f32> = (0..LAYERS * GRID.pixels())
        .map(|_| random.between(1.5, 60.0) as f32)
        .collect();
    for pixel in [2, 3, 10, 11] {
        depth[pixel] = 0.0;
    }
    BaseGaussians::new(&image, &depth, GRID, InvalidDepth::Skip).unwrap()
}

fn random(n: usize, size: f64, seed: u64) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    (0..n).map(|_| random.between(-size, size) as f32).collect()
}

fn upstream(n: usize, size: f64) -> Vec<GaussianGradient> {
    let take = |values: &[f32]| GaussianGradient {
        mean: [values[0], values[1], values[2]],
        quaternion: [values[3], values[4], values[5], values[6]],
        scales: [values[7], values[8], values[9]],
        opacity: values[10],
        color: [values[11], values[12], values[13]],
        view_depth: 1e9,
    };
    random(n * 14, size, 5).chunks_exact(14).map(take).collect()
}

/// The inputs that the differences vary: base inverse depth, base scale, global scale, deltas.
type Inputs = [f64; 3 + ATTRIBUTES];

fn inputs(base: &BaseGaussians, deltas: &[f32], k: usize) -> Inputs {
    let n = base.scales.len();
    std::array::from_fn(|i| match i {
        0 => base.inverse_depth[k].into(),
        1 => base.scales[k].into(),
        2 => base.global_scale.into(),
        _ => deltas[(i - 3) * n + k].into(),
    })
}

/// A Gaussian as mean, quaternion, scales, opacity, colour.
fn composed(base: &BaseGaussians, k: usize, inputs: &Inputs) -> [f64; 14] {
    let [inverse, scale, global, delta @ ..] = inputs;
    let blocks = GRID.blocks();
    let at = k % blocks;
    let x = f64::from(base.x[at % GRID.columns()]) + 1e-3 * delta[0];
    let y = f64::from(base.y[at / GRID.columns()]) + 1e-3 * delta[1];
    let refined = (1.0 + (inverse.exp() - 1.0) * (1e-3 * delta[2]).exp()).ln();
    let z = 1.0 / (refined + 1e-3);
    let logistic = |x: f64| 1.0 / (1.0 + (-x).exp());
    let size = |d: f64| {
        let factor = 10.0 * logistic(10.0 * d / 9.0 - 9.0_f64.ln());
        scale * inverse * z * factor * global
    };
    let color = |channel: usize| {
        let start = f64::from(base.colors[channel * blocks + at]).clamp(0.01, 0.99);
        let encoded = logistic((start / (1.0 - start)).ln() + 0.1 * delta[10 + channel]);
        if encoded <= 0.040_45 {
            encoded / 12.92
        } else {
            ((encoded + 0.055) / 1.055).powf(2.4)
        }
    };
    let opacity = f64::from(base.opacity);
    [
        z * x * global,
        z * y * global,
        z * global,
        1.0 + delta[6],
        delta[7],
        delta[8],
        delta[9],
        size(delta[3]),
        size(delta[4]),
        size(delta[5]),
        logistic((opacity / (1.0 - opacity)).ln() + delta[13]),
        color(0),
        color(1),
        color(2),
    ]
}

fn kept(base: &BaseGaussians) -> Vec<usize> {
    let all = 0..base.scales.len();
    all.filter(|&k| base.inverse_depth[k] > 0.0).collect()
}

#[test]
fn the_definition_here_is_the_composers() {
    let base = base();
    let deltas = random(ATTRIBUTES * base.scales.len(), 3.0, 1);
    let out = compose(&base, Some(&deltas)).unwrap();
    for (i, &k) in kept(&base).iter().enumerate() {
        let expected = composed(&base, k, &inputs(&base, &deltas, k));
        let found = [
            &out.means[i][..],
            &out.quaternions[i],
            &out.scales[i],
            &[out.opacities[i]],
            &out.colors[i],
        ]
        .concat();
        for (found, expected) in found.into_iter().zip(expected) {
            let difference = (f64::from(found) - expected).abs();
            assert!(
                difference < 1e-5 * expected.abs().max(0.01),
                "{found} {expected}"
            );
        }
    }
}

#[test]
fn every_gradient_is_that_of_central_differences() {
    let base = base();
    let n = base.scales.len();
    let deltas = random(ATTRIBUTES * n, 3.0, 1);
    let kept = kept(&base);
    let upstream = upstream(kept.len(), 1.0);
    let found = backward(&base, &deltas, &upstream).unwrap();
    let mut global_scale = 0.0;
    for (g, &k) in upstream.iter().zip(&kept) {
        let weights = [
            &g.mean[..],
            &g.quaternion,
            &g.scales,
            &[g.opacity],
            &g.color,
        ]
        .concat();
        let at = inputs(&base, &deltas, k);
        for i in 0..at.len() {
            let h = 1e-4 * at[i].abs().max(if i < 3 { 0.0 } else { 1.0 });
            let loss = |step: f64| -> f64 {
                let mut moved = at;
                moved[i] += step;
                let out = composed(&base, k, &moved);
                out.iter()
                    .zip(&weights)
                    .map(|(v, w)| v * f64::from(*w))
                    .sum()
            };
            // Use Richardson's extrapolation, because the h² error of a plain difference is not
            // small compared with 1e-5.
            let slope = |h: f64| (loss(h) - loss(-h)) / (2.0 * h);
            let expected = (4.0 * slope(h / 2.0) - slope(h)) / 3.0;
            let found = match i {
                0 => found.base.inverse_depth[k],
                1 => found.base.scales[k],
                2 => {
                    global_scale += expected;
                    continue;
                }
                _ => found.deltas[(i - 3) * n + k],
            };
            let difference = (f64::from(found) - expected).abs();
            assert!(
                difference <= TOLERANCE * expected.abs(),
                "{k} {i}: {found} {expected}"
            );
        }
    }
    assert!((found.base.global_scale / global_scale - 1.0).abs() < TOLERANCE);
}

#[test]
fn a_block_without_depth_has_no_gradient() {
    let base = base();
    let n = base.scales.len();
    assert_eq!(base.inverse_depth[1], 0.0);
    let found = backward(&base, &vec![0.0; ATTRIBUTES * n], &upstream(n - 1, 1.0)).unwrap();
    assert_eq!(
        [found.base.inverse_depth[1], found.base.scales[1]],
        [0.0; 2]
    );
    for attribute in 0..ATTRIBUTES {
        assert_eq!(found.deltas[attribute * n + 1], 0.0);
        assert_ne!(found.deltas[attribute * n + 2], 0.0);
    }
}

#[test]
fn hostile_deltas_and_gradients_stay_finite() {
    for depth in [1e-4, 1e6] {
        let image = vec![1.0; 3 * GRID.pixels()];
        let mut depth = vec![depth; LAYERS * GRID.pixels()];
        depth[0] = 1.0;
        let base = BaseGaussians::new(&image, &depth, GRID, InvalidDepth::Refuse).unwrap();
        let n = base.scales.len();
        for delta in [-1e30, -5e4, -50.0, 50.0, 5e4, 1e30] {
            let deltas = vec![delta; ATTRIBUTES * n];
            let found = backward(&base, &deltas, &upstream(n, 1e38)).unwrap();
            let all = [&found.deltas, &found.base.inverse_depth, &found.base.scales];
            assert!(all.into_iter().flatten().all(|v| v.is_finite()), "{delta}");
            assert!(found.base.global_scale.is_finite(), "{delta}");
        }
    }
}

#[test]
fn lengths_that_do_not_fit_are_errors() {
    let base = base();
    let n = base.scales.len();
    let deltas = vec![0.0; ATTRIBUTES * n];
    let found = backward(&base, &deltas, &upstream(n, 1.0));
    let (expected, n) = (n - 1, n);
    let expected = ComposerGradientError::Gradients { expected, found: n };
    assert_eq!(found.unwrap_err(), expected);
    let found = backward(&base, &deltas[1..], &upstream(n - 1, 1.0));
    assert!(matches!(found, Err(ComposerGradientError::Deltas(_))));
}
