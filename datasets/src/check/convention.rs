//! Common mistakes in pose conventions.

use glam::{DMat3, DQuat, DVec3};
use sharp::camera::RigidTransform;

/// An alternative interpretation of the poses.
pub(super) struct Convention {
    /// How this convention differs from the reader's; completes "the poses fit better if read
    /// with".
    pub(super) name: &'static str,
    /// Converts a pose as interpreted by the reader to the world-to-camera pose under this
    /// convention.
    pub(super) take: Take,
}

type Take = fn(&RigidTransform) -> RigidTransform;

const fn of(name: &'static str, take: Take) -> Convention {
    Convention { name, take }
}

/// Conventions that are compared; the first is the one that the dataset reader assumes.
pub(super) const CONVENTIONS: [Convention; 4] = [
    of("as read", |pose| *pose),
    of(
        "camera-to-world and world-to-camera swapped",
        RigidTransform::inverse,
    ),
    of("OpenGL's and OpenCV's camera axes swapped", flip),
    // The camera's axes are changed after the swap. Before the swap, the change would apply to the world's axes.
    of(
        "camera-to-world and world-to-camera swapped, and also OpenGL's and OpenCV's camera axes",
        |pose| flip(&pose.inverse()),
    ),
];

/// Name of the convention that also fits if the pictures, not the poses, are turned and there is no depth.
pub(super) const PICTURES_TURNED: &str =
    "the cameras' x and y axes negated (pictures turned by 180 degrees)";

/// Axes negated by mistake; no program uses these conventions.
const MIRRORED: [Convention; 8] = [
    of(
        "the cameras' x axis negated (pictures mirrored left to right, or a left-handed system)",
        |pose| camera_mirrored(pose, X),
    ),
    of(
        "the cameras' y axis negated (pictures upside down, or a left-handed system)",
        |pose| camera_mirrored(pose, Y),
    ),
    of(
        "the cameras' z axis negated (a left-handed system)",
        |pose| camera_mirrored(pose, Z),
    ),
    of(PICTURES_TURNED, |pose| camera_mirrored(pose, -Z)),
    of("the translations negated", |pose| {
        places_mirrored(pose, -DVec3::ONE)
    }),
    of(
        "the x coordinates of the camera positions negated",
        |pose| places_mirrored(pose, X),
    ),
    of(
        "the y coordinates of the camera positions negated",
        |pose| places_mirrored(pose, Y),
    ),
    of(
        "the z coordinates of the camera positions negated",
        |pose| places_mirrored(pose, Z),
    ),
];

/// Quaternions whose components the reader took in the wrong order, for world-to-camera and
/// camera-to-world poses.
const REORDERED: [Convention; 4] = [
    of(W_LAST, |pose| world_turned(pose, w_last)),
    of(W_FIRST, |pose| world_turned(pose, w_first)),
    of(W_LAST, |pose| {
        world_turned(&pose.inverse(), w_last).inverse()
    }),
    of(W_FIRST, |pose| {
        world_turned(&pose.inverse(), w_first).inverse()
    }),
];
const W_LAST: &str = "the poses' quaternions taken as x, y, z, w instead of w, x, y, z";
const W_FIRST: &str = "the poses' quaternions taken as w, x, y, z instead of x, y, z, w";

/// Rotations that the file stores transposed: of world-to-camera poses, then of camera-to-world poses in OpenCV's and
/// in OpenGL's axes.
const TRANSPOSED: [Convention; 3] = [
    of(ROTATION_TRANSPOSED, |pose| RigidTransform {
        rotation: pose.rotation.transpose(),
        ..*pose
    }),
    of(ROTATION_TRANSPOSED, |pose| {
        turned_in_place(pose, pose.rotation.transpose())
    }),
    of(ROTATION_TRANSPOSED, |pose| {
        let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        turned_in_place(pose, axes * pose.rotation.transpose() * axes)
    }),
];
/// Camera positions that were read as translations of world-to-camera poses, then translations that were read as camera
/// positions.
const SWAPPED_PLACES: [Convention; 2] = [
    of(
        "the translations taken as the cameras' positions (t = -R c)",
        |pose| RigidTransform {
            translation: pose.rotation * -pose.translation,
            ..*pose
        },
    ),
    of(
        "the cameras' positions taken as translations of world-to-camera poses (c = -R^T t)",
        |pose| RigidTransform {
            translation: pose.rotation.transpose() * -pose.translation,
            ..*pose
        },
    ),
];
/// Pictures that were rotated without their poses.
const TURNED: [Convention; 2] = [
    of(
        "the cameras turned by 90 degrees (the pictures were turned clockwise, but not the poses)",
        |pose| rolled(pose, 1.0),
    ),
    of(
        "the cameras turned by 90 degrees (the pictures were turned counterclockwise, but not the poses)",
        |pose| rolled(pose, -1.0),
    ),
];
/// Poses of a vehicle's body instead of the camera: y left and z up, as in ROS, or y right and z down, as in aviation.
/// For cameras read with OpenGL's axes, the first entry stands for aviation and the second for ROS.
const BODIES: [Convention; 2] = [
    of(BODY, |pose| {
        rotated(pose, DMat3::from_cols(DVec3::Z, -DVec3::X, -DVec3::Y))
    }),
    of(BODY, |pose| {
        rotated(pose, DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y))
    }),
];
const BODY: &str = "the axes of a vehicle's body (x forward, as in ROS) in place of the camera's";
const ROTATION_TRANSPOSED: &str = "the poses' rotations transposed";

