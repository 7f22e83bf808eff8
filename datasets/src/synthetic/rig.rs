//! The cameras: one in the middle, the others on three concentric rings around it.

use glam::{DMat3, DVec3};
use sharp::camera::{Intrinsics, RigidTransform};

use super::arithmetic::unit_circle;

/// Radius of the outer ring, metres: with the 2 cm that some cameras stand forward, no two are
/// more than 60 cm apart.
const OUTER_RADIUS_M: f64 = 0.2995;
/// All cameras look at this point.
const TARGET: DVec3 = DVec3::new(0.1, 0.15, 4.0);
const RINGS: usize = 3;

/// A horizontal field of view of 58 degrees and a principal point off the middle, as real cameras
/// have.
pub(super) fn intrinsics(width: u32, height: u32) -> Intrinsics {
    let (w, h) = (f64::from(width), f64::from(height));
    Intrinsics {
        fx: 0.9 * w,
        fy: 0.9 * w,
        cx: 0.508 * w,
        cy: 0.489 * h,
        width,
        height,
    }
}

/// Poses of `count` cameras (world to camera), from the middle outwards. The outer rings take
/// more of them, in proportion to their radius.
pub(super) fn poses(count: usize) -> Vec<RigidTransform> {
    let mut poses = vec![look_at_target(DVec3::ZERO)];
    let around = count.saturating_sub(1);
    let weights = RINGS * (RINGS + 1) / 2;
    let mut placed = 0;
    for ring in 1..=RINGS {
        let up_to = around * (ring * (ring + 1) / 2) / weights;
        let on_ring = up_to - placed;
        placed = up_to;
        let radius = OUTER_RADIUS_M * ring as f64 / RINGS as f64;
        for i in 0..on_ring {
            // Rings are turned against each other, so that cameras do not line up in spokes.
            let turns = i as f64 / on_ring as f64 + 0.07 * ring as f64;
            let (c, s) = unit_circle(turns);
            // Not quite in a plane: every other camera stands 2 cm forward.
            let forward = if i % 2 == 0 { 0.0 } else { 0.02 };
            poses.push(look_at_target(DVec3::new(radius * c, radius * s, forward)));
        }
    }
    poses
}

fn look_at_target(center: DVec3) -> RigidTransform {
    let forward = (TARGET - center).normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let down = forward.cross(right);
    let rotation = DMat3::from_cols(right, down, forward).transpose();
    RigidTransform {
        rotation,
        translation: -(rotation * center),
    }
}
