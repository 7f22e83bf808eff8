//! Pinhole intrinsics, rigid poses and the affine maps between camera spaces.
//!
//! All types use f64 (glam): poses of real datasets can be kilometres from their origin, and projections are compared
//! with OpenCV's to 1e-9 px. Only the renderer uses f32.

use glam::{DAffine3, DMat3, DMat4, DVec2, DVec3};

/// An invalid camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// An entry is NaN or infinite.
    #[error("{what} has a value that is not finite")]
    NotFinite { what: &'static str },
    /// A focal length is zero or negative, or the image has no pixel.
    #[error("intrinsics are degenerate: fx {fx}, fy {fy}, image {width}x{height}")]
    DegenerateIntrinsics {
        fx: f64,
        fy: f64,
        width: u32,
        height: u32,
    },
    /// The image has more than [`Intrinsics::MAX_PIXELS`] pixels.
    #[error(
        "a picture of {width}x{height} exceeds the maximum of {} pixels",
        Intrinsics::MAX_PIXELS
    )]
    TooLarge { width: u32, height: u32 },
    /// The 3×3 part differs from a rotation by more than
    /// [`RigidTransform::ORTHONORMALITY_TOLERANCE`].
    #[error(
        "pose is not rigid: |R Rᵀ - I| is {deviation:.3e} and det R is {determinant:.6} \
         (a scaled, mirrored or transposed matrix?)"
    )]
    NotRigid {
        /// Largest absolute entry of R Rᵀ − I.
        deviation: f64,
        determinant: f64,
    },
    /// The last row of a 4×4 matrix is not (0, 0, 0, 1).
    #[error("the last row of a 4x4 pose is {0:?}, not [0, 0, 0, 1]")]
    NotAffine([f64; 4]),
    /// The 4×4 matrix is a pose if it is transposed: its last row holds the translation.
    #[error("the 4x4 pose is transposed: its last row holds the translation; transpose it")]
    Transposed,
}

/// Pinhole intrinsics of one image, in pixels, without skew.
///
/// Pixel (i, j) has its centre at (i + 0.5, j + 0.5), so a camera whose axis passes through the centre of the image has
/// `cx = width / 2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Horizontal focal length in pixels, > 0.
    pub fx: f64,
    /// Vertical focal length in pixels, > 0.
    pub fy: f64,
    /// Principal point, in pixels from the left edge of the image.
    pub cx: f64,
    /// Principal point, in pixels from the top edge of the image.
    pub cy: f64,
    pub width: u32,
    pub height: u32,
}

impl Intrinsics {
    /// Maximum number of pixels of a camera, 2²⁸ (16384×16384): larger than any photograph, but small enough that a
    /// mistyped or hostile size is rejected before it exhausts memory.
    pub const MAX_PIXELS: u64 = 1 << 28;

    /// Creates intrinsics after checking them.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] for values that are not finite; [`CameraError::DegenerateIntrinsics`] for a focal
    /// length or a side that is not positive; [`CameraError::TooLarge`] for more than [`Self::MAX_PIXELS`].
    pub fn new(
        (fx, fy): (f64, f64),
        (cx, cy): (f64, f64),
        (width, height): (u32, u32),
    ) -> Result<Self, CameraError> {
        if ![fx, fy, cx, cy].iter().all(|v| v.is_finite()) {
            return Err(CameraError::NotFinite { what: "intrinsics" });
        }
        if fx <= 0.0 || fy <= 0.0 || width == 0 || height == 0 {
            return Err(CameraError::DegenerateIntrinsics {
                fx,
                fy,
                width,
                height,
            });
        }
        if u64::from(width) * u64::from(height) > Self::MAX_PIXELS {
            return Err(CameraError::TooLarge { width, height });
        }
        Ok(Self {
            fx,
            fy,
            cx,
            cy,
            width,
            height,
        })
    }

