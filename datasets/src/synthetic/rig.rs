//! The cameras: one in the centre, the others on three concentric rings around it.

use glam::{DMat3, DVec3};
use sharp::camera::{Intrinsics, RigidTransform};

use super::arithmetic::unit_circle;

const RINGS: usize = 3;

/// Positions, viewing directions and lens of the cameras.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rig {
    /// Radius of the outer ring in metres.
    pub(super) outer_radius_m: f64,
    /// Point at which all cameras look, in metres.
    pub(super) target: DVec3,
    /// Focal length in widths of the picture.
    pub(super) focal: f64,
    /// Principal point, in widths and heights of the picture; off centre, as in real cameras.
    pub(super) center: (f64, f64),
}

impl Rig {
    /// With this radius, no two cameras are more than 60 cm apart, even though some are moved forward by 2 cm.
    pub(super) const WIDEST_RADIUS_M: f64 = 0.2995;

    /// Rig of the classic scene, with a horizontal field of view of 58 degrees.
    pub(super) const CLASSIC: Self = Self {
        outer_radius_m: Self::WIDEST_RADIUS_M,
        target: DVec3::new(0.1, 0.15, 4.0),
        focal: 0.9,
        center: (0.508, 0.489),
    };

    pub(super) fn intrinsics(&self, width: u32, height: u32) -> Intrinsics {
        let (w, h) = (f64::from(width), f64::from(height));
        Intrinsics {
            fx: self.focal * w,
            fy: self.focal * w,
            cx: self.center.0 * w,
            cy: self.center.1 * h,
            width,
            height,
        }
    }

    /// Poses (world to camera) of `count` cameras, from the centre outwards. The number of cameras
    /// on a ring is proportional to the ring's radius.
    pub(super) fn poses(&self, count: usize) -> Vec<RigidTransform> {
        let centers = self.centers(count).into_iter();
        centers.map(|center| self.look_from(center)).collect()
    }

    /// Positions of the cameras.
    pub(super) fn centers(&self, count: usize) -> Vec<DVec3> {
        let mut centers = vec![DVec3::ZERO];
        let around = count.saturating_sub(1);
        let weights = RINGS * (RINGS + 1) / 2;
        let mut placed = 0;
        for ring in 1..=RINGS {
            let up_to = around * (ring * (ring + 1) / 2) / weights;
            let on_ring = up_to - placed;
            placed = up_to;
            let radius = self.outer_radius_m * ring as f64 / RINGS as f64;
            for i in 0..on_ring {
                // Rings are rotated relative to each other, so that cameras do not line up in spokes.
                let turns = i as f64 / on_ring as f64 + 0.07 * ring as f64;
                let (c, s) = unit_circle(turns);
                // The cameras are not quite in a plane: every other camera is moved forward by 2
                // cm.
                let forward = if i % 2 == 0 { 0.0 } else { 0.02 };
                centers.push(DVec3::new(radius * c, radius * s, forward));
            }
        }
        centers
    }

    fn look_from(&self, center: DVec3) -> RigidTransform {
        let forward = (self.target - center).normalize();
        let right = DVec3::Y.cross(forward).normalize();
        let down = forward.cross(right);
        let rotation = DMat3::from_cols(right, down, forward).transpose();
        RigidTransform {
            rotation,
            translation: -(rotation * center),
        }
    }
}