/// All conventions except the one that the dataset reader assumes. Orders of quaternions are included unless the
/// dataset stores its poses as matrices.
pub(super) fn alternatives(poses_are_matrices: bool) -> impl Iterator<Item = &'static Convention> {
    let reordered = REORDERED.iter().filter(move |_| !poses_are_matrices);
    let axes = CONVENTIONS[1..].iter().chain(&MIRRORED);
    let places = axes.chain(&SWAPPED_PLACES);
    let turned = TRANSPOSED.iter().chain(&TURNED).chain(&BODIES);
    places.chain(reordered).chain(turned)
}

/// Pose of a camera whose picture was turned by 90 degrees, clockwise if `sign` is 1.
fn rolled(pose: &RigidTransform, sign: f64) -> RigidTransform {
    let quarter = DMat3::from_cols(sign * DVec3::Y, -sign * DVec3::X, DVec3::Z);
    rotated(pose, quarter)
}

/// Pose in camera axes that are rotated by `axes`.
fn rotated(pose: &RigidTransform, axes: DMat3) -> RigidTransform {
    RigidTransform {
        rotation: axes * pose.rotation,
        translation: axes * pose.translation,
    }
}

/// Pose with the given rotation at an unchanged position.
pub(super) fn turned_in_place(pose: &RigidTransform, rotation: DMat3) -> RigidTransform {
    let place = pose.rotation.transpose() * -pose.translation;
    RigidTransform {
        rotation,
        translation: -(rotation * place),
    }
}

/// Reorders a quaternion whose numbers were read as (w, x, y, z) but are (x, y, z, w).
fn w_last(read: DQuat) -> DQuat {
    DQuat::from_xyzw(read.w, read.x, read.y, read.z)
}

/// Reorders a quaternion whose numbers were read as (x, y, z, w) but are (w, x, y, z).
fn w_first(read: DQuat) -> DQuat {
    DQuat::from_xyzw(read.y, read.z, read.w, read.x)
}

fn world_turned(pose: &RigidTransform, order: fn(DQuat) -> DQuat) -> RigidTransform {
    RigidTransform {
        rotation: DMat3::from_quat(order(DQuat::from_mat3(&pose.rotation))),
        ..*pose
    }
}

const X: DVec3 = DVec3::new(-1.0, 1.0, 1.0);
const Y: DVec3 = DVec3::new(1.0, -1.0, 1.0);
const Z: DVec3 = DVec3::new(1.0, 1.0, -1.0);

/// Pose of a mirrored camera in a mirrored world.
pub(super) fn camera_mirrored(pose: &RigidTransform, signs: DVec3) -> RigidTransform {
    let axes = DMat3::from_diagonal(signs);
    RigidTransform {
        rotation: axes * pose.rotation * axes,
        translation: axes * pose.translation,
    }
}

/// Pose with an unchanged rotation at a mirrored position.
pub(super) fn places_mirrored(pose: &RigidTransform, signs: DVec3) -> RigidTransform {
    let place = pose.rotation.transpose() * pose.translation;
    RigidTransform {
        translation: pose.rotation * (signs * place),
        ..*pose
    }
}

/// Negates the camera's y and z axes.
pub(super) fn flip(camera_from_world: &RigidTransform) -> RigidTransform {
    rotated(
        camera_from_world,
        DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
    )
}

#[cfg(test)]
mod tests {
    use super::alternatives;

    #[test]
    fn matrices_have_no_order_of_quaternions() {
        let reordered = |poses_are_matrices| {
            let all = alternatives(poses_are_matrices);
            all.filter(|one| one.name.contains("quaternion")).count()
        };
        assert_eq!((reordered(true), reordered(false)), (0, 4));
    }
}