    /// The 3×3 matrix K with `K · (X, Y, Z)ᵀ = Z · (u, v, 1)ᵀ`.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&[
            [self.fx, 0.0, 0.0],
            [0.0, self.fy, 0.0],
            [self.cx, self.cy, 1.0],
        ])
    }

    /// Projects a camera-space point (metres) to pixels; `None` if z is not positive, i.e. the
    /// point is not in front of the camera.
    #[inline]
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        (point.z > 0.0).then(|| {
            DVec2::new(
                self.fx * point.x / point.z + self.cx,
                self.fy * point.y / point.z + self.cy,
            )
        })
    }

    /// Unprojects pixel coordinates at z-depth `depth` (metres) to a camera-space point.
    pub fn unproject(&self, pixel: DVec2, depth: f64) -> DVec3 {
        DVec3::new(
            (pixel.x - self.cx) / self.fx * depth,
            (pixel.y - self.cy) / self.fy * depth,
            depth,
        )
    }

    /// True if continuous pixel coordinates lie inside the image, `[0, width) × [0, height)`.
    #[inline]
    pub fn contains(&self, pixel: DVec2) -> bool {
        pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < f64::from(self.width)
            && pixel.y < f64::from(self.height)
    }

    /// Intrinsics of the same picture resized to `width × height`. Focal lengths and principal point scale by the same
    /// factor per axis, because pixel coordinates start at the image's edge.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        Self {
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
            width,
            height,
        }
    }

    /// Matrix from camera space to SHARP's normalised space: x/z and y/z span [−1, 1] from edge to edge of the image; z
    /// stays metric. This is the 3×3 part of K in the paper's `P = K_t E_t E_s⁻¹ K_s⁻¹`.
    pub fn ndc_from_camera(&self) -> DMat3 {
        let (w, h) = (f64::from(self.width), f64::from(self.height));
        DMat3::from_cols_array_2d(&[
            [2.0 * self.fx / w, 0.0, 0.0],
            [0.0, 2.0 * self.fy / h, 0.0],
            [2.0 * self.cx / w - 1.0, 2.0 * self.cy / h - 1.0, 1.0],
        ])
    }
}

/// A rotation followed by a translation, `x' = R x + t`: a pose between two metric spaces.
///
/// Name values by the spaces they join, as in `camera_from_world`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidTransform {
    /// Rotation matrix: orthonormal, determinant +1.
    pub rotation: DMat3,
    /// Translation in metres, in the destination space.
    pub translation: DVec3,
}

impl RigidTransform {
    /// The pose of a camera at the world's origin whose axes are the world's.
    pub const IDENTITY: Self = Self {
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// Maximum deviation of each entry of R Rᵀ from the identity. Poses in text files are rounded; a transposed or
    /// scaled matrix deviates by far more.
    pub const ORTHONORMALITY_TOLERANCE: f64 = 1e-2;

    /// Creates a pose from a 3×3 matrix that is approximately a rotation, by projecting it onto the nearest rotation.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] for values that are not finite; [`CameraError::NotRigid`] if the matrix deviates from
    /// orthonormal by more than [`Self::ORTHONORMALITY_TOLERANCE`] or mirrors space.
    pub fn new(rotation: DMat3, translation: DVec3) -> Result<Self, CameraError> {
        if !rotation.is_finite() || !translation.is_finite() {
            return Err(CameraError::NotFinite { what: "pose" });
        }
        let deviation = deviation_from_identity(rotation * rotation.transpose());
        let determinant = rotation.determinant();
        if deviation > Self::ORTHONORMALITY_TOLERANCE || determinant <= 0.0 {
            return Err(CameraError::NotRigid {
                deviation,
                determinant,
            });
        }
        Ok(Self {
            rotation: nearest_rotation(rotation),
            translation,
        })
    }

    /// Creates a pose from a row-major 4×4 matrix.
    ///
    /// # Errors
    /// As for [`Self::new`]; [`CameraError::NotAffine`] if the last row is not (0, 0, 0, 1), or
    /// [`CameraError::Transposed`] if the transposed matrix is a pose.
    pub fn from_row_major(m: &[f64; 16]) -> Result<Self, CameraError> {
        let affine = affine_from_row_major(m).map_err(|error| {
            let transposed = DMat4::from_cols_array(m).transpose().to_cols_array();
            let is_pose = matches!(error, CameraError::NotAffine(_))
                && affine_from_row_major(&transposed)
                    .is_ok_and(|affine| Self::new(affine.matrix3, affine.translation).is_ok());
            if is_pose {
                CameraError::Transposed
            } else {
                error
            }
        })?;
        Self::new(affine.matrix3, affine.translation)
    }

    #[inline]
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// The inverse: `a_from_b` becomes `b_from_a`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// `a_from_b.after(b_from_c)` is `a_from_c`.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            rotation: self.rotation * first.rotation,
            translation: self.rotation * first.translation + self.translation,
        }
    }

    /// Centre of the camera in world space, for a `camera_from_world` pose.
    pub fn camera_center(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// Angle of the rotation, in degrees in [0, 180]. Accurate near 0, unlike the formula with the trace.
    pub fn rotation_deg(&self) -> f64 {
        let r = &self.rotation;
        let axis = DVec3::new(
            r.y_axis.z - r.z_axis.y,
            r.z_axis.x - r.x_axis.z,
            r.x_axis.y - r.y_axis.x,
        );
        let trace = r.x_axis.x + r.y_axis.y + r.z_axis.z;
        axis.length().atan2(trace - 1.0).to_degrees()
    }

    pub fn to_affine(&self) -> DAffine3 {
        DAffine3::from_mat3_translation(self.rotation, self.translation)
    }

    /// The 4×4 matrix in row-major order.
    pub fn to_row_major(&self) -> [f64; 16] {
        DMat4::from(self.to_affine()).transpose().to_cols_array()
    }
}

