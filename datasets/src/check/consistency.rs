//! Whether poses and depth agree: depth of one view, carried into the next by the poses, must meet
//! that view's depth. Poses read in the wrong convention fail this by a wide margin, and the
//! convention that would have passed can be named.

use glam::{DMat3, DVec2, DVec3};
use serde::Serialize;
use sharp::camera::RigidTransform;

use super::evenly_spaced;
use crate::{DepthMap, View};

/// Pairs of neighbouring views that are looked at.
const PAIRS: usize = 4;
/// Depth values of a view that are carried over.
const SAMPLES: usize = 20_000;
/// Relative difference up to which depths agree.
const TOLERANCE: f64 = 0.05;
/// Depths that meet must agree at least this often in one pair of neighbours. Occlusion costs the
/// right poses some of it; on real frames read wrongly a fifth agrees.
const LEAST: f64 = 0.3;
/// Fewer depths that meet say nothing about a pair.
const ENOUGH: f64 = 0.05;

/// The share of depth values that agree, by how the poses are taken; 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// As the reader takes them.
    pub as_read: f64,
    /// World-to-camera and camera-to-world exchanged.
    pub inverted: f64,
    /// Camera axes of OpenGL instead of OpenCV, or the other way round.
    pub flipped_axes: f64,
    /// Of the depth values that meet one of the other view, the share that agrees, in the pair in
    /// which it is largest; `None` where too few meet (neighbours that see different things, or
    /// sparse depth).
    pub meeting: Option<f64>,
    /// There: the median of the other view's depth over the depth carried to it, 1 where poses and
    /// depth have the same unit.
    pub unit_ratio: Option<f64>,
    /// Pairs of views that were looked at.
    pub pairs: usize,
}

impl Consistency {
    /// What looks wrong, if anything does. A scene whose neighbouring views hardly overlap has a
    /// low share in every convention and is no reason to complain.
    pub fn complaint(&self) -> Option<String> {
        let better = |other: f64| other > 0.2 && other > 1.5 * self.as_read;
        let guess = if better(self.inverted) && self.inverted >= self.flipped_axes {
            "camera-to-world and world-to-camera exchanged"
        } else if better(self.flipped_axes) {
            "OpenGL's camera axes taken for OpenCV's, or the other way round"
        } else {
            return self.disagreement();
        };
        Some(format!(
            "the pose convention looks wrong: {:.0} % of depths agree between neighbouring views; \
             with {guess} it would be {:.0} %",
            100.0 * self.as_read,
            100.0 * self.inverted.max(self.flipped_axes)
        ))
    }
}

impl Consistency {
    /// Poses that no other convention explains.
    fn disagreement(&self) -> Option<String> {
        let (meeting, ratio) = (self.meeting?, self.unit_ratio?);
        (meeting < LEAST).then(|| {
            format!(
                "poses and depth do not fit together: of the depths that meet in neighbouring \
                 views at most {:.0} % agree, and the other view's is {ratio:.3} times as large in \
                 the median; the pose convention looks wrong, or the unit of depth or poses, or \
                 the intrinsics",
                100.0 * meeting
            )
        })
    }
}

/// Measures neighbouring views of a scene; `None` when no two of them have depth that can be read.
pub fn of(views: &[View]) -> Option<Consistency> {
    let mut sum = [0.0; 3];
    let mut best: Option<(f64, f64)> = None;
    let mut pairs = 0;
    for i in evenly_spaced(views.len().saturating_sub(1), PAIRS) {
        let (a, b) = (&views[i], &views[i + 1]);
        let (Ok(Some(depth_a)), Ok(Some(depth_b))) = (a.content.depth(), b.content.depth()) else {
            continue;
        };
        let hypotheses: [fn(&RigidTransform) -> RigidTransform; 3] =
            [|pose| *pose, RigidTransform::inverse, flip];
        let mut meetings = Vec::with_capacity(3);
        for take in hypotheses {
            let pose_a = take(&a.camera_from_world);
            let b_from_a = take(&b.camera_from_world).after(&pose_a.inverse());
            meetings.extend(meet((a, &depth_a), (b, &depth_b), &b_from_a));
        }
        let [as_read, _, _] = meetings.as_slice() else {
            continue;
        };
        if let Some(found) = as_read.agreeing_where_met()
            && best.is_none_or(|best| found.0 > best.0)
        {
            best = Some(found);
        }
        pairs += 1;
        for (sum, meeting) in sum.iter_mut().zip(&meetings) {
            *sum += meeting.agreement();
        }
    }
    (pairs > 0).then(|| Consistency {
        as_read: sum[0] / pairs as f64,
        inverted: sum[1] / pairs as f64,
        flipped_axes: sum[2] / pairs as f64,
        meeting: best.map(|best| best.0),
        unit_ratio: best.map(|best| best.1),
        pairs,
    })
}

