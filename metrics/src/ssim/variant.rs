//! The variants taken apart: window, border, covariance, channels and range.

use crate::identity::SsimVariant;
use crate::unavailable::Unavailable;

/// What happens where the window reaches beyond the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Border {
    /// Such windows do not count: the map is smaller than the picture by a radius on each side.
    Valid,
    /// The picture goes on with zeros.
    Zero,
    /// The picture is mirrored; the edge pixel is not repeated.
    Reflect,
}

/// A variant taken apart.
pub(super) struct SsimSpec {
    pub(super) radius: usize,
    /// Weight of the pixels at distance `radius`, …, 1, 0 from the centre along one axis.
    pub(super) half: Vec<f64>,
    pub(super) border: Border,
    /// Factor that turns population into sample covariance, or 1.
    pub(super) covariance: f64,
    pub(super) gray: bool,
    pub(super) range_of_data: bool,
}

impl SsimSpec {
    pub(super) fn of(variant: SsimVariant) -> Self {
        use SsimVariant as V;
        let uniform = matches!(variant, V::Uniform7Sample | V::Uniform7Population);
        let border = match variant {
            V::Gauss11Zero => Border::Zero,
            V::Gauss11Reflect | V::Gauss11ReflectDataRange => Border::Reflect,
            _ => Border::Valid,
        };
        let covariance = match variant {
            V::Uniform7Sample => 49.0 / 48.0,
            V::Gauss11ValidSample => 121.0 / 120.0,
            _ => 1.0,
        };
        let half = if uniform {
            vec![1.0 / 7.0; 4]
        } else {
            let weights: Vec<f64> = (0..=5)
                .map(|i| (-f64::from((5 - i) * (5 - i)) / (2.0 * 1.5 * 1.5)).exp())
                .collect();
            let sum = 2.0 * weights[..5].iter().sum::<f64>() + weights[5];
            weights.iter().map(|weight| weight / sum).collect()
        };
        Self {
            radius: half.len() - 1,
            half,
            border,
            covariance,
            gray: variant == V::Gauss11ValidGray,
            range_of_data: variant == V::Gauss11ReflectDataRange,
        }
    }

    pub(super) fn channels(&self) -> usize {
        if self.gray { 1 } else { 3 }
    }

    /// Width and height of the map.
    pub(super) fn map_size(
        &self,
        (width, height): (u32, u32),
    ) -> Result<(usize, usize), Unavailable> {
        let smallest = match self.border {
            Border::Valid => 2 * self.radius + 1,
            Border::Zero => 1,
            Border::Reflect => self.radius + 1,
        };
        let (w, h) = (width as usize, height as usize);
        if w.min(h) < smallest {
            return Err(Unavailable::TooSmall {
                width,
                height,
                smallest: smallest as u32,
            });
        }
        Ok(match self.border {
            Border::Valid => (w - 2 * self.radius, h - 2 * self.radius),
            Border::Zero | Border::Reflect => (w, h),
        })
    }

    /// Pixels by which the picture is continued on each side.
    pub(super) fn margin(&self) -> usize {
        match self.border {
            Border::Valid => 0,
            Border::Zero | Border::Reflect => self.radius,
        }
    }

    /// Distance of the map's origin from the picture's, both axes: a value of the map belongs to
    /// the pixel at its window's centre.
    pub(super) fn origin(&self) -> usize {
        match self.border {
            Border::Valid => self.radius,
            Border::Zero | Border::Reflect => 0,
        }
    }
}
