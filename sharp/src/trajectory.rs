//! Camera paths: the SHARP release's four, and a manually shifted camera.
//!
//! All paths stay close to the photograph's own camera, which is at the origin of the scene and looks along +z. Their
//! extent is proportional to the near depth of the scene.

use crate::camera::{Intrinsics, RigidTransform};
use crate::gaussians::Gaussians;
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::TAU;

/// The SHARP release's paths. Each path includes both ends, so that the last frame of a closed path
/// equals the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrajectoryKind {
    /// Sideways along a sine, forward and back along half a cosine. The SHARP release's default.
    RotateForward,
    /// A circle perpendicular to the viewing direction.
    Rotate,
    /// From left to right along a line.
    Swipe,
    /// Moves left and right in the first half of the path, up and down in the second.
    Shake,
}

impl TrajectoryKind {
    /// All kinds, in the SHARP release's order.
    pub const ALL: [Self; 4] = [Self::Swipe, Self::Shake, Self::Rotate, Self::RotateForward];

    /// `rotate_forward`, `rotate`, `swipe` or `shake`.
    pub fn name(self) -> &'static str {
        match self {
            Self::RotateForward => "rotate_forward",
            Self::Rotate => "rotate",
            Self::Swipe => "swipe",
            Self::Shake => "shake",
        }
    }
}

/// Maximum shift in x and y, as a fraction of d · near depth, where d is the picture's diagonal divided by the focal
/// length.
const MAX_DISPARITY: f64 = 0.08;
/// Maximum shift in z, as a fraction of the near depth.
const MAX_ZOOM: f64 = 0.15;

/// One pass of a path at the SHARP release's amplitude. The camera looks at the focus point on the photograph's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trajectory {
    pub kind: TrajectoryKind,
    /// Number of frames, > 0.
    pub steps: usize,
}

/// Depth range of a scene: quantiles of the z of all centres or pixels in front of the camera, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthRange {
    /// The 0.001 quantile of z, in metres.
    pub near: f64,
    /// The 0.1 quantile, at least 2 m; the distance of the point around which the camera turns.
    pub focus: f64,
    /// The 0.999 quantile of z, in metres.
    pub far: f64,
}

impl DepthRange {
    /// Minimum focus distance of the SHARP release, in metres.
    pub const MIN_FOCUS: f64 = 2.0;

    /// Measures a scene in the photograph's camera space; `None` if no finite centre lies in front of the camera.
    pub fn of(scene: &Gaussians) -> Option<Self> {
        Self::seen_from(scene, &DAffine3::IDENTITY)
    }

    /// Measures a scene given in any space, from the photograph's camera; `None` if no finite centre lies in front of
    /// the camera.
    pub fn seen_from(scene: &Gaussians, camera_from_scene: &DAffine3) -> Option<Self> {
        let z = |mean: &[f32; 3]| {
            let point = DVec3::from(mean.map(f64::from));
            camera_from_scene.transform_point3(point).z as f32
        };
        Self::of_depths(scene.means.iter().map(z))
    }

    /// Measures z values in metres; `None` if no value is finite and above 0.
    pub fn of_depths(depths: impl IntoIterator<Item = f32>) -> Option<Self> {
        let depths = depths.into_iter();
        let mut depths: Vec<f32> = depths.filter(|z| *z > 0.0 && z.is_finite()).collect();
        if depths.is_empty() {
            return None;
        }
        depths.sort_unstable_by(f32::total_cmp);
        // Interpolated linearly between order statistics.
        let quantile = |share: f64| {
            let at = share * (depths.len() - 1) as f64;
            let (low, rest) = (at.floor() as usize, at.fract());
            let high = (low + 1).min(depths.len() - 1);
            let (low, high) = (f64::from(depths[low]), f64::from(depths[high]));
            low + rest * (high - low)
        };
        Some(Self {
            near: quantile(0.001),
            focus: quantile(0.1).max(Self::MIN_FOCUS),
            far: quantile(0.999),
        })
    }
}

