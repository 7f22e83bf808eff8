//! Maps of a view as pictures: scored pixels, depth, coverage.

use image::{GrayImage, ImageBuffer, Luma, Rgb, RgbImage};
use sharp::render::turbo;
use sharp_datasets::DepthMap;

use super::error_map::{averaged, hatched};

/// Maximum number of depth values used to choose the ends of the colour scale.
const SAMPLES: usize = 1 << 16;
/// Share of the values that the colour scale leaves out at each end.
const CUT_SHARE: f64 = 0.02;

/// The picture, with stripes over pixels that are not scored.
pub fn masked(picture: &RgbImage, scored: impl Fn(u32, u32) -> bool) -> RgbImage {
    RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
        if scored(x, y) {
            *picture.get_pixel(x, y)
        } else {
            hatched(x, y)
        }
    })
}

/// Inverse depth in turbo colours, near in red, reduced to fit `side` pixels. The colour scale
/// excludes the nearest and the farthest 2 %. Unknown depth is striped.
pub fn inverse_depth(depth: &DepthMap, side: u32) -> RgbImage {
    let (width, height) = depth.dimensions();
    let inverse = ImageBuffer::from_fn(width, height, |x, y| {
        let metres = depth.get_pixel(x, y).0[0];
        Luma([if metres > 0.0 { metres.recip() } else { 0.0 }])
    });
    let known = inverse.iter().copied().filter(|value| *value > 0.0);
    let known: Vec<f32> = known.collect();
    let mut known: Vec<f32> = known
        .iter()
        .copied()
        .step_by(known.len().div_ceil(SAMPLES).max(1))
        .collect();
    known.sort_by(f32::total_cmp);
    let last = known.len().saturating_sub(1) as f64;
    let end = |share: f64| known.get((share * last).round() as usize).copied();
    let (least, most) = end(CUT_SHARE)
        .zip(end(1.0 - CUT_SHARE))
        .unwrap_or((0.0, 1.0));
    let is_known = |x, y| depth.get_pixel(x, y).0[0] > 0.0;
    // Colour a reduced pixel if any pixel that it covers has depth, because sparse maps may have depth in only one
    // pixel of twenty.
    averaged(inverse, is_known, f32::MIN_POSITIVE, side, |value| {
        let share = if most > least {
            (value - least) / (most - least)
        } else {
            0.5
        };
        Rgb(turbo(share))
    })
}

/// Alpha from black (0) to white (1).
pub fn coverage(alpha: &ImageBuffer<Luma<f32>, Vec<f32>>) -> RgbImage {
    let grey: GrayImage = ImageBuffer::from_fn(alpha.width(), alpha.height(), |x, y| {
        Luma([(alpha.get_pixel(x, y).0[0] * 255.0).round() as u8])
    });
    image::DynamicImage::from(grey).into_rgb8()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_is_red_far_is_blue_and_unknown_is_striped() {
        // 1 m, unknown, 2 m.
        let depth = DepthMap::from_vec(3, 1, vec![1.0, 0.0, 2.0]).unwrap();
        let picture = inverse_depth(&depth, 10);
        assert_eq!(picture.get_pixel(0, 0).0, turbo(1.0));
        assert_eq!(*picture.get_pixel(1, 0), hatched(1, 0));
        assert_eq!(picture.get_pixel(2, 0).0, turbo(0.0));
        // Reduced to one pixel, only the known values count: the mean of 1 and 1/2 per metre, which is the middle of
        // the scale.
        let one = inverse_depth(&depth, 1);
        assert_eq!(one.get_pixel(0, 0).0, turbo(0.5));
        let unknown = inverse_depth(&DepthMap::new(1, 1), 10);
        assert_eq!(*unknown.get_pixel(0, 0), hatched(0, 0));
    }

    #[test]
    fn what_is_not_scored_is_striped_and_alpha_is_grey() {
        let white = RgbImage::from_pixel(2, 1, Rgb([255; 3]));
        let masked = masked(&white, |x, _| x == 0);
        assert_eq!(*masked.get_pixel(0, 0), Rgb([255; 3]));
        assert_eq!(*masked.get_pixel(1, 0), hatched(1, 0));
        let alpha = ImageBuffer::from_vec(2, 1, vec![0.0, 0.5]).unwrap();
        let grey = coverage(&alpha);
        assert_eq!(
            (grey.get_pixel(0, 0).0, grey.get_pixel(1, 0).0),
            ([0; 3], [128; 3])
        );
    }
}