/// The camera's y and z axes reversed.
fn flip(camera_from_world: &RigidTransform) -> RigidTransform {
    let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    RigidTransform {
        rotation: axes * camera_from_world.rotation,
        translation: axes * camera_from_world.translation,
    }
}

/// Depth values of one view carried into another.
struct Meeting {
    samples: usize,
    /// The other view's depth over the one carried there, where it has any.
    ratios: Vec<f64>,
}

impl Meeting {
    fn agreeing(&self) -> usize {
        let fits = |ratio: &&f64| (**ratio - 1.0).abs() <= TOLERANCE;
        self.ratios.iter().filter(fits).count()
    }

    /// The share of all samples that agrees.
    fn agreement(&self) -> f64 {
        self.agreeing() as f64 / self.samples as f64
    }

    /// The share of those that meet a depth, and the median ratio; `None` where too few do.
    fn agreeing_where_met(&self) -> Option<(f64, f64)> {
        let met = self.ratios.len();
        if (met as f64) < ENOUGH * self.samples as f64 || met == 0 {
            return None;
        }
        let mut sorted = self.ratios.clone();
        sorted.sort_by(f64::total_cmp);
        Some((self.agreeing() as f64 / met as f64, sorted[met / 2]))
    }
}

/// Carries a's sampled depth values into b; `None` when a has none.
fn meet(
    (a, depth_a): (&View, &DepthMap),
    (b, depth_b): (&View, &DepthMap),
    b_from_a: &RigidTransform,
) -> Option<Meeting> {
    let valid = depth_a.iter().filter(|z| **z > 0.0).count();
    let stride = valid.div_ceil(SAMPLES).max(1);
    let mut meeting = Meeting {
        samples: 0,
        ratios: Vec::new(),
    };
    let with_depth = depth_a.enumerate_pixels().filter(|(_, _, z)| z.0[0] > 0.0);
    for (x, y, z) in with_depth.step_by(stride) {
        meeting.samples += 1;
        let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let point = b_from_a.apply(a.intrinsics.unproject(center, f64::from(z.0[0])));
        let Some(place) = b.intrinsics.project(point) else {
            continue;
        };
        if !b.intrinsics.contains(place) {
            continue;
        }
        let there = f64::from(depth_b.get_pixel(place.x as u32, place.y as u32).0[0]);
        if there > 0.0 {
            meeting.ratios.push(there / point.z);
        }
    }
    (meeting.samples > 0).then_some(meeting)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{SyntheticOptions, SyntheticScene};

    /// Views on a wide arc, so that a wrong convention moves them out of each other's sight.
    fn views() -> Vec<View> {
        let scene = SyntheticScene::new(SyntheticOptions {
            width: 64,
            height: 48,
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
                let angle = 0.25 * f64::from(i) - 0.4;
                let center = DVec3::new(-1.5 * angle, -0.2, 0.1 * f64::from(i));
                let rotation = DMat3::from_rotation_y(-angle) * DMat3::from_rotation_x(0.15);
                let pose = RigidTransform {
                    rotation,
                    translation: -(rotation * center),
                };
                scene.view_through(&format!("v{i}"), lens, pose)
            })
            .collect()
    }

    #[test]
    fn right_poses_pass_and_wrong_conventions_are_named() {
        let views = views();
        let right = of(&views).unwrap();
        assert!(right.as_read > 0.5, "{right:?}");
        assert!(right.complaint().is_none(), "{right:?}");
        let taken = |take: fn(&RigidTransform) -> RigidTransform| {
            let mut wrong = views.clone();
            for view in &mut wrong {
                view.camera_from_world = take(&view.camera_from_world);
            }
            of(&wrong).unwrap().complaint().unwrap()
        };
        let inverted = taken(RigidTransform::inverse);
        assert!(inverted.contains("exchanged"), "{inverted}");
        let flipped = taken(flip);
        assert!(flipped.contains("OpenGL"), "{flipped}");
    }
}
