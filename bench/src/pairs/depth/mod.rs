//! Depth maps with their cameras, and sources of depth.
//!
//! * [`given`]: user-supplied maps.
//! * [`predicted`]: predictions of a checkpoint of SHARP or Depth Pro.

pub mod given;
pub mod predicted;

use std::path::PathBuf;

use sharp::camera::{Intrinsics, RigidTransform};
use sharp_datasets::{DepthMap, Scene, View};

pub use self::given::GivenDepth;
pub use self::predicted::{DepthNetwork, PredictedDepth};
use super::PairError;
use super::alignment::median_scale;
use super::valid_depth::{is_valid_depth, median_of};

/// Source of the depth used for overlap.
pub trait DepthSource: Sync {
    /// Depth of a view at the size of its photograph; `None` if the view has no depth.
    fn depth(&self, scene: &Scene, view: &View) -> Result<Option<DepthMap>, PairError>;

    /// Stable name for the record of a run (`ground-truth`, …).
    fn name(&self) -> String;

    /// Files outside the dataset that a view's depth is read from.
    fn files(&self, _scene: &Scene, _view: &View) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Whether several views may be requested at the same time.
    fn in_parallel(&self) -> bool {
        true
    }
}

#[derive(Debug, Clone, Copy, Default)]
pub struct GroundTruthDepth;

impl DepthSource for GroundTruthDepth {
    fn depth(&self, _scene: &Scene, view: &View) -> Result<Option<DepthMap>, PairError> {
        Ok(view.content.depth()?)
    }

    fn name(&self) -> String {
        "ground-truth".to_owned()
    }
}

/// Dense predicted depth, scaled to the dataset's sparse depth by the median of their ratios, as in the paper for
/// ETH3D.
#[derive(Debug, Clone)]
pub struct ScaledToGroundTruth<S>(
    /// The dense prediction.
    pub S,
);

impl<S: DepthSource> DepthSource for ScaledToGroundTruth<S> {
    fn depth(&self, scene: &Scene, view: &View) -> Result<Option<DepthMap>, PairError> {
        let (Some(mut dense), Some(sparse)) = (self.0.depth(scene, view)?, view.content.depth()?)
        else {
            return Ok(None);
        };
        let scale = median_scale(&sparse, &dense)?.scale as f32;
        for depth in dense.iter_mut() {
            *depth *= scale;
        }
        Ok(Some(dense))
    }

    fn name(&self) -> String {
        format!("{},median-scaled-to-ground-truth", self.0.name())
    }

    fn files(&self, scene: &Scene, view: &View) -> Vec<PathBuf> {
        self.0.files(scene, view)
    }

    fn in_parallel(&self) -> bool {
        self.0.in_parallel()
    }
}

#[derive(Debug, Clone)]
pub struct PosedDepth {
    intrinsics: Intrinsics,
    camera_from_world: RigidTransform,
    depth: DepthMap,
}

impl PosedDepth {
    /// Combines a view's camera with a depth map of the size of its image.
    pub fn of_view(view: &View, depth: DepthMap) -> Result<Self, PairError> {
        Self::new(&view.id, view.intrinsics, view.camera_from_world, depth)
    }

    /// Combines a camera with a depth map of the size of its image. `what` names the view in errors.
    pub fn new(
        what: &str,
        intrinsics: Intrinsics,
        camera_from_world: RigidTransform,
        depth: DepthMap,
    ) -> Result<Self, PairError> {
        let camera = (intrinsics.width, intrinsics.height);
        if depth.dimensions() != camera {
            return Err(PairError::DepthSize {
                what: what.to_owned(),
                depth: depth.dimensions(),
                camera,
            });
        }
        Ok(Self {
            intrinsics,
            camera_from_world,
            depth,
        })
    }

    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    pub fn camera_from_world(&self) -> &RigidTransform {
        &self.camera_from_world
    }

    /// z-depth in metres; 0, negative, infinite and NaN are invalid.
    pub fn depth(&self) -> &DepthMap {
        &self.depth
    }

    /// The same view with its longer side reduced to at most `max_side` pixels by nearest-pixel sampling.
    #[must_use]
    pub fn reduced(self, max_side: u32) -> Self {
        let (w, h) = self.depth.dimensions();
        if w.max(h) <= max_side {
            return self;
        }
        let factor = f64::from(max_side) / f64::from(w.max(h));
        let side = |full: u32| ((f64::from(full) * factor).round() as u32).max(1);
        let (small_w, small_h) = (side(w), side(h));
        let nearest = |i: u32, small: u32, full: u32| {
            let centre = (f64::from(i) + 0.5) * f64::from(full) / f64::from(small);
            (centre as u32).min(full - 1)
        };
        let depth = DepthMap::from_fn(small_w, small_h, |x, y| {
            *self
                .depth
                .get_pixel(nearest(x, small_w, w), nearest(y, small_h, h))
        });
        Self {
            intrinsics: self.intrinsics.resized(small_w, small_h),
            camera_from_world: self.camera_from_world,
            depth,
        }
    }
}

/// Median of the valid depths, metres; `None` if there are none. For an even count, the mean of the two middle values.
pub fn median_depth_m(depth: &DepthMap) -> Option<f64> {
    let valid = depth.iter().copied().filter(|d| is_valid_depth(*d));
    median_of(valid.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn median_depth_ignores_what_is_invalid() {
        let values = vec![0.0, 4.0, f32::INFINITY, 1.0, f32::NAN, 2.0];
        let depth = DepthMap::from_vec(3, 2, values).unwrap();
        assert_eq!(median_depth_m(&depth), Some(2.0));
        let even = DepthMap::from_vec(2, 1, vec![1.0, 2.0]).unwrap();
        assert_eq!(median_depth_m(&even), Some(1.5));
        // No f32 lies between these two neighbours. Their mean is computed in f64 and equals neither.
        let next = 1.0_f32.next_up();
        let even = DepthMap::from_vec(2, 2, vec![next, 0.5, 1.0, 9.0]).unwrap();
        assert_eq!(median_depth_m(&even), Some(0.5 + 0.5 * f64::from(next)));
        assert_eq!(median_depth_m(&DepthMap::new(2, 2)), None);
    }

    #[test]
    fn a_reduced_view_takes_the_pixel_under_each_centre() {
        let intrinsics = Intrinsics::new((8.0, 8.0), (4.0, 2.0), (8, 4)).unwrap();
        let depth = DepthMap::from_fn(8, 4, |x, y| Luma([(10 * y + x + 1) as f32]));
        let view = PosedDepth::new("v", intrinsics, RigidTransform::IDENTITY, depth).unwrap();
        let small = view.clone().reduced(4);
        assert_eq!(small.depth().dimensions(), (4, 2));
        assert_eq!(
            small.depth().as_raw(),
            &[12.0, 14.0, 16.0, 18.0, 32.0, 34.0, 36.0, 38.0]
        );
        assert_eq!(small.intrinsics().cx, 2.0);
        assert_eq!(view.reduced(8).depth().dimensions(), (8, 4));
    }

    #[test]
    fn sizes_that_disagree_are_refused() {
        let intrinsics = Intrinsics::new((8.0, 8.0), (4.0, 2.0), (8, 4)).unwrap();
        let error = PosedDepth::new(
            "scene/im0",
            intrinsics,
            RigidTransform::IDENTITY,
            DepthMap::new(4, 4),
        )
        .unwrap_err();
        assert_eq!(
            error.to_string(),
            "scene/im0: depth is 4x4, but the camera's image is 8x4"
        );
    }
}
