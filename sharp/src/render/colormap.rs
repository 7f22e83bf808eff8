//! Inverse depth as a picture, in the turbo colours.

use super::RenderOutput;
use image::{ImageBuffer, Luma, RgbImage};
use std::ops::RangeInclusive;

/// Polynomials of degree five that approximate Mikhailov's turbo table, sRGB in 0..1, lowest
/// power first, for red, green and blue.
const TURBO: [[f32; 6]; 3] = [
    [
        0.135_721_38,
        4.615_392_6,
        -42.660_32,
        132.131_08,
        -152.942_4,
        59.286_38,
    ],
    [
        0.091_402_61,
        2.194_188_4,
        4.842_966_6,
        -14.185_033,
        4.277_298_6,
        2.829_566,
    ],
    [
        0.106_673_3,
        12.641_946,
        -60.582_05,
        110.362_77,
        -89.903_11,
        27.348_25,
    ],
];

/// The turbo colour of a value in 0..1, from dark blue over green to dark red; 8-bit sRGB.
pub fn turbo(value: f32) -> [u8; 3] {
    let x = if value.is_nan() {
        0.0
    } else {
        value.clamp(0.0, 1.0)
    };
    TURBO.map(|c| {
        let y = c.iter().rev().fold(0.0, |sum, c| sum * x + c);
        (y.clamp(0.0, 1.0) * 255.0).round() as u8
    })
}

impl RenderOutput {
    /// Inverse expected z-depth `alpha / Σ w z`, 1/m; 0 where nothing was drawn.
    pub fn inverse_depth(&self) -> ImageBuffer<Luma<f32>, Vec<f32>> {
        let mut picture = self.expected_depth();
        for depth in picture.iter_mut() {
            *depth = if *depth > 0.0 { depth.recip() } else { 0.0 };
        }
        picture
    }

    /// Inverse depth in turbo colours: the end of `range_m` (metres, > 0) is dark blue, its start
    /// dark red, what lies beyond takes the end's colour; black where nothing was drawn.
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

    #[test]
    fn turbo_runs_from_blue_over_green_to_red() {
        // The published table: 0 is (48, 18, 59), 128 is (164, 252, 60), 255 is (122, 4, 3). The
        // polynomials stay within 20 levels of it, except at the very ends.
        let near = |found: [u8; 3], table: [u8; 3], slack: u8| {
            for channel in 0..3 {
                let off = found[channel].abs_diff(table[channel]);
                assert!(off <= slack, "{found:?} {table:?}");
            }
        };
        near(turbo(0.0), [48, 18, 59], 36);
        near(turbo(128.0 / 255.0), [164, 252, 60], 20);
        near(turbo(1.0), [122, 4, 3], 24);
        assert_eq!(turbo(-3.0), turbo(0.0));
        assert_eq!(turbo(f32::NAN), turbo(0.0));
        assert_eq!(turbo(9.0), turbo(1.0));
    }

    #[test]
    fn near_is_red_far_is_blue_and_nothing_is_black() {
        let output = RenderOutput {
            width: 4,
            height: 1,
            rgb_linear: vec![[0.0; 3]; 4],
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
