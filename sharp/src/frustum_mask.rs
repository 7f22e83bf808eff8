//! The paper's view-frustum mask: target pixels inside the source's slightly widened field of view. The paper uses it
//! in training losses; the harness also uses it in masked metrics.

use glam::{DMat3, DVec3};
use image::{ImageBuffer, Luma};
use rayon::prelude::*;

use crate::camera::{Intrinsics, RigidTransform};

/// z-depth in metres. +∞ marks sky (see [`InfiniteDepth`]). NaN, −∞, zero and negative values are invalid.
type DepthMap = ImageBuffer<Luma<f32>, Vec<f32>>;

/// 1 for pixels inside the source's field of view, 0 for all others; has the size of the target.
pub type FrustumMask = ImageBuffer<Luma<u8>, Vec<u8>>;

/// Treatment of infinite depth (sky).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum InfiniteDepth {
    /// Invalid depth: outside the mask.
    #[default]
    Invalid,
    /// A point at infinity: only the rotation between the views affects its ray.
    Direction,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrustumMaskOptions {
    /// Largest |x| and |y| of the widened field of view of the source, inclusive. In these normalised coordinates, the
    /// image's edges are at ±1.
    pub margin: f64,
    pub infinite_depth: InfiniteDepth,
}

impl Default for FrustumMaskOptions {
    /// The paper's margin of 1.05; infinite depth is invalid.
    fn default() -> Self {
        Self {
            margin: 1.05,
            infinite_depth: InfiniteDepth::Invalid,
        }
    }
}

/// Unprojects every pixel of the `target` camera with its `depth`, projects the point into the
/// `source`, and keeps the pixel if |x| and |y| are within the margin.
///
/// The paper's formula also accepts points behind the source camera. Here, these points and pixels
/// without valid depth are outside the mask (z > 0 is required). Occlusion is not tested.
pub fn frustum_mask(
    depth: &DepthMap,
    target: &Intrinsics,
    source: &Intrinsics,
    source_from_target: &RigidTransform,
    options: &FrustumMaskOptions,
) -> FrustumMask {
    let warp = Warp::new(source.ndc_from_camera(), target, source_from_target);
    let within =
        |p: DVec3| (p.x / p.z).abs() <= options.margin && (p.y / p.z).abs() <= options.margin;
    warp.mask(depth, options.infinite_depth, |p| p.z > 0.0 && within(p))
}

/// Mask of the pixels whose centre projects to 0 ≤ u < width and 0 ≤ v < height in the source, with
/// u and v measured from the centre of the source's first pixel. UniSHARP's evaluation uses this
/// mask.
pub fn source_bounds_mask(
    depth: &DepthMap,
    target: &Intrinsics,
    source: &Intrinsics,
    source_from_target: &RigidTransform,
) -> FrustumMask {
    let (width, height) = (f64::from(source.width), f64::from(source.height));
    let inside = |at: f64, side: f64| (0.5..side + 0.5).contains(&at);
    let warp = Warp::new(source.matrix(), target, source_from_target);
    warp.mask(depth, InfiniteDepth::Invalid, |p| {
        p.z > 0.0 && inside(p.x / p.z, width) && inside(p.y / p.z, height)
    })
}

/// Maps a target pixel with depth to its projection in the source.
struct Warp {
    rotation: DMat3,
    translation: DVec3,
}

impl Warp {
    fn new(projection: DMat3, target: &Intrinsics, source_from_target: &RigidTransform) -> Self {
        Self {
            rotation: projection * source_from_target.rotation * target.matrix().inverse(),
            translation: projection * source_from_target.translation,
        }
    }

