//! A rectified stereo pair as a scene; shared by the readers of Middlebury, Booster and plain pairs.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use sharp::camera::{CameraError, Intrinsics, RigidTransform};
use sharp::image_file::PictureRules;

use crate::depth::{StereoGeometry, ViewDepth};
use crate::file_content::FileContent;
use crate::undistort::ViewGeometry;
use crate::{DatasetError, DatasetSpec, Pairing, Scene, View};

/// One side of a rectified pair.
#[derive(Debug)]
pub(crate) struct Side {
    pub(crate) id: String,
    pub(crate) image: PathBuf,
    pub(crate) size: (u32, u32),
    /// Disparity map of this side, if any, and the number of pixels per stored unit.
    pub(crate) disparity: Option<(PathBuf, f64)>,
    pub(crate) focal: (f64, f64),
    /// Principal point; the centre of the first pixel is (0.5, 0.5).
    pub(crate) center: (f64, f64),
    /// Converts disparity to depth, `Z = baseline · f / (d + doffs)`. The conversion is the same
    /// for both sides, because disparity is always `x_left − x_right`.
    pub(crate) geometry: StereoGeometry,
}

impl Side {
    fn into_view(
        self,
        x_m: f64,
        calibration: &Path,
        rules: PictureRules,
    ) -> Result<View, CameraError> {
        let (size, geometry) = (self.size, self.geometry);
        let disparity = |(file, unit)| ViewDepth::Disparity(file, geometry, unit);
        let pinhole = Intrinsics::new(self.focal, self.center, size)?;
        let camera_from_world = RigidTransform::new(DMat3::IDENTITY, DVec3::X * -x_m)?;
        Ok(View {
            id: self.id,
            intrinsics: pinhole,
            camera_from_world,
            content: Arc::new(FileContent {
                image: self.image,
                rules,
                geometry: ViewGeometry {
                    size,
                    undistortion: None,
                    pinhole,
                    camera_from_world,
                },
                mask: None,
                depth: self.disparity.map(disparity),
                cameras: vec![calibration.to_owned()],
                has_camera_size: false,
            }),
        })
    }
}

/// Note on a left side without depth; `file` is the file that was expected to contain its
/// disparity.
pub(crate) fn without_depth(left: &Side, id: &str, file: &str) -> Vec<String> {
    let note = || format!("{id}: no {file}, so the left view has no depth");
    left.disparity.is_none().then(note).into_iter().collect()
}

/// Creates the scene of a left and a right side, separated by a baseline; `calibration` is the file from which their
/// cameras were read.
///
/// # Errors
/// If a side's camera is invalid; names `calibration`.
pub(crate) fn scene(
    spec: &DatasetSpec,
    id: String,
    cluster: String,
    [left, right]: [Side; 2],
    calibration: &Path,
    notes: Vec<String>,
) -> Result<Scene, DatasetError> {
    let baseline_m = right.geometry.baseline_m;
    let views = [(left, 0.0), (right, baseline_m)].map(|(side, x_m)| {
        let view = side.into_view(x_m, calibration, spec.picture_rules());
        view.map_err(|source| DatasetError::camera(calibration, source))
    });
    let views = views.into_iter().collect::<Result<_, _>>()?;
    let pairing = Pairing::Stereo {
        source: 0,
        target: 1,
    };
    Ok(Scene {
        cluster,
        notes,
        ..Scene::new(&spec.name, id, views, pairing)
    })
}
