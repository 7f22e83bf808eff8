//! Derivative of [`compose`](super::compose) with respect to deltas and base Gaussians.

use super::{
    ATTRIBUTES, COLOR_FACTOR, DeltaLength, INVERSE_DEPTH_FACTOR, MAX_SCALE, SCALE_SLOPE, XY_FACTOR,
    check_deltas, inverse_softplus, logit, scale_logit, sigmoid, softplus,
};
use crate::color::linear_from_srgb_slope;
use crate::initializer::{BaseGaussians, BaseGradient};
use crate::render::{GaussianGradient, narrow};

/// Gradient of a loss with respect to the inputs of [`compose`](super::compose). The base's colours (from the picture)
/// and opacity (a constant) have no gradient.
#[derive(Debug, Clone, PartialEq)]
pub struct ComposerGradient {
    /// `[14, layers, rows, columns]`; zero for omitted blocks.
    pub deltas: Vec<f32>,
    /// Gradient of the base Gaussians; zero for omitted blocks.
    pub base: BaseGradient,
}

/// Errors of [`backward`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ComposerGradientError {
    #[error(transparent)]
    Deltas(#[from] DeltaLength),
    #[error("{found} gradients for {expected} composed Gaussians")]
    Gradients { expected: usize, found: usize },
}

/// Computes the gradient with respect to deltas and base Gaussians from `gaussians`, the gradient with respect to the
/// composed Gaussians (in their order, in the composer's space). `view_depth` is ignored, because the gradient of the
/// mean already includes it.
///
/// The gradient is the derivative of the forward definition in real numbers, computed in f64;
/// values out of the range of f32 saturate.
///
/// # Errors
/// [`ComposerGradientError`] if lengths do not match `base`.
pub fn backward(
    base: &BaseGaussians,
    deltas: &[f32],
    gaussians: &[GaussianGradient],
) -> Result<ComposerGradient, ComposerGradientError> {
    check_deltas(base, deltas)?;
    let (blocks, columns) = (base.grid.blocks(), base.grid.columns());
    let per_attribute = base.grid.layers * blocks;
    let expected = per_attribute - base.dropped();
    if gaussians.len() != expected {
        return Err(ComposerGradientError::Gradients {
            expected,
            found: gaussians.len(),
        });
    }
    let mut out = ComposerGradient {
        deltas: vec![0.0; ATTRIBUTES * per_attribute],
        base: BaseGradient {
            inverse_depth: vec![0.0; per_attribute],
            scales: vec![0.0; per_attribute],
            global_scale: 0.0,
        },
    };
    let kept = (0..per_attribute).filter(|&k| base.inverse_depth[k] != 0.0);
    for (k, gradient) in kept.zip(gaussians) {
        let block = Block {
            x: base.x[k % columns].into(),
            y: base.y[k % blocks / columns].into(),
            inverse: base.inverse_depth[k].into(),
            scale: base.scales[k].into(),
            global_scale: base.global_scale.into(),
            colors: [0, 1, 2].map(|channel| base.colors[channel * blocks + k % blocks].into()),
            opacity: base.opacity.into(),
            deltas: std::array::from_fn(|attribute| deltas[attribute * per_attribute + k].into()),
        };
        let pulled = block.pull(gradient);
        for (attribute, value) in pulled.deltas.into_iter().enumerate() {
            out.deltas[attribute * per_attribute + k] = narrow(value);
        }
        out.base.inverse_depth[k] = narrow(pulled.inverse);
        out.base.scales[k] = narrow(pulled.scale);
        out.base.global_scale += pulled.global_scale;
    }
    Ok(out)
}

/// Inputs of the composer for a single Gaussian.
struct Block {
    x: f64,
    y: f64,
    inverse: f64,
    scale: f64,
    global_scale: f64,
    colors: [f64; 3],
    opacity: f64,
    deltas: [f64; ATTRIBUTES],
}

struct BlockGradient {
    deltas: [f64; ATTRIBUTES],
    inverse: f64,
    scale: f64,
    global_scale: f64,
}

impl Block {
    fn pull(&self, gradient: &GaussianGradient) -> BlockGradient {
        let mut deltas = [0.0; ATTRIBUTES];
        let logit_depth =
            inverse_softplus(self.inverse) + f64::from(INVERSE_DEPTH_FACTOR) * self.deltas[2];
        let z = 1.0 / (softplus(logit_depth) + 1e-3);
        let direction = [
            self.x + f64::from(XY_FACTOR) * self.deltas[0],
            self.y + f64::from(XY_FACTOR) * self.deltas[1],
            1.0,
        ];
        // Gradients with respect to the mean and the scales before multiplication by `global_scale`.
        let mean = gradient.mean.map(|g| f64::from(g) * self.global_scale);
        let scales = gradient.scales.map(|g| f64::from(g) * self.global_scale);

        let mut of_z: f64 = (0..3).map(|c| mean[c] * direction[c]).sum();
        let mut of_size = 0.0;
        let size_per_z = self.scale * self.inverse;
        for c in 0..3 {
            let share = scale_logit(self.deltas[3 + c]);
            of_size += scales[c] * MAX_SCALE * sigmoid(share);
            deltas[3 + c] =
                scales[c] * size_per_z * z * MAX_SCALE * SCALE_SLOPE * sigmoid_slope(share);
        }
        // Mean and scales are proportional to z before multiplication by `global_scale`, and to
        // `global_scale` after it.
        let global_scale = (of_z + of_size * size_per_z) * z / self.global_scale;
        of_z += of_size * size_per_z;
        deltas[0] = f64::from(XY_FACTOR) * mean[0] * z;
        deltas[1] = f64::from(XY_FACTOR) * mean[1] * z;
        let of_logit_depth = -of_z * z * z * softplus_slope(logit_depth);
        deltas[2] = f64::from(INVERSE_DEPTH_FACTOR) * of_logit_depth;

        for c in 0..4 {
            deltas[6 + c] = gradient.quaternion[c].into();
        }
        for c in 0..3 {
            let step = f64::from(COLOR_FACTOR) * self.deltas[10 + c];
            let encoded = logit(self.colors[c].clamp(0.01, 0.99)) + step;
            let slope = linear_from_srgb_slope(sigmoid(encoded)) * sigmoid_slope(encoded);
            deltas[10 + c] = f64::from(COLOR_FACTOR) * f64::from(gradient.color[c]) * slope;
        }
        deltas[13] =
            f64::from(gradient.opacity) * sigmoid_slope(logit(self.opacity) + self.deltas[13]);
        BlockGradient {
            deltas,
            inverse: of_logit_depth * inverse_softplus_slope(self.inverse)
                + of_size * self.scale * z,
            scale: of_size * self.inverse * z,
            global_scale,
        }
    }
}

/// Derivative of the sigmoid, as sigmoid(x) · sigmoid(−x). Unlike s · (1 − s), which is 0 above x ≈
/// 37, this product is 0 only where e⁻ˣ is 0.
fn sigmoid_slope(x: f64) -> f64 {
    sigmoid(x) * sigmoid(-x)
}

fn softplus_slope(x: f64) -> f64 {
    if x > 20.0 { 1.0 } else { sigmoid(x) }
}

/// Derivative of [`inverse_softplus`]; 0 where that function clamps its argument.
fn inverse_softplus_slope(t: f64) -> f64 {
    if t < 1e-6 { 0.0 } else { -1.0 / (-t).exp_m1() }
}

#[cfg(test)]
mod tests;
