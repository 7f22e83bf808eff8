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

/// Dense predicted depth, multiplied by the median of the dataset's depth over predicted depth, as the SHARP paper does on
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
        if let Some(path) = self.0.files(scene, view).into_iter().next()
            && correlation_of_logs(&sparse, &dense).is_some_and(|of| of <= MAX_OF_INVERSE)
        {
            let reason = format!(
                "its values fall where the dataset's own depth of {}/{} rises, so they are probably inverse depth or \
                 disparity; convert them to z-depth",
                scene.id, view.id
            );
            return Err(PairError::Depth { path, reason });
        }
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

/// Maximum correlation with the logarithm of true depth at which a map counts as inverse depth.
const MAX_OF_INVERSE: f64 = -0.7;
/// Correlation is computed only if the logarithms of both maps have at least this standard deviation, so that noise cannot
/// decide.
const MIN_DEVIATION: f64 = 0.1;
/// Correlation is computed only if at least this many pixels are valid in both maps.
const MIN_CORRELATED: usize = 100;

/// Pearson correlation of the logarithms of two depth maps over the pixels at which both are valid; `None` if their sizes
/// differ, or if too few pixels or too little variation can be compared.
fn correlation_of_logs(truth: &DepthMap, other: &DepthMap) -> Option<f64> {
    let both = truth.iter().zip(other.iter());
    let both = both.filter(|(a, b)| is_valid_depth(**a) && is_valid_depth(**b));
    let logs: Vec<[f64; 2]> = both
        .map(|(a, b)| [*a, *b].map(|depth| f64::from(depth).ln()))
        .collect();
    let n = logs.len() as f64;
    if truth.dimensions() != other.dimensions() || logs.len() < MIN_CORRELATED {
        return None;
    }
    let mean = |i: usize| logs.iter().map(|of| of[i]).sum::<f64>() / n;
    let means = [mean(0), mean(1)];
    let product = |i: usize, j: usize| {
        let sum = logs
            .iter()
            .map(|of| (of[i] - means[i]) * (of[j] - means[j]));
        sum.sum::<f64>() / n
    };
    let deviations = [product(0, 0).sqrt(), product(1, 1).sqrt()];
    let varies = deviations
        .iter()
        .all(|deviation| *deviation >= MIN_DEVIATION);
    varies.then(|| product(0, 1) / (deviations[0] * deviations[1]))
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
    fn inverse_depth_is_told_from_depth() {
        let truth = DepthMap::from_fn(20, 10, |x, y| Luma([1.0 + 0.2 * (x + y) as f32]));
        let map = |of: &dyn Fn(f32) -> f32| {
            let mut map = truth.clone();
            map.iter_mut().for_each(|z| *z = of(*z));
            correlation_of_logs(&truth, &map)
        };
        let is_inverse = |of: &dyn Fn(f32) -> f32| map(of).unwrap() <= MAX_OF_INVERSE;
        assert!(is_inverse(&|z| 1.0 / z) && is_inverse(&|z| 200.0 / z + 30.0));
        assert!(!is_inverse(&|z| 5.0 * z) && !is_inverse(&|z| z * z + 3.0));
        // Neither a uniform map nor a flat scene can be judged.
        assert_eq!(map(&|_| 2.0), None);
        let flat = DepthMap::from_pixel(20, 10, Luma([2.0]));
        assert_eq!(correlation_of_logs(&flat, &truth), None);
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
