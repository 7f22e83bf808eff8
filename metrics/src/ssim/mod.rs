//! Structural similarity (SSIM) in every variant that public code computes.
//!
//! Wang et al. 2004: (2 μₐμᵦ + C₁)(2 σₐᵦ + C₂) / ((μₐ² + μᵦ² + C₁)(σₐ² + σᵦ² + C₂)) per channel,
//! with C₁ = (0.01 L)² and C₂ = (0.03 L)², averaged over pixels and channels. The variants differ
//! in window, border, covariance and L. All computations are f64: in f32, the variances (in flat
//! areas, differences of nearly equal numbers) would be wrong in the fifth decimal.
//!
//! # Contents
//! * [`variant`]: the variants and the choices that define them.
//! * [`map`]: the map of local similarities, row by row.
//! * [`strip`]: the rows under the window as it moves down the picture.
//! * [`filter`]: the window along one axis, and the similarity.

mod filter;
mod map;
mod spec;
mod strip;
mod variant;

use image::{ImageBuffer, Luma};

use crate::maps::ScoreMap;
use crate::picture::{Mask, Picture};
use crate::unavailable::Unavailable;
use map::map_rows;
use spec::SsimSpec;
pub use variant::{SsimBorder, SsimCovariance, SsimForm, SsimVariant, SsimWindow};

/// Mean of the SSIM map. With a mask, only windows whose centre is inside it count; some variants require the whole
/// window to be inside. The pictures (and the mask) must have the same size.
///
/// # Errors
/// If the pictures are smaller than a window, or no window qualifies.
pub fn ssim(
    variant: SsimVariant,
    prediction: &Picture,
    target: &Picture,
    mask: Option<&Mask>,
) -> Result<f64, Unavailable> {
    let form = SsimSpec::of(variant);
    let channels = form.channels();
    let origin = form.origin();
    let eroded;
    let mask = match mask {
        Some(mask) if form.form.whole_windows => {
            eroded = mask.eroded(form.radius, false);
            Some(&eroded)
        }
        mask => mask,
    };
    let rows = map_rows(&form, prediction, target, |y, row| {
        let Some(mask) = mask else {
            return (sum_in_lanes(row), row.len());
        };
        let inside = &mask.row(y + origin)[origin..];
        let mut sum = 0.0;
        let mut count = 0;
        for (values, &inside) in row.chunks_exact(channels).zip(inside) {
            if inside {
                sum += values.iter().sum::<f64>();
                count += channels;
            }
        }
        (sum, count)
    })?;
    let count: usize = rows.iter().map(|(_, count)| count).sum();
    if count == 0 {
        return Err(Unavailable::EmptyMask);
    }
    Ok(rows.iter().map(|(sum, _)| sum).sum::<f64>() / count as f64)
}

/// Mean, over all Gaussian windows that lie inside the pictures, of SSIM without its luminance factor: (2 σₐᵦ + C₂) /
/// (σₐ² + σᵦ² + C₂), a factor of multi-scale SSIM.
///
/// # Errors
/// If the pictures are smaller than a window.
pub fn ssim_contrast(prediction: &Picture, target: &Picture) -> Result<f64, Unavailable> {
    let form = SsimSpec {
        // C₁ is so large that the means are negligible and the luminance factor is 1.
        k1: 1e50,
        ..SsimSpec::of(SsimVariant::Gauss11Valid)
    };
    let means = map_rows(&form, prediction, target, |_, row| {
        sum_in_lanes(row) / row.len() as f64
    })?;
    Ok(means.iter().sum::<f64>() / means.len() as f64)
}

/// The SSIM map, averaged over channels.
pub(crate) fn ssim_map(
    variant: SsimVariant,
    prediction: &Picture,
    target: &Picture,
) -> Result<ScoreMap, Unavailable> {
    let form = SsimSpec::of(variant);
    let channels = form.channels();
    let rows = map_rows(&form, prediction, target, |_, row| {
        row.chunks_exact(channels)
            .map(|values| (values.iter().sum::<f64>() / channels as f64) as f32)
            .collect::<Vec<_>>()
    })?;
    let width = rows.first().map_or(0, Vec::len) as u32;
    let values = ImageBuffer::from_fn(width, rows.len() as u32, |x, y| {
        Luma([rows[y as usize][x as usize]])
    });
    Ok(ScoreMap {
        values,
        origin: form.origin() as u32,
    })
}

/// Sum in a fixed order that vectorises: eight running sums, which are then added.
fn sum_in_lanes(values: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (chunks, rest) = values.as_chunks::<8>();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += value;
        }
    }
    lanes.iter().chain(rest).sum()
}

#[cfg(test)]
mod tests;
