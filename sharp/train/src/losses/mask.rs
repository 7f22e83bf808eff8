//! Which pixels of the novel view are supervised (paper, masked losses).

use super::{LossOptions, MaskSky};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use sharp::camera::{Intrinsics, RigidTransform};

/// Half the field of view of the input, normalised, that counts as seen.
const MARGIN: f64 = 1.05;

/// Whether each pixel of the novel view, lifted by its true `depth` (metres, row-major; +∞ is sky, 0
/// unknown), lies in the slightly widened field of view of the input view. Nothing tests for
/// occlusion. A pixel of unknown depth is left out.
///
/// # Panics
/// When `depth` is not of the novel view's size.
pub fn novel_mask(
    depth: &[f32],
    novel: &Intrinsics,
    input: &Intrinsics,
    input_from_novel: &RigidTransform,
    options: &LossOptions,
) -> Vec<bool> {
    let width = novel.width as usize;
    assert_eq!(
        depth.len(),
        width * novel.height as usize,
        "pixels of the depth"
    );
    let ndc = input.ndc_from_camera();
    let rotation: DMat3 = ndc * input_from_novel.rotation * novel.matrix().inverse();
    let translation = ndc * input_from_novel.translation;
    let inside = |p: DVec3| {
        let before = p.z > 0.0 || (p.z < 0.0 && !options.mask_in_front);
        before && (p.x / p.z).abs() <= MARGIN && (p.y / p.z).abs() <= MARGIN
    };
    let one = |(p, depth): (usize, &f32)| {
        let pixel = DVec3::new((p % width) as f64 + 0.5, (p / width) as f64 + 0.5, 1.0);
        let ray = rotation * pixel;
        match *depth {
            f32::INFINITY => options.mask_sky == MaskSky::Direction && inside(ray),
            depth => depth > 0.0 && inside(ray * f64::from(depth) + translation),
        }
    };
    let pixels = depth.par_iter().enumerate().with_min_len(super::CHUNK);
    pixels.map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bits of a row of pixels of `depth`, seen from an input camera moved by `x` and `z`.
    fn row(depth: [f32; 4], x: f64, z: f64, options: &LossOptions) -> [u8; 4] {
        // f is half the width, so that x/z is the normalised coordinate: −0.75, −0.25, 0.25, 0.75.
        let camera = Intrinsics::new((2.0, 0.5), (2.0, 0.5), (4, 1)).unwrap();
        let moved = RigidTransform {
            rotation: DMat3::IDENTITY,
            translation: DVec3::new(x, 0.0, z),
        };
        let mask = novel_mask(&depth, &camera, &camera, &moved, options);
        [0, 1, 2, 3].map(|p: usize| u8::from(mask[p]))
    }

    #[test]
    fn hand_cases() {
        let options = LossOptions::default();
        assert_eq!(row([2.0; 4], 0.0, 0.0, &options), [1; 4]);
        assert_eq!(
            row([2.0, 2.0, 0.0, f32::NAN], 0.0, 0.0, &options),
            [1, 1, 0, 0]
        );
        // At 1 m, 0.29 m to the side: 1.04 stays, and 0.31 m: 1.06 does not.
        assert_eq!(row([1.0; 4], 0.29, 0.0, &options), [1; 4]);
        assert_eq!(row([1.0; 4], 0.31, 0.0, &options), [1, 1, 1, 0]);
        // Sky is only turned, not moved.
        let sky = f32::INFINITY;
        assert_eq!(row([sky; 4], 5.0, 0.0, &options), [1; 4]);
        let without = LossOptions {
            mask_sky: MaskSky::LeftOut,
            ..LossOptions::default()
        };
        assert_eq!(row([sky, 2.0, sky, 2.0], 0.0, 0.0, &without), [0, 1, 0, 1]);
        // Behind the input camera, whose formula holds all the same.
        assert_eq!(row([1.0; 4], 0.0, -3.0, &options), [0; 4]);
        let formula = LossOptions {
            mask_in_front: false,
            ..options
        };
        assert_eq!(row([1.0; 4], 0.0, -3.0, &formula), [1; 4]);
    }
}