impl Trajectory {
    /// Camera position in each frame, in the photograph's camera space, in metres.
    pub fn eyes(&self, camera: &Intrinsics, depth: &DepthRange) -> Vec<DVec3> {
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let diagonal = (w / camera.fx).hypot(h / camera.fx);
        let side = MAX_DISPARITY * diagonal * depth.near;
        let forward = MAX_ZOOM * depth.near;
        let frames = self.steps;
        let circle = |frame: usize, frames: usize| TAU * linspace(0.0, 1.0, frame, frames);
        (0..frames)
            .map(|frame| match self.kind {
                TrajectoryKind::RotateForward => {
                    let t = circle(frame, frames);
                    DVec3::new(side * t.sin(), 0.0, forward * (1.0 - t.cos()) / 2.0)
                }
                TrajectoryKind::Rotate => {
                    let t = circle(frame, frames);
                    DVec3::new(side * t.sin(), side * t.cos(), 0.0)
                }
                TrajectoryKind::Swipe => DVec3::new(linspace(-side, side, frame, frames), 0.0, 0.0),
                TrajectoryKind::Shake => {
                    let first = frames / 2;
                    if frame < first {
                        DVec3::new(side * circle(frame, first).sin(), 0.0, 0.0)
                    } else {
                        let t = circle(frame - first, frames - first);
                        DVec3::new(0.0, side * t.sin(), 0.0)
                    }
                }
            })
            .collect()
    }

    /// The pose of each frame: from the camera space of the photograph to the camera space of the
    /// frame.
    pub fn poses(&self, camera: &Intrinsics, depth: &DepthRange) -> Vec<RigidTransform> {
        let focus = DVec3::new(0.0, 0.0, depth.focus);
        self.eyes(camera, depth)
            .into_iter()
            .map(|eye| looking(eye, focus))
            .collect()
    }
}

/// Pose of a camera that is `offset_m` away from the photograph's camera and looks in the same direction.
pub fn shifted(offset_m: DVec3) -> RigidTransform {
    RigidTransform {
        rotation: DMat3::IDENTITY,
        translation: -offset_m,
    }
}

/// `camera_from_world` of a camera at `eye` that looks at `target`, upright: y points down in both world and camera.
/// Looking straight up or down leaves the horizon undefined; the world's x axis then points to the right.
pub fn looking(eye: DVec3, target: DVec3) -> RigidTransform {
    let front = (target - eye).normalize_or(DVec3::Z);
    let right = front.cross(DVec3::NEG_Y).normalize_or(DVec3::X);
    let down = front.cross(right);
    let camera_from_world = DMat3::from_cols(right, down, front).transpose();
    RigidTransform {
        rotation: camera_from_world,
        translation: -(camera_from_world * eye),
    }
}

