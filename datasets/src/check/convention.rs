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

/// Axes that are negated by mistake; no other program's convention.
pub(super) const MIRRORED: [Convention; 8] = [
    Convention {
        name: "the cameras' x axis negated (pictures mirrored left to right, or a left-handed system)",
        take: |pose| camera_mirrored(pose, DVec3::new(-1.0, 1.0, 1.0)),
    },
    Convention {
        name: "the cameras' y axis negated (pictures upside down, or a left-handed system)",
        take: |pose| camera_mirrored(pose, DVec3::new(1.0, -1.0, 1.0)),
    },
    Convention {
        name: "the cameras' z axis negated (a left-handed system)",
        take: |pose| camera_mirrored(pose, DVec3::new(1.0, 1.0, -1.0)),
    },
    Convention {
        name: "the cameras' x and y axes negated (pictures turned by 180 degrees)",
        take: |pose| camera_mirrored(pose, DVec3::new(-1.0, -1.0, 1.0)),
    },
    Convention {
        name: "the translations negated",
        take: |pose| RigidTransform {
            translation: -pose.translation,
            ..*pose
        },
    },
    Convention {
        name: "the x of the cameras' places negated",
        take: |pose| places_mirrored(pose, DVec3::new(-1.0, 1.0, 1.0)),
    },
    Convention {
        name: "the y of the cameras' places negated",
        take: |pose| places_mirrored(pose, DVec3::new(1.0, -1.0, 1.0)),
    },
    Convention {
        name: "the z of the cameras' places negated",
        take: |pose| places_mirrored(pose, DVec3::new(1.0, 1.0, -1.0)),
    },
];

/// The pose of a mirrored camera in a mirrored world.
fn camera_mirrored(pose: &RigidTransform, signs: DVec3) -> RigidTransform {
    let axes = DMat3::from_diagonal(signs);
    RigidTransform {
        rotation: axes * pose.rotation * axes,
        translation: axes * pose.translation,
    }
}

/// The camera, turned as it is, in a mirrored place.
fn places_mirrored(pose: &RigidTransform, signs: DVec3) -> RigidTransform {
    let place = pose.rotation.transpose() * pose.translation;
    RigidTransform {
        translation: pose.rotation * (signs * place),
        ..*pose
    }
}

/// The camera's y and z axes reversed.
pub(super) fn flip(camera_from_world: &RigidTransform) -> RigidTransform {
    let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    RigidTransform {
        rotation: axes * camera_from_world.rotation,
        translation: axes * camera_from_world.translation,
    }
}
