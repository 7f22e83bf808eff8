//! Combines base Gaussians and the network's deltas into the predicted Gaussians.
//!
//! Each attribute is refined in the space of an activation function, so that any real delta gives a
//! valid value. The activations are evaluated in f64 and rounded once, because in f32
//! `log(1 − exp(−t))` loses digits exactly where most depths are.

#[cfg(feature = "render")]
mod backward;

#[cfg(feature = "render")]
pub use backward::{ComposerGradient, ComposerGradientError, backward};

use crate::color::linear_from_srgb;
use crate::gaussians::{Gaussians, Harmonics};
use crate::initializer::BaseGaussians;

/// Factor of the deltas of x and y. All factors are those of SHARP's release; attributes without a constant here have
/// the factor 1.
const XY_FACTOR: f32 = 1e-3;
/// Factor of the delta of inverse depth.
const INVERSE_DEPTH_FACTOR: f32 = 1e-3;
/// Factor of the deltas of colour.
const COLOR_FACTOR: f32 = 0.1;
/// Maximum factor by which a delta multiplies the base scale; the minimum is 0.
const MAX_SCALE: f64 = 10.0;
/// Steepness of the logistic curve for scales, chosen so that the curve has slope 1 where its value
/// is 1.
const SCALE_SLOPE: f64 = MAX_SCALE / (MAX_SCALE - 1.0);

/// Number of deltas per Gaussian: x, y, inverse depth; three scales; quaternion w, x, y, z; r, g, b; opacity.
pub const ATTRIBUTES: usize = 14;

/// The number of deltas does not match the base Gaussians.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{found} deltas instead of {expected}, {ATTRIBUTES} for each base Gaussian")]
pub struct DeltaLength {
    /// Expected number of deltas, `ATTRIBUTES · layers · rows · columns`.
    pub expected: usize,
    pub found: usize,
}

/// Refines base Gaussians with `deltas` (`[14, layers, rows, columns]`; `None` means zeros).
///
/// Gaussians are ordered by layer, then row by row; blocks without valid depth are omitted. Means and scales are
/// normalised in x and y (x/z and y/z over [−1, 1] across the image) and metric in z; colours are linear RGB.
/// Quaternions are not normalised. With zero deltas, a Gaussian is not exactly at its base depth: z is `1 / (inverse +
/// 1e-3)`, as in the SHARP release.
///
/// # Errors
/// [`DeltaLength`] if the number of deltas does not match the base Gaussians.
pub fn compose(base: &BaseGaussians, deltas: Option<&[f32]>) -> Result<Gaussians, DeltaLength> {
    let (blocks, columns) = (base.grid.blocks(), base.grid.columns());
    let per_attribute = base.grid.layers * blocks;
    if let Some(deltas) = deltas {
        check_deltas(base, deltas)?;
    }
    let opacity_logit = logit(f64::from(base.opacity));
    let n = per_attribute - base.dropped();
    let mut out = Gaussians {
        means: Vec::with_capacity(n),
        quaternions: Vec::with_capacity(n),
        scales: Vec::with_capacity(n),
        opacities: Vec::with_capacity(n),
        colors: Vec::with_capacity(n),
        harmonics: Harmonics::default(),
    };
    for k in 0..per_attribute {
        let inverse = base.inverse_depth[k];
        if inverse == 0.0 {
            continue;
        }
        let delta = |attribute: usize| deltas.map_or(0.0, |d| d[attribute * per_attribute + k]);
        let (row, column) = (k % blocks / columns, k % columns);
        let x = base.x[column] + XY_FACTOR * delta(0);
        let y = base.y[row] + XY_FACTOR * delta(1);
        let refined = softplus(
            inverse_softplus(f64::from(inverse)) + f64::from(INVERSE_DEPTH_FACTOR * delta(2)),
        ) as f32;
        let z = 1.0 / (refined + 1e-3);
        out.means
            .push([z * x, z * y, z].map(|v| v * base.global_scale));
        let size = base.scales[k] * inverse * z;
        out.scales
            .push([3, 4, 5].map(|a| size * scale_factor(delta(a)) * base.global_scale));
        out.quaternions
            .push([1.0 + delta(6), delta(7), delta(8), delta(9)]);
        out.colors.push([0, 1, 2].map(|channel| {
            let start = f64::from(base.colors[channel * blocks + k % blocks].clamp(0.01, 0.99));
            let step = f64::from(COLOR_FACTOR * delta(10 + channel));
            linear_from_srgb(sigmoid(logit(start) + step) as f32)
        }));
        let step = f64::from(delta(13));
        out.opacities.push(sigmoid(opacity_logit + step) as f32);
    }
    Ok(out)
}

fn check_deltas(base: &BaseGaussians, deltas: &[f32]) -> Result<(), DeltaLength> {
    let expected = ATTRIBUTES * base.grid.layers * base.grid.blocks();
    let found = deltas.len();
    if found == expected {
        return Ok(());
    }
    Err(DeltaLength { expected, found })
}

/// Factor on the base scale, given the delta of the scale: a logistic curve between 0 and [`MAX_SCALE`] with value 1
/// and slope 1 at a delta of 0.
fn scale_factor(delta: f32) -> f32 {
    (MAX_SCALE * sigmoid(scale_logit(f64::from(delta)))) as f32
}

