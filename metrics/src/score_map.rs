//! A metric's local values.

use image::{ImageBuffer, Luma};

/// Where in the picture a metric finds the two pictures alike or different.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoreMap {
    /// The metric's local values, one a pixel.
    pub values: ImageBuffer<Luma<f32>, Vec<f32>>,
    /// Column and row of the picture that the first value belongs to; 0 unless the metric has no
    /// value near the border.
    pub origin: u32,
}
