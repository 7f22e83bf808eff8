//! Derivative of normalisation, pooling and feature input with respect to metric depth.

use super::{
    Grid, InitializerError, MAX_NORMALIZED_DEPTH, NormalizedDepth, check_length, is_valid,
};
use crate::render::narrow;

/// Gradient of a loss with respect to the depth-dependent parts of [`BaseGaussians`](super::BaseGaussians).
#[derive(Debug, Clone, PartialEq)]
pub struct BaseGradient {
    /// Gradient with respect to the pooled inverse depth, `[layers, rows, columns]`, not counting its effect on the
    /// scales.
    pub inverse_depth: Vec<f32>,
    /// Gradient with respect to the base scales, `[layers, rows, columns]`.
    pub scales: Vec<f32>,
    /// Gradient with respect to the metres per normalised unit.
    pub global_scale: f64,
}

/// Computes the gradient with respect to metric depth, `[layers, height, width]`, in 1/m. Its inputs are the gradient
/// of the base Gaussians, and the gradient of the inverse-depth planes of [`NormalizedDepth::feature_input`]
/// (`features`, `[layers, height, width]`). `normalized` is the result of normalising `depth`.
///
/// Subgradients match torch's: a block's value belongs to the first of its nearest pixels, row by
/// row. Pixels beyond [`MAX_NORMALIZED_DEPTH`] get no gradient, but pixels exactly at that depth
/// do. The gradient of the factor is divided evenly among all nearest pixels, as in torch's `amin`;
/// the SHARP release's `min` assigns it to one nearest pixel. (Ties occur because the release's two
/// layers start as copies of each other.) The gradient is zero for invalid depth.
///
/// # Errors
/// [`InitializerError::Grid`] for an empty or indivisible grid; [`InitializerError::Length`] if an input does not fill
/// the grid.
pub fn backward(
    depth: &[f32],
    normalized: &NormalizedDepth,
    grid: Grid,
    base: &BaseGradient,
    features: &[f32],
) -> Result<Vec<f32>, InitializerError> {
    grid.check_blocks()?;
    let (pixels, blocks) = (grid.layers * grid.pixels(), grid.layers * grid.blocks());
    check_length("depth", pixels, depth)?;
    check_length("normalised depth", pixels, &normalized.depth)?;
    check_length("gradient of inverse depth", blocks, &base.inverse_depth)?;
    check_length("gradient of scales", blocks, &base.scales)?;
    check_length("gradient of features", pixels, features)?;
    let mut inverse: Vec<f64> = features.iter().map(|&g| 2.0 * f64::from(g)).collect();
    through_pooling(&mut inverse, normalized, grid, base);
    Ok(through_normalization(
        depth,
        normalized,
        &inverse,
        base.global_scale,
    ))
}

/// Adds the gradient of the pooled values to the gradient of the inverse normalised depth.
fn through_pooling(
    inverse: &mut [f64],
    normalized: &NormalizedDepth,
    grid: Grid,
    base: &BaseGradient,
) {
    let Grid { width, stride, .. } = grid;
    for block in 0..base.scales.len() {
        let (layer, within) = (block / grid.blocks(), block % grid.blocks());
        let (row, column) = (within / grid.columns(), within % grid.columns());
        let corner = layer * grid.pixels() + (row * width + column) * stride;
        let mut nearest: Option<(usize, f32)> = None;
        for pixel in (0..stride).flat_map(|dy| corner + dy * width..corner + dy * width + stride) {
            let depth = normalized.depth[pixel];
            // Uses the same comparison as the forward pass, because different depths may have the same inverse.
            if depth > 0.0 && nearest.is_none_or(|(_, largest)| 1.0 / depth > largest) {
                nearest = Some((pixel, 1.0 / depth));
            }
        }
        if let Some((pixel, largest)) = nearest {
            let slope = -f64::from(grid.size_at_unit_depth()) / f64::from(largest).powi(2);
            inverse[pixel] +=
                f64::from(base.inverse_depth[block]) + slope * f64::from(base.scales[block]);
        }
    }
}

fn through_normalization(
    depth: &[f32],
    normalized: &NormalizedDepth,
    inverse: &[f64],
    global_scale: f64,
) -> Vec<f32> {
    let valid = || depth.iter().copied().filter(|&d| is_valid(d));
    let nearest = valid().fold(f32::INFINITY, f32::min);
    let ties = valid().filter(|&d| d == nearest).count() as f64;
    let factor = 1.0 / (f64::from(nearest) + 1e-6);
    // Gradient of depth times factor; zero beyond the clamp.
    let scaled = |pixel: usize| {
        let inside =
            is_valid(depth[pixel]) && depth[pixel] * normalized.factor <= MAX_NORMALIZED_DEPTH;
        let scaled = f64::from(depth[pixel]) * factor;
        if inside {
            -inverse[pixel] / (scaled * scaled)
        } else {
            0.0
        }
    };
    let of_factor: f64 = (0..depth.len())
        .filter(|&pixel| is_valid(depth[pixel]))
        .map(|pixel| scaled(pixel) * f64::from(depth[pixel]))
        .sum();
    // global_scale = 1 / factor = nearest + 1e-6.
    let of_nearest = (global_scale - factor * factor * of_factor) / ties;
    let one = |pixel: usize| {
        let shared = if depth[pixel] == nearest {
            of_nearest
        } else {
            0.0
        };
        narrow(factor * scaled(pixel) + shared)
    };
    (0..depth.len()).map(one).collect()
}

#[cfg(test)]
mod tests;
