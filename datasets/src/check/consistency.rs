//! Consistency of poses, depth and pictures: the depth and the colours of one view, projected into
//! the next by the poses, must match those of the next view. Depth decides if the two views are far
//! apart. If they are close together, depth agrees under any pose, so colour decides.

use serde::Serialize;

/// Poses and depth are consistent if at least this fraction of the overlapping depths agree in one pair of neighbours.
/// Occlusion lowers the fraction even for correct poses; in wrongly interpreted real frames, a fifth agree.
const MIN_AGREEING: f64 = 0.3;

/// Agreement of neighbouring views under one pose convention.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fit {
    /// Text that says how this convention differs from the reader's own; `as read` for the reader's
    /// own.
    pub convention: &'static str,
    /// Fraction of depth values that agree within 5 %, 0..1.
    pub depth: f64,
    /// Root mean square colour difference, in 8-bit levels, over the depth values that land inside
    /// the other picture, except those that land on a different depth; `None` if there are none.
    pub colour_levels: Option<f64>,
    pub colours: usize,
}

/// Consistency of a scene's poses, depth and pictures, with pictures reduced to a width of at most 256.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Consistency {
    /// Fit of the poses as interpreted by the reader.
    pub as_read: Fit,
    /// Fits of the poses under other conventions that are commonly confused with the reader's.
    pub otherwise: Vec<Fit>,
    /// Fraction of agreeing values among the depth values that land on a pixel with depth in the
    /// other view, in the best pair. `None` if too few values do (neighbours that see different
    /// things, or sparse depth).
    pub meeting: Option<f64>,
    /// Number of pairs of views that were examined.
    pub pairs: usize,
}

impl Consistency {
    /// Describes a contradiction between poses and depth. A scene whose neighbouring views hardly overlap is not
    /// reported.
    pub(super) fn disagreement(&self) -> Option<String> {
        let meeting = self.meeting.filter(|meeting| *meeting < MIN_AGREEING)?;
        Some(format!(
            "poses and depth are inconsistent: at most {:.0} % of depths agree between neighbouring views; the pose \
             convention, the unit of depth or poses, or the intrinsics may be wrong",
            100.0 * meeting
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::View;
    use crate::check::THOROUGH;
    use crate::check::advice::Units;
    use crate::check::convention::flip;
    use crate::check::neighbours::Neighbours;
    use crate::check::tests::{Pixels, change};
    use crate::synthetic::{SyntheticOptions, SyntheticScene};
    use glam::{DMat3, DVec3};
    use image::{GrayImage, Luma};
    use sharp::camera::RigidTransform;

    /// Views on an arc; with `spread` 1 it is so wide that, under a wrong convention, views no longer see each other's
    /// content.
    fn views(spread: f64) -> Vec<View> {
        let scene = SyntheticScene::new(SyntheticOptions {
            width: 128,
            height: 96,
            views: 2,
            ..SyntheticOptions::default()
        })
        .unwrap();
        let k = scene.views()[0].intrinsics;
        let lens = crate::lens::Lens::new(
            (k.fx, k.fy),
            (k.cx, k.cy),
            (k.width, k.height),
            crate::lens::Distortion::None,
        )
        .unwrap();
        (0..4)
            .map(|i| {
                let angle = spread * (0.25 * f64::from(i) - 0.4);
                let center = DVec3::new(-1.5 * angle, -0.2, spread * 0.1 * f64::from(i));
                let rotation = DMat3::from_rotation_y(-angle) * DMat3::from_rotation_x(0.15);
                let pose = RigidTransform {
                    rotation,
                    translation: -(rotation * center),
                };
                scene.view_through(&format!("v{i}"), lens, pose)
            })
            .collect()
    }

    fn of(views: &[View]) -> Consistency {
        Neighbours::new(views, THOROUGH)
            .unwrap()
            .consistency()
            .unwrap()
    }

    fn complaint(views: &[View]) -> Option<String> {
        let neighbours = Neighbours::new(views, THOROUGH).unwrap();
        neighbours.contradictions(Units::default())
    }

    fn taken(views: &[View], take: fn(&RigidTransform) -> RigidTransform) -> Option<String> {
        let mut wrong = views.to_vec();
        for view in &mut wrong {
            view.camera_from_world = take(&view.camera_from_world);
        }
        complaint(&wrong)
    }

    #[test]
    fn right_poses_pass_and_wrong_conventions_are_named() {
        let views = views(1.0);
        let right = of(&views);
        assert!(right.as_read.depth > 0.5, "{right:?}");
        assert_eq!(complaint(&views), None);
        let inverted = taken(&views, RigidTransform::inverse).unwrap();
        assert!(inverted.contains("swapped"), "{inverted}");
        let flipped = taken(&views, flip).unwrap();
        assert!(flipped.contains("OpenGL"), "{flipped}");
    }

    /// Neighbours a few centimetres apart: depth agrees under every convention, colours do not.
    #[test]
    fn wrong_conventions_are_named_at_small_baselines_too() {
        let views = views(0.1);
        assert_eq!(complaint(&views), None);
        for (take, name) in [
            (
                RigidTransform::inverse as fn(&_) -> _,
                "world-to-camera swapped (",
            ),
            (flip, "OpenGL"),
            (|pose| flip(&pose.inverse()), "world-to-camera swapped ("),
            (|pose| flip(pose).inverse(), "swapped, and also OpenGL"),
        ] {
            let complaint = taken(&views, take).unwrap();
            assert!(complaint.contains(name), "{name}: {complaint}");
        }
    }

    /// Excludes a block, like a mask.
    fn mask(pixels: &mut Pixels) {
        let is_excluded = |x: u32| (30..80).contains(&x);
        let level = |x, _| Luma([if is_excluded(x) { 0 } else { 255 }]);
        pixels.valid = Some(GrayImage::from_fn(128, 96, level));
        let picture = pixels.picture.enumerate_pixels_mut();
        picture
            .filter(|p| is_excluded(p.0))
            .for_each(|p| p.2.0 = [0; 3]);
        let depth = pixels
            .depth
            .iter_mut()
            .flat_map(|depth| depth.enumerate_pixels_mut());
        depth
            .filter(|p| is_excluded(p.0))
            .for_each(|p| p.2.0 = [0.0]);
    }

    /// Black masked pixels in every other view must not be compared.
    #[test]
    fn what_masks_exclude_is_not_compared() {
        let plain = views(0.1);
        let mut masked = plain.clone();
        masked
            .chunks_mut(2)
            .for_each(|two| change(&mut two[1..], mask));
        let levels = |views: &[View]| of(views).as_read.colour_levels.unwrap();
        assert!(
            levels(&masked) < 1.5 * levels(&plain),
            "{}",
            levels(&masked)
        );
        assert_eq!(complaint(&masked), None);
        let complaint = taken(&masked, RigidTransform::inverse).unwrap();
        assert!(
            complaint.contains("world-to-camera swapped ("),
            "{complaint}"
        );
    }
}
