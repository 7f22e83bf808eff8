//! Records of a COLMAP model, as stored.

use glam::{DMat3, DQuat, DVec3};
use sharp::camera::RigidTransform;

use super::FormatError;
use crate::lens::{Lens, LensError};

#[derive(Debug, Clone, PartialEq)]
pub struct ColmapCamera {
    pub model: String,
    pub size: (u32, u32),
    /// Parameters in COLMAP's order.
    pub params: Vec<f64>,
}

impl ColmapCamera {
    /// The camera with its lens, in our pixel-centre convention, which is the same as COLMAP's.
    ///
    /// # Errors
    /// As for [`Lens::from_colmap`].
    pub fn lens(&self) -> Result<Lens, LensError> {
        Lens::from_colmap(&self.model, self.size, &self.params)
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct ColmapImage {
    pub id: u32,
    pub camera_id: u32,
    /// Path relative to the folder of pictures; may contain `/` and blanks.
    pub name: String,
    /// `None` for a zero quaternion or non-finite values.
    pub camera_from_world: Option<RigidTransform>,
}

/// A triangulated point.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapPoint {
    pub position: DVec3,
    /// Ids of the images that see the point.
    pub seen_by: Vec<u32>,
}

/// Converts COLMAP's pose: a quaternion w, x, y, z, which is normalised, and a translation.
pub(super) fn pose(wxyz: [f64; 4], translation: [f64; 3]) -> Option<RigidTransform> {
    let [w, x, y, z] = wxyz;
    let length = (w * w + x * x + y * y + z * z).sqrt();
    if !(length.is_finite() && length > 1e-12) {
        return None;
    }
    let q = DQuat::from_xyzw(x / length, y / length, z / length, w / length);
    RigidTransform::new(DMat3::from_quat(q), DVec3::from(translation)).ok()
}

/// Rejects sizes that are zero or exceed 32 bits.
pub(super) fn size(width: u64, height: u64) -> Result<(u32, u32), FormatError> {
    let side = |n: u64| u32::try_from(n).ok().filter(|n| *n > 0);
    side(width)
        .zip(side(height))
        .ok_or_else(|| invalid!("a camera has an invalid size, {width}x{height} pixels"))
}