fn scale_logit(delta: f64) -> f64 {
    SCALE_SLOPE * delta + logit(1.0 / MAX_SCALE)
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

fn logit(p: f64) -> f64 {
    (p / (1.0 - p)).ln()
}

fn softplus(x: f64) -> f64 {
    // The SHARP release defines softplus as the identity above 20.
    if x > 20.0 { x } else { x.exp().ln_1p() }
}

/// `softplus⁻¹(max(t, 1e-6))`.
fn inverse_softplus(t: f64) -> f64 {
    let t = t.max(1e-6);
    t + (-(-t).exp_m1()).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::initializer::{Grid, InvalidDepth};

    fn base(depth: [f32; 2], colors: [f32; 2]) -> BaseGaussians {
        let grid = Grid {
            layers: 1,
            width: 2,
            height: 1,
            stride: 1,
        };
        let image: Vec<f32> = colors.repeat(3);
        BaseGaussians::new(&image, &depth, grid, InvalidDepth::Skip).unwrap()
    }

    #[test]
    fn zero_deltas_keep_the_base_but_for_the_releases_depth_offset() {
        let base = base([2.0, 8.0], [0.5, 0.25]);
        let out = compose(&base, None).unwrap();
        let zeros = vec![0.0; ATTRIBUTES * 2];
        assert_eq!(out, compose(&base, Some(&zeros)).unwrap());
        // Normalised depths are 1 and 4, up to the 1e-6 of the normalisation.
        for (k, depth) in [(0, 1.0_f32), (1, 4.0)] {
            let z = 2.0 / (1.0 / depth + 1e-3);
            assert!((out.means[k][2] / z - 1.0).abs() < 2e-6, "{:?}", out.means);
            assert!((out.means[k][0] - out.means[k][2] * base.x[k]).abs() < 1e-6);
            assert!((out.scales[k][0] / z - 1.0).abs() < 2e-6);
            assert_eq!(out.quaternions[k], [1.0, 0.0, 0.0, 0.0]);
        }
        assert!((out.opacities[0] - 0.5).abs() < 1e-7);
        assert!((out.colors[0][0] - linear_from_srgb(0.5)).abs() < 1e-7);
    }

    #[test]
    fn colours_start_inside_the_clamp() {
        let out = compose(&base([1.0, 1.0], [0.0, 1.0]), None).unwrap();
        assert!((out.colors[0][1] - linear_from_srgb(0.01)).abs() < 1e-8);
        assert!((out.colors[1][1] - linear_from_srgb(0.99)).abs() < 1e-6);
    }

    #[test]
    fn inverse_softplus_is_clamped_and_inverts() {
        assert_eq!(inverse_softplus(0.0), inverse_softplus(1e-6));
        assert_eq!(inverse_softplus(-3.0), inverse_softplus(1e-6));
        for t in [1e-6, 0.01, 0.3, 1.0, 19.0, 40.0] {
            let there_and_back = softplus(inverse_softplus(t));
            assert!((there_and_back / t - 1.0).abs() < 1e-9, "{t}");
        }
    }

    #[test]
    fn scales_stay_between_their_bounds_with_slope_one_at_zero() {
        assert!((scale_factor(0.0) - 1.0).abs() < 1e-7);
        assert!((scale_factor(0.01) - scale_factor(-0.01) - 0.02).abs() < 1e-5);
        assert_eq!(scale_factor(-1e4), 0.0);
        assert_eq!(scale_factor(1e4), 10.0);
    }

    #[test]
    fn deltas_act_on_their_own_attribute() {
        let base = base([1.0, 1.0], [0.5, 0.5]);
        let mut deltas = vec![0.0; ATTRIBUTES * 2];
        for attribute in 0..ATTRIBUTES {
            deltas[attribute * 2 + 1] = 1.0 + attribute as f32;
        }
        let out = compose(&base, Some(&deltas)).unwrap();
        let plain = compose(&base, None).unwrap();
        assert_eq!(out.means[0], plain.means[0]);
        let z = out.means[1][2];
        assert!((out.means[1][0] / z - (base.x[1] + 1e-3)).abs() < 1e-6);
        assert!((out.means[1][1] / z - (base.y[0] + 2e-3)).abs() < 1e-6);
        assert!(z < plain.means[1][2]);
        assert_eq!(out.quaternions[1], [8.0, 8.0, 9.0, 10.0]);
        assert!((out.opacities[1] - sigmoid(logit(0.5) + 14.0) as f32).abs() < 1e-6);
        assert!(out.colors[1][2] > out.colors[1][0]);
        assert!(out.scales[1][2] > out.scales[1][0]);
    }

    #[test]
    fn blocks_without_depth_are_left_out_and_deltas_keep_their_place() {
        let base = base([0.0, 3.0], [0.5, 0.25]);
        let mut deltas = vec![0.0; ATTRIBUTES * 2];
        deltas[7 * 2 + 1] = 0.5;
        let out = compose(&base, Some(&deltas)).unwrap();
        assert_eq!(out.len(), 1);
        assert_eq!(out.quaternions, [[1.0, 0.5, 0.0, 0.0]]);
        assert!(out.means[0][0] > 0.0);
    }

    #[test]
    fn deltas_of_another_grid_are_an_error() {
        let found = compose(&base([1.0, 1.0], [0.5, 0.5]), Some(&[0.0; 27]));
        assert_eq!(
            found.unwrap_err(),
            DeltaLength {
                expected: 28,
                found: 27
            }
        );
    }
}
