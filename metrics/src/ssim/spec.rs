//! A variant with the weights of its window.

use super::filter::QUANTITIES;
use super::variant::{SsimBorder, SsimCovariance, SsimForm, SsimVariant, SsimWindow};
use crate::unavailable::Unavailable;

/// An [`SsimForm`] with the weights of its window.
pub(super) struct SsimSpec {
    pub(super) form: SsimForm,
    pub(super) radius: usize,
    /// Weights of the pixels at distance `radius`, …, 1, 0 from the centre along one axis.
    pub(super) half: Vec<f64>,
    /// k₁ in C₁ = (k₁ L)², where L is the range of values.
    pub(super) k1: f64,
}

impl SsimSpec {
    pub(super) fn of(variant: SsimVariant) -> Self {
        let form = variant.form();
        let half = match form.window {
            SsimWindow::Uniform7 => vec![1.0 / 7.0; 4],
            SsimWindow::Gauss11 => {
                let weights: Vec<f64> = (0..=5)
                    .map(|i| (-f64::from((5 - i) * (5 - i)) / (2.0 * 1.5 * 1.5)).exp())
                    .collect();
                let sum = 2.0 * weights[..5].iter().sum::<f64>() + weights[5];
                weights.iter().map(|weight| weight / sum).collect()
            }
        };
        Self {
            radius: half.len() - 1,
            half,
            form,
            k1: 0.01,
        }
    }

    /// Factor for variances and covariances: n / (n − 1) for the sample estimator with n pixels per
    /// window, otherwise 1.
    pub(super) fn covariance(&self) -> f64 {
        let side = (2 * self.radius + 1) as f64;
        match self.form.covariance {
            SsimCovariance::Sample => side * side / (side * side - 1.0),
            SsimCovariance::Population | SsimCovariance::Bounded => 1.0,
        }
    }

    /// Number of quantities filtered under the windows; see [`QUANTITIES`].
    pub(super) fn quantities(&self) -> usize {
        match self.form.covariance {
            SsimCovariance::Bounded => QUANTITIES,
            _ => QUANTITIES - 1,
        }
    }

    pub(super) fn channels(&self) -> usize {
        if self.form.gray { 1 } else { 3 }
    }

    /// Width and height of the map for pictures of the given size.
    pub(super) fn map_size(
        &self,
        (width, height): (u32, u32),
    ) -> Result<(usize, usize), Unavailable> {
        let smallest = match self.form.border {
            SsimBorder::Valid => 2 * self.radius + 1,
            SsimBorder::Zero => 1,
            SsimBorder::Reflect => self.radius + 1,
        };
        let (w, h) = (width as usize, height as usize);
        if w.min(h) < smallest {
            return Err(Unavailable::TooSmall {
                width,
                height,
                smallest: smallest as u32,
            });
        }
        Ok(match self.form.border {
            SsimBorder::Valid => (w - 2 * self.radius, h - 2 * self.radius),
            SsimBorder::Zero | SsimBorder::Reflect => (w, h),
        })
    }

    /// Number of pixels by which the picture is padded on each side.
    pub(super) fn margin(&self) -> usize {
        match self.form.border {
            SsimBorder::Valid => 0,
            SsimBorder::Zero | SsimBorder::Reflect => self.radius,
        }
    }

    /// Offset of the map's origin from the picture's, in pixels along both axes: a value of the map
    /// belongs to the pixel at its window's centre.
    pub(super) fn origin(&self) -> usize {
        match self.form.border {
            SsimBorder::Valid => self.radius,
            SsimBorder::Zero | SsimBorder::Reflect => 0,
        }
    }
}