/// Creates an affine map, which need not be rigid, from a row-major 4×4 matrix.
///
/// # Errors
/// [`CameraError::NotFinite`] for values that are not finite; [`CameraError::NotAffine`] if the last row is not (0, 0,
/// 0, 1).
pub fn affine_from_row_major(m: &[f64; 16]) -> Result<DAffine3, CameraError> {
    if !m.iter().all(|v| v.is_finite()) {
        return Err(CameraError::NotFinite { what: "pose" });
    }
    if m[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(CameraError::NotAffine([m[12], m[13], m[14], m[15]]));
    }
    let matrix = DMat4::from_cols_array(m).transpose();
    Ok(DAffine3::from_mat4(matrix))
}

/// Distance between the centres of two cameras in metres: the paper's baseline.
pub fn baseline_m(a_from_world: &RigidTransform, b_from_world: &RigidTransform) -> f64 {
    a_from_world
        .camera_center()
        .distance(b_from_world.camera_center())
}

/// Affine map from a source photograph's normalised space directly to the target's camera space:
/// `E_t E_s⁻¹ K_s⁻¹` of the paper's `P = K_t E_t E_s⁻¹ K_s⁻¹` (K_s is
/// [`Intrinsics::ndc_from_camera`]). Applied to Gaussians predicted from the source, the map needs
/// no SVD and loses no precision.
pub fn target_camera_from_source_ndc(
    source: &Intrinsics,
    target_from_source: &RigidTransform,
) -> DAffine3 {
    let camera_from_ndc = source.ndc_from_camera().inverse();
    DAffine3::from_mat3_translation(
        target_from_source.rotation * camera_from_ndc,
        target_from_source.translation,
    )
}

fn deviation_from_identity(m: DMat3) -> f64 {
    (m - DMat3::IDENTITY)
        .to_cols_array()
        .iter()
        .fold(0.0, |largest, v| v.abs().max(largest))
}

