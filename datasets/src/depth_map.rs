//! Maps of z-depth.

use image::{ImageBuffer, Luma};

/// z-depth in metres, row-major, top row first; 0 marks an invalid pixel, all other values are finite and positive.
pub type DepthMap = ImageBuffer<Luma<f32>, Vec<f32>>;

/// The value that a map stores for a depth: `z` if it is finite and positive, else 0.
pub(crate) fn valid_depth(z: f64) -> f32 {
    let z = z as f32;
    if z.is_finite() && z > 0.0 { z } else { 0.0 }
}

/// Depth of scattered points by z-buffer: each point marks the pixels within `radius` of its
/// position; where points overlap, the nearest one counts.
pub(crate) fn z_buffer(
    size: (u32, u32),
    radius: u32,
    places: impl Iterator<Item = (glam::DVec2, f64)>,
) -> DepthMap {
    let mut depth = DepthMap::new(size.0, size.1);
    for (place, z) in places {
        let z = valid_depth(z);
        if z == 0.0 || !place.is_finite() {
            continue;
        }
        let (x, y) = (place.x.floor() as i64, place.y.floor() as i64);
        let reach = i64::from(radius);
        if x < -reach
            || y < -reach
            || x > i64::from(size.0) + reach
            || y > i64::from(size.1) + reach
        {
            continue;
        }
        for v in (y - reach).max(0)..=(y + reach).min(i64::from(size.1) - 1) {
            for u in (x - reach).max(0)..=(x + reach).min(i64::from(size.0) - 1) {
                let Luma([into]) = depth.get_pixel_mut(u as u32, v as u32);
                if *into == 0.0 || z < *into {
                    *into = z;
                }
            }
        }
    }
    depth
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_wins() {
        let places = [
            (glam::DVec2::new(1.9, 1.1), 3.0),
            (glam::DVec2::new(1.2, 1.8), 2.0),
            (glam::DVec2::new(-0.5, 0.5), 1.0),
            (glam::DVec2::new(f64::NAN, 0.5), 1.0),
            (glam::DVec2::new(2.5, 2.5), -1.0),
        ];
        let depth = z_buffer((3, 3), 0, places.into_iter());
        assert_eq!(
            depth.as_raw(),
            &[0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0]
        );
        let wide = z_buffer((3, 3), 1, places.into_iter());
        assert_eq!(
            wide.as_raw(),
            &[1.0, 2.0, 2.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0]
        );
    }
}
