//! Inverse depth as a picture, in the turbo colormap.

use super::RenderOutput;
use image::{ImageBuffer, Luma, RgbImage};
use std::ops::RangeInclusive;

/// Mikhailov's turbo table (256 sRGB colours, the same in matplotlib and OpenCV) as Chebyshev series over 0..1 for red,
/// green and blue. Each entry is reproduced to within one level of 255.
const TURBO: [[f64; 18]; 3] = [
    [
        0.505162, 0.309517, -0.120497, -0.232494, -0.046918, 0.096729, -0.016355, -0.035512,
        0.023909, 0.002682, -0.014877, 0.008847, 0.004696, -0.008070, 0.000291, 0.003505,
        -0.000735, -0.001630,
    ],
    [
        0.437025, -0.096934, -0.461470, 0.067764, 0.080928, 0.003862, -0.011764, -0.003280,
        -0.003100, 0.000132, 0.002242, 0.001069, 0.001413, -0.000517, -0.002522, -0.000143,
        0.001581, 0.000566,
    ],
    [
        0.354197, -0.359214, -0.120777, 0.225707, -0.146099, 0.041433, 0.046213, -0.023074,
        -0.018234, 0.001254, 0.010585, 0.006811, -0.008495, -0.004282, 0.005816, 0.000308,
        -0.003049, 0.001968,
    ],
];

/// Turbo colour of a value in 0..1, from dark blue through green to dark red; 8-bit sRGB. Values
/// outside the range take the colour of the nearer end, NaN the colour of 0. Quantised to 256
/// steps, like the table.
pub fn turbo(value: f32) -> [u8; 3] {
    // A float-to-integer cast saturates, and converts NaN to 0.
    let entry = (value * 256.0) as u8;
    let x = f64::from(entry) / 255.0 * 2.0 - 1.0;
    TURBO.map(|series| {
        let (mut sum, mut before) = (0.0, 0.0);
        for c in series[1..].iter().rev() {
            (sum, before) = (2.0 * x * sum - before + c, sum);
        }
        let y = x * sum - before + series[0];
        (y.clamp(0.0, 1.0) * 255.0).round() as u8
    })
}

impl RenderOutput {
    /// Inverse expected z-depth `alpha / Σ w z`, in 1/m; 0 where nothing was drawn.
    pub fn inverse_depth(&self) -> ImageBuffer<Luma<f32>, Vec<f32>> {
        let mut picture = self.expected_depth();
        for depth in picture.iter_mut() {
            *depth = if *depth > 0.0 { depth.recip() } else { 0.0 };
        }
        picture
    }

    /// Inverse depth in turbo colours, from dark red at the near end of `range_m` (metres, > 0) to dark blue at its far
    /// end. Depths outside the range take the colour of the nearer end; pixels where nothing was drawn are black.
    pub fn inverse_depth_colors(&self, range_m: RangeInclusive<f32>) -> RgbImage {
        let (most, least) = (range_m.start().recip(), range_m.end().recip());
        let inverse = self.inverse_depth();
        RgbImage::from_fn(self.width, self.height, |x, y| {
            let value = inverse.get_pixel(x, y).0[0];
            if value == 0.0 {
                return image::Rgb([0; 3]);
            }
            image::Rgb(turbo((value - least) / (most - least)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Dropped;
    use super::*;
    use crate::ply::ColorSpace;

    #[test]
    fn turbo_is_the_published_table_to_one_level() {
        // Every sixteenth of the 256 entries, and the last.
        let table: [[u8; 3]; 16] = [
            [48, 18, 59],
            [64, 64, 162],
            [70, 107, 227],
            [66, 148, 255],
            [40, 188, 235],
            [24, 221, 194],
            [50, 242, 152],
            [109, 254, 98],
            [164, 252, 60],
            [205, 236, 52],
            [238, 207, 58],
            [253, 172, 52],
            [251, 126, 33],
            [235, 80, 14],
            [208, 47, 5],
            [169, 22, 1],
        ];
        let entries = (0_u8..).step_by(16).zip(table);
        for (entry, colour) in entries.chain([(255, [122, 4, 3])]) {
            let found = turbo(f32::from(entry) / 255.0);
            for channel in 0..3 {
                let off = found[channel].abs_diff(colour[channel]);
                assert!(off <= 1, "{entry}: {found:?}, not {colour:?}");
            }
        }
        assert_eq!(turbo(-3.0), turbo(0.0));
        assert_eq!(turbo(f32::NAN), turbo(0.0));
        assert_eq!(turbo(9.0), turbo(1.0));
    }

    #[test]
    fn near_is_red_far_is_blue_and_nothing_is_black() {
        let output = RenderOutput {
            width: 4,
            height: 1,
            blending: ColorSpace::Linear,
            rgb: vec![[0.0; 3]; 4],
            alpha: vec![0.5, 0.5, 0.0, 0.25],
            depth_acc: vec![0.5, 5.0, 0.0, 25.0],
            drawn: 1,
            dropped: Dropped::default(),
        };
        assert_eq!(output.inverse_depth().as_raw(), &[1.0, 0.1, 0.0, 0.01]);
        let picture = output.inverse_depth_colors(1.0..=10.0);
        assert_eq!(picture.get_pixel(0, 0).0, turbo(1.0));
        assert_eq!(picture.get_pixel(1, 0).0, turbo(0.0));
        assert_eq!(picture.get_pixel(2, 0).0, [0; 3]);
        assert_eq!(picture.get_pixel(3, 0).0, turbo(0.0));
    }
}
