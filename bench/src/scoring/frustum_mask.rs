//! The paper's view-frustum mask: which target pixels lie inside the source's (slightly widened) field
//! of view. The paper uses it in training losses; here it carries the masked metrics.

use glam::{DMat3, DVec3};
use image::{ImageBuffer, Luma};
use rayon::prelude::*;
use sharp::camera::{Intrinsics, RigidTransform};

use crate::pairs::depth::PosedDepth;
use crate::pairs::valid_depth::is_valid_depth;

/// 1 inside, 0 outside; of the target's size.
pub type FrustumMask = ImageBuffer<Luma<u8>, Vec<u8>>;

/// What an infinite depth (sky) means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum InfiniteDepth {
    /// No depth: outside.
    #[default]
    Invalid,
    /// A point infinitely far: only the rotation between the views acts on its ray.
    Direction,
}

/// How the mask is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrustumMaskOptions {
    /// Half the width and height of the source's field of view in normalised coordinates, in which the
    /// image's edges lie at ±1; the bound belongs to the mask.
    pub margin: f64,
    /// What an infinite depth means.
    pub infinite_depth: InfiniteDepth,
}

impl Default for FrustumMaskOptions {
    /// The paper's 1.05; infinite depth is no depth.
    fn default() -> Self {
        Self {
            margin: 1.05,
            infinite_depth: InfiniteDepth::Invalid,
        }
    }
}

/// Lifts every target pixel by its depth, projects it into the source and keeps it where |x| and |y|
/// stay within the margin.
///
/// The paper's formula holds for points behind the source camera too; here they are outside (z > 0),
/// and so are pixels without valid depth. Nothing tests for occlusion.
pub fn frustum_mask(
    target: &PosedDepth,
    source: &Intrinsics,
    source_from_world: &RigidTransform,
    options: &FrustumMaskOptions,
) -> FrustumMask {
    let (width, height) = target.depth().dimensions();
    let source_from_target = source_from_world.after(&target.camera_from_world().inverse());
    let ndc_from_source = source.ndc_from_camera();
    let rotation: DMat3 =
        ndc_from_source * source_from_target.rotation * target.intrinsics().matrix().inverse();
    let translation = ndc_from_source * source_from_target.translation;
    let inside = |x: usize, y: usize, depth: f32| {
        let ray = rotation * DVec3::new(x as f64 + 0.5, y as f64 + 0.5, 1.0);
        let p = if is_valid_depth(depth) {
            ray * f64::from(depth) + translation
        } else if depth == f32::INFINITY && options.infinite_depth == InfiniteDepth::Direction {
            ray
        } else {
            return false;
        };
        p.z > 0.0 && (p.x / p.z).abs() <= options.margin && (p.y / p.z).abs() <= options.margin
    };
    let mut mask = FrustumMask::new(width, height);
    if width > 0 {
        let row = width as usize;
        mask.par_chunks_exact_mut(row)
            .zip(target.depth().par_chunks_exact(row))
            .enumerate()
            .for_each(|(y, (mask, depth))| {
                for x in 0..row {
                    mask[x] = u8::from(inside(x, y, depth[x]));
                }
            });
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp_datasets::DepthMap;

    fn camera(width: u32) -> Intrinsics {
        let half = f64::from(width) / 2.0;
        Intrinsics::new((half, half), (half, half), (width, width)).unwrap()
    }

    fn view(depth: DepthMap) -> PosedDepth {
        let intrinsics = camera(depth.width());
        PosedDepth::new("t", intrinsics, RigidTransform::IDENTITY, depth).unwrap()
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
        let target = view(DepthMap::from_pixel(4, 4, Luma([2.0])));
        let lens = Intrinsics::new((2.5, 2.5), (2.0, 2.0), (4, 4)).unwrap();
        let count = |margin| {
            let options = FrustumMaskOptions {
                margin,
                ..FrustumMaskOptions::default()
            };
            frustum_mask(&target, &lens, &RigidTransform::IDENTITY, &options)
                .iter()
                .filter(|&&m| m == 1)
                .count()
        };
        assert_eq!(count(0.9375), 16);
        assert_eq!(count(0.9374), 4);
    }

    #[test]
    fn points_behind_the_source_and_invalid_depth_are_outside() {
        let options = FrustumMaskOptions::default();
        let target = view(DepthMap::from_pixel(2, 2, Luma([1.0])));
        let behind = frustum_mask(&target, &camera(2), &shifted(0.0, -3.0), &options);
        assert!(behind.iter().all(|&m| m == 0));
        let holed = view(DepthMap::from_vec(2, 2, vec![1.0, 0.0, f32::NAN, -1.0]).unwrap());
        let mask = frustum_mask(&holed, &camera(2), &RigidTransform::IDENTITY, &options);
        assert_eq!(mask.as_raw(), &[1, 0, 0, 0]);
    }

    #[test]
    fn infinite_depth_is_a_direction_if_asked() {
        let sky = view(DepthMap::from_pixel(2, 2, Luma([f32::INFINITY])));
        let far = shifted(1e6, 0.0);
        let mask = |infinite_depth| {
            let options = FrustumMaskOptions {
                infinite_depth,
                ..FrustumMaskOptions::default()
            };
            frustum_mask(&sky, &camera(2), &far, &options)
        };
        assert!(mask(InfiniteDepth::Invalid).iter().all(|&m| m == 0));
        assert!(mask(InfiniteDepth::Direction).iter().all(|&m| m == 1));
    }
}
