//! The ways in which poses are commonly mistaken.

use glam::{DMat3, DVec3};
use sharp::camera::RigidTransform;

/// Another way to interpret the poses.
pub(super) struct Convention {
    /// The mistake that the reader would have made.
    pub(super) name: &'static str,
    /// The world-to-camera pose under it.
    pub(super) take: fn(&RigidTransform) -> RigidTransform,
}

/// What poses are compared under; the first is what the reader says.
pub(super) const CONVENTIONS: [Convention; 4] = [
    Convention {
        name: "as read",
        take: |pose| *pose,
    },
    Convention {
        name: "camera-to-world and world-to-camera exchanged",
        take: RigidTransform::inverse,
    },
    Convention {
        name: "OpenGL's camera axes taken for OpenCV's, or the other way round",
        take: flip,
    },
    // The other order, axes first, is the exchange alone but for the world's axes.
    Convention {
        name: "camera-to-world and world-to-camera exchanged, and OpenGL's camera axes",
        take: |pose| flip(&pose.inverse()),
    },
];

/// The camera's y and z axes reversed.
pub(super) fn flip(camera_from_world: &RigidTransform) -> RigidTransform {
    let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    RigidTransform {
        rotation: axes * camera_from_world.rotation,
        translation: axes * camera_from_world.translation,
    }
}