    /// Mask that is 1 for pixels whose projection satisfies `inside`, and 0 for all others.
    fn mask(
        &self,
        depth: &DepthMap,
        infinite_depth: InfiniteDepth,
        inside: impl Fn(DVec3) -> bool + Sync,
    ) -> FrustumMask {
        let inside = |x: usize, y: usize, depth: f32| {
            let ray = self.rotation * DVec3::new(x as f64 + 0.5, y as f64 + 0.5, 1.0);
            if depth == f32::INFINITY {
                infinite_depth == InfiniteDepth::Direction && inside(ray)
            } else {
                depth > 0.0 && inside(ray * f64::from(depth) + self.translation)
            }
        };
        let (width, height) = depth.dimensions();
        let mut mask = FrustumMask::new(width, height);
        if width > 0 {
            let row = width as usize;
            mask.par_chunks_exact_mut(row)
                .zip(depth.par_chunks_exact(row))
                .enumerate()
                .for_each(|(y, (mask, depth))| {
                    for x in 0..row {
                        mask[x] = u8::from(inside(x, y, depth[x]));
                    }
                });
        }
        mask
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(width: u32) -> Intrinsics {
        let half = f64::from(width) / 2.0;
        Intrinsics::new((half, half), (half, half), (width, width)).unwrap()
    }

    fn seen_by(
        source: &Intrinsics,
        pose: &RigidTransform,
        depth: &DepthMap,
        options: &FrustumMaskOptions,
    ) -> FrustumMask {
        frustum_mask(depth, &camera(depth.width()), source, pose, options)
    }

    fn shifted(x: f64, z: f64) -> RigidTransform {
        RigidTransform {
            rotation: DMat3::IDENTITY,
            translation: DVec3::new(x, 0.0, z),
        }
    }

    #[test]
    fn the_margin_belongs_to_the_mask() {
        // f = w / 2, so x/z is the normalised coordinate. A source with a 1.25 times longer lens puts the
        // right half's columns (0.25, 0.75) at 0.3125 and 0.9375.
        let target = DepthMap::from_pixel(4, 4, Luma([2.0]));
        let lens = Intrinsics::new((2.5, 2.5), (2.0, 2.0), (4, 4)).unwrap();
        let count = |margin| {
            let options = FrustumMaskOptions {
                margin,
                ..FrustumMaskOptions::default()
            };
            seen_by(&lens, &RigidTransform::IDENTITY, &target, &options)
                .iter()
                .filter(|&&m| m == 1)
                .count()
        };
        assert_eq!(count(0.9375), 16);
        assert_eq!(count(0.9374), 4);
    }

    #[test]
    fn the_sources_bounds_are_counted_from_its_first_pixels_centre() {
        // f = w / 2 and depth 2: a source 1 to the right sees pixel x at x - 1. The centres of the
        // first column are projected to -0.5, outside the picture; those of all others inside it.
        let target = DepthMap::from_pixel(4, 4, Luma([2.0]));
        let mask = |x: f64| source_bounds_mask(&target, &camera(4), &camera(4), &shifted(x, 0.0));
        let columns = |mask: FrustumMask| -> Vec<u8> { mask.as_raw()[..4].to_vec() };
        assert_eq!(columns(mask(-1.0)), [0, 1, 1, 1]);
        // The last column is projected to 4.5 - 0.5 = 4, which is not below 4.
        assert_eq!(columns(mask(1.0)), [1, 1, 1, 0]);
        assert_eq!(columns(mask(0.0)), [1; 4]);
        let behind = source_bounds_mask(&target, &camera(4), &camera(4), &shifted(0.0, -3.0));
        assert!(behind.iter().all(|&m| m == 0));
    }

    #[test]
    fn points_behind_the_source_and_invalid_depth_are_outside() {
        let options = FrustumMaskOptions::default();
        let target = DepthMap::from_pixel(2, 2, Luma([1.0]));
        let behind = seen_by(&camera(2), &shifted(0.0, -3.0), &target, &options);
        assert!(behind.iter().all(|&m| m == 0));
        let holed = DepthMap::from_vec(2, 2, vec![1.0, 0.0, f32::NAN, -1.0]).unwrap();
        let mask = seen_by(&camera(2), &RigidTransform::IDENTITY, &holed, &options);
        assert_eq!(mask.as_raw(), &[1, 0, 0, 0]);
    }

    #[test]
    fn infinite_depth_is_a_direction_if_asked() {
        let sky = DepthMap::from_pixel(2, 2, Luma([f32::INFINITY]));
        let far = shifted(1e6, 0.0);
        let mask = |infinite_depth| {
            let options = FrustumMaskOptions {
                infinite_depth,
                ..FrustumMaskOptions::default()
            };
            seen_by(&camera(2), &far, &sky, &options)
        };
        assert!(mask(InfiniteDepth::Invalid).iter().all(|&m| m == 0));
        assert!(mask(InfiniteDepth::Direction).iter().all(|&m| m == 1));
    }
}
