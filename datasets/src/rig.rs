//! A rectified stereo pair as two views: what Middlebury, Booster and plain pairs share.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use sharp::camera::{CameraError, Intrinsics, RigidTransform};

use crate::View;
use crate::content::FileContent;
use crate::depth::{DepthSource, Disparity, StereoGeometry};

/// One side of a rectified pair.
#[derive(Debug)]
pub(crate) struct Side {
    pub(crate) id: String,
    pub(crate) image: PathBuf,
    /// Disparity of this side, if there is a map of it, and the pixels that one unit stands for.
    pub(crate) disparity: Option<(PathBuf, f64)>,
    pub(crate) focal: (f64, f64),
    /// Principal point in our convention: the first pixel's centre is (0.5, 0.5).
    pub(crate) center: (f64, f64),
    pub(crate) size: (u32, u32),
    /// To the right of the left camera, metres.
    pub(crate) x_m: f64,
}

impl Side {
    /// The view of this side. `Z = baseline · f / (d + doffs)` holds for both sides, as disparity
    /// is always `x_left − x_right`.
    pub(crate) fn into_view(
        self,
        geometry: StereoGeometry,
        cameras: Vec<PathBuf>,
    ) -> Result<View, CameraError> {
        let size = self.size;
        let depth = self.disparity.map(|(file, unit)| {
            Arc::new(Disparity {
                file,
                geometry,
                size,
                unit,
            }) as Arc<dyn DepthSource>
        });
        Ok(View {
            id: self.id,
            intrinsics: Intrinsics::new(self.focal, self.center, size)?,
            camera_from_world: RigidTransform::new(
                DMat3::IDENTITY,
                DVec3::new(-self.x_m, 0.0, 0.0),
            )?,
            content: Arc::new(FileContent {
                image: self.image,
                size,
                mask: None,
                undistortion: None,
                depth,
                cameras,
            }),
        })
    }
}