/// Orthogonal polar factor of `m` by Newton's iteration, which converges quadratically, so that a
/// few steps reach f64 precision.
fn nearest_rotation(m: DMat3) -> DMat3 {
    let mut r = m;
    for _ in 0..12 {
        let next = (r + r.inverse().transpose()) * 0.5;
        if deviation_from_identity(next * next.transpose()) <= f64::EPSILON {
            return next;
        }
        r = next;
    }
    r
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> RigidTransform {
        let rotation = DMat3::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.7);
        RigidTransform::new(rotation, DVec3::new(0.1, -2.0, 3.5)).unwrap()
    }

    #[test]
    fn inverse_and_composition_agree() {
        let a = pose();
        let both = a.after(&a.inverse());
        assert!(deviation_from_identity(both.rotation) < 1e-15);
        assert!(both.translation.length() < 1e-14);
        assert!(a.apply(a.camera_center()).length() < 1e-14);
    }

    #[test]
    fn rotation_angle_is_exact_near_zero_and_near_half_a_turn() {
        for degrees in [0.0, 1e-7, 0.5, 40.0, 90.0, 179.999, 180.0_f64] {
            let r = DMat3::from_axis_angle(DVec3::new(0.0, 0.6, 0.8), degrees.to_radians());
            let found = RigidTransform {
                rotation: r,
                translation: DVec3::ZERO,
            }
            .rotation_deg();
            assert!((found - degrees).abs() < 1e-9, "{degrees}: {found}");
        }
    }

    #[test]
    fn poses_that_are_not_rigid_are_refused() {
        let nan = RigidTransform::new(DMat3::IDENTITY, DVec3::new(f64::NAN, 0.0, 0.0));
        assert!(matches!(nan, Err(CameraError::NotFinite { .. })));
        let mirrored = RigidTransform::new(
            DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0)),
            DVec3::ZERO,
        );
        assert!(matches!(mirrored, Err(CameraError::NotRigid { .. })));
        let scaled = RigidTransform::new(DMat3::IDENTITY * 1.1, DVec3::ZERO);
        assert!(matches!(scaled, Err(CameraError::NotRigid { .. })));
    }

    #[test]
    fn rounded_rotations_are_projected_onto_exact_ones() {
        let exact = pose().rotation;
        let rounded =
            DMat3::from_cols_array(&exact.to_cols_array().map(|v| (v * 1e3).round() / 1e3));
        let mended = RigidTransform::new(rounded, DVec3::ZERO).unwrap().rotation;
        assert!(deviation_from_identity(mended * mended.transpose()) < 1e-14);
        assert!(deviation_from_identity(mended * exact.transpose()) < 1e-3);
    }

    #[test]
    fn row_major_matrices_survive_a_round_trip() {
        let a = pose();
        let b = RigidTransform::from_row_major(&a.to_row_major()).unwrap();
        assert!((b.translation - a.translation).length() < 1e-15);
        assert!(deviation_from_identity(b.rotation * a.rotation.transpose()) < 1e-14);
        let mut bad = a.to_row_major();
        bad[15] = 2.0;
        assert!(matches!(
            RigidTransform::from_row_major(&bad),
            Err(CameraError::NotAffine(_))
        ));
        let transposed = DMat4::from(a.to_affine()).to_cols_array();
        assert_eq!(
            RigidTransform::from_row_major(&transposed).unwrap_err(),
            CameraError::Transposed
        );
        let scaled = DMat4::from(DAffine3::from_mat3_translation(
            a.rotation * 2.0,
            a.translation,
        ));
        assert!(matches!(
            RigidTransform::from_row_major(&scaled.to_cols_array()),
            Err(CameraError::NotAffine(_))
        ));
    }

    #[test]
    fn projection_and_unprojection_invert_each_other() {
        let k = Intrinsics::new((500.0, 510.0), (320.5, 239.0), (640, 480)).unwrap();
        let pixel = DVec2::new(17.25, 401.5);
        let found = k.project(k.unproject(pixel, 3.7)).unwrap();
        assert!((found - pixel).length() < 1e-12);
        assert!(k.project(DVec3::new(0.0, 0.0, -1.0)).is_none());
    }

    #[test]
    fn placement_maps_the_edge_of_the_source_image_to_its_ray() {
        let k = Intrinsics::new((500.0, 510.0), (330.0, 239.0), (640, 480)).unwrap();
        let target_from_source = pose();
        let place = target_camera_from_source_ndc(&k, &target_from_source);
        let depth = 4.0;
        // The right edge, one quarter down: (1, -0.5) in normalised coordinates.
        let placed = place.transform_point3(DVec3::new(depth, -0.5 * depth, depth));
        let expected = target_from_source.apply(k.unproject(DVec2::new(640.0, 120.0), depth));
        assert!((placed - expected).length() < 1e-12);
    }
}