/// Element `index` of `count` values spaced evenly from `first` to `last`, both included.
fn linspace(first: f64, last: f64, index: usize, count: usize) -> f64 {
    if count < 2 {
        return first;
    }
    first + (last - first) * index as f64 / (count - 1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Intrinsics {
        Intrinsics::new((800.0, 800.0), (320.0, 240.0), (640, 480)).unwrap()
    }

    const DEPTH: DepthRange = DepthRange {
        near: 1.5,
        focus: 3.0,
        far: 40.0,
    };

    fn eyes(kind: TrajectoryKind) -> Vec<DVec3> {
        Trajectory { kind, steps: 60 }.eyes(&camera(), &DEPTH)
    }

    #[test]
    fn paths_have_the_releases_size_and_ends() {
        // 0.08 · sqrt(0.8² + 0.6²) · 1.5 sideways, 0.15 · 1.5 forward.
        let (side, forward) = (0.12, 0.225);
        let largest = |eyes: &[DVec3]| eyes.iter().fold(DVec3::ZERO, |m, e| m.max(e.abs()));
        for kind in TrajectoryKind::ALL {
            let eyes = eyes(kind);
            assert_eq!(eyes.len(), 60, "{}", kind.name());
            let expected = match kind {
                TrajectoryKind::RotateForward => DVec3::new(side, 0.0, forward),
                TrajectoryKind::Rotate | TrajectoryKind::Shake => DVec3::new(side, side, 0.0),
                TrajectoryKind::Swipe => DVec3::new(side, 0.0, 0.0),
            };
            // Samples may miss a maximum by less than half a step.
            let found = largest(&eyes);
            assert!((found - expected).abs().max_element() < 2e-3 * side.max(forward) * 10.0);
            assert!(found.cmple(expected + 1e-12).all(), "{found}");
        }
        let closed = eyes(TrajectoryKind::RotateForward);
        assert!(closed[0].length() < 1e-12 && closed[59].length() < 1e-12);
        let line = eyes(TrajectoryKind::Swipe);
        assert!((line[0].x + side).abs() < 1e-12 && (line[59].x - side).abs() < 1e-12);
        let shake = eyes(TrajectoryKind::Shake);
        assert!(shake[..30].iter().all(|e| e.y == 0.0));
        assert!(shake[30..].iter().all(|e| e.x == 0.0));
    }

    #[test]
    fn a_path_of_one_frame_stands_somewhere() {
        for kind in TrajectoryKind::ALL {
            let single = Trajectory { kind, steps: 1 };
            assert!(single.eyes(&camera(), &DEPTH)[0].is_finite());
        }
    }

    #[test]
    fn every_pose_sees_its_target_in_the_middle_and_upright() {
        for kind in TrajectoryKind::ALL {
            let path = Trajectory { kind, steps: 60 };
            let eyes = path.eyes(&camera(), &DEPTH);
            for (pose, eye) in path.poses(&camera(), &DEPTH).iter().zip(eyes) {
                assert!((pose.camera_center() - eye).length() < 1e-12);
                let seen = pose.apply(DVec3::new(0.0, 0.0, 3.0));
                assert!(seen.x.abs() < 1e-12 && seen.y.abs() < 1e-12 && seen.z > 0.0);
                assert!((pose.rotation.determinant() - 1.0).abs() < 1e-12);
                // The world's down direction stays down.
                assert!((pose.rotation * DVec3::Y).y > 0.99);
            }
        }
        assert_eq!(looking(DVec3::ZERO, DVec3::Z), RigidTransform::IDENTITY);
        let up = looking(DVec3::ZERO, DVec3::NEG_Y);
        assert!((up.rotation.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_shifted_camera_moves_the_world_the_other_way() {
        let pose = shifted(DVec3::new(0.1, 0.2, 0.3));
        assert_eq!(pose.camera_center(), DVec3::new(0.1, 0.2, 0.3));
    }

    #[test]
    fn depth_quantiles_interpolate_and_ignore_what_lies_behind() {
        let mut scene = Gaussians::default();
        for z in [-3.0, 5.0, f32::NAN, 4.0, 3.0, 0.0, 7.0, 6.0] {
            scene.means.push([0.0, 0.0, z]);
        }
        // 3, 4, 5, 6, 7: the 0.1 quantile is 0.4 of the way from 3 to 4.
        let range = DepthRange::of(&scene).unwrap();
        assert!((range.focus - 3.4).abs() < 1e-12);
        assert!((range.near - 3.004).abs() < 1e-12);
        assert!((range.far - 6.996).abs() < 1e-12);
        let nearer = DAffine3::from_translation(DVec3::new(9.0, 0.0, -1.0));
        let seen = DepthRange::seen_from(&scene, &nearer).unwrap();
        // 2, 3, 4, 5, 6: the one that was at 0 is now behind the camera.
        assert!((seen.near - 2.004).abs() < 1e-12 && (seen.far - 5.996).abs() < 1e-12);
        scene.means.truncate(1);
        assert_eq!(DepthRange::of(&scene), None);
        scene.means.push([0.0, 0.0, 0.5]);
        assert!((DepthRange::of(&scene).unwrap().focus - 2.0).abs() < 1e-12);
    }
}
