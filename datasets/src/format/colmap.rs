//! COLMAP models: `cameras`, `images` and `points3D`, as text or binary.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use sharp::camera::RigidTransform;

use super::{colmap_binary, colmap_text};
use crate::lens::Lens;
use crate::{DatasetError, files};

/// Cameras by their ids.
pub type Cameras = BTreeMap<u32, Camera>;

/// A model without its points.
#[derive(Debug)]
pub struct Model {
    /// The cameras that images name.
    pub cameras: Cameras,
    /// In the file's order.
    pub images: Vec<Image>,
    /// The files that were read.
    pub files: Vec<PathBuf>,
    /// True when a text model lay beside the binary one that was read.
    pub text_ignored: bool,
}

/// A camera as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// COLMAP's name of the model.
    pub model: String,
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// In COLMAP's order.
    pub params: Vec<f64>,
}

impl Camera {
    /// The camera with its lens; pixel centres are ours.
    ///
    /// # Errors
    /// The reason: an unsupported model, or parameters that are no camera's.
    pub fn lens(&self) -> Result<Lens, String> {
        Lens::from_colmap(&self.model, self.size, &self.params)
    }
}

/// An image as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// COLMAP's id.
    pub id: u32,
    /// Id of its camera.
    pub camera_id: u32,
    /// Relative to the folder of the pictures; may hold `/` and blanks.
    pub name: String,
    /// `None` for a quaternion of length zero and for values that are not finite.
    pub camera_from_world: Option<RigidTransform>,
}

/// A triangulated point.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// World position.
    pub position: DVec3,
    /// Ids of the images that see it.
    pub seen_by: Vec<u32>,
}

/// True when a folder holds a model, text or binary.
pub fn is_model(folder: &Path) -> bool {
    ["bin", "txt"].iter().any(|extension| {
        ["cameras", "images"]
            .iter()
            .all(|name| folder.join(format!("{name}.{extension}")).is_file())
    })
}

/// Reads a model; binary if both are there, as COLMAP does.
///
/// # Errors
/// Names the file and what is wrong with it.
pub fn read_model(folder: &Path) -> Result<Model, DatasetError> {
    let file = |name: &str, extension: &str| folder.join(format!("{name}.{extension}"));
    let has = |extension| {
        ["cameras", "images"]
            .iter()
            .all(|name| file(name, extension).is_file())
    };
    let extension = if has("bin") { "bin" } else { "txt" };
    let images_file = file("images", extension);
    let images = if extension == "bin" {
        colmap_binary::images(&files::read(&images_file)?)
    } else {
        colmap_text::images(&files::read_text(&images_file)?)
    };
    let images = images.map_err(|reason| DatasetError::malformed(&images_file, reason))?;
    let (cameras_file, cameras) = read_cameras(folder)?
        .ok_or_else(|| DatasetError::malformed(folder, "no cameras.bin or cameras.txt"))?;
    Ok(Model {
        cameras,
        images,
        files: vec![cameras_file, images_file],
        text_ignored: extension == "bin" && has("txt"),
    })
}

/// Reads only the cameras of a model; `None` when a folder has none.
///
/// # Errors
/// Names the file and what is wrong with it.
pub fn read_cameras(folder: &Path) -> Result<Option<(PathBuf, Cameras)>, DatasetError> {
    let (binary, text) = (folder.join("cameras.bin"), folder.join("cameras.txt"));
    let (path, cameras) = if binary.is_file() {
        let cameras = colmap_binary::cameras(&files::read(&binary)?);
        (binary, cameras)
    } else if text.is_file() {
        let cameras = colmap_text::cameras(&files::read_text(&text)?);
        (text, cameras)
    } else {
        return Ok(None);
    };
    match cameras {
        Ok(cameras) => Ok(Some((path, cameras))),
        Err(reason) => Err(DatasetError::malformed(path, reason)),
    }
}

/// Reads the points of a model, of the same kind as its other files; `None` when there are none.
///
/// # Errors
/// Names the file and what is wrong with it.
pub fn read_points(folder: &Path) -> Result<Option<(PathBuf, Vec<Point>)>, DatasetError> {
    let (binary, text) = (folder.join("points3D.bin"), folder.join("points3D.txt"));
    let (path, points) = if binary.is_file() {
        let points = colmap_binary::points(&files::read(&binary)?);
        (binary, points)
    } else if text.is_file() {
        let points = colmap_text::points(&files::read_text(&text)?);
        (text, points)
    } else {
        return Ok(None);
    };
    match points {
        Ok(points) => Ok(Some((path, points))),
        Err(reason) => Err(DatasetError::malformed(path, reason)),
    }
}

/// COLMAP's pose: a quaternion w, x, y, z, which is normalised, and a translation.
pub(super) fn pose(wxyz: [f64; 4], translation: [f64; 3]) -> Option<RigidTransform> {
    let [w, x, y, z] = wxyz;
    let length = (w * w + x * x + y * y + z * z).sqrt();
    if !(length.is_finite() && length > 1e-12) {
        return None;
    }
    let q = DQuat::from_xyzw(x / length, y / length, z / length, w / length);
    RigidTransform::new(DMat3::from_quat(q), DVec3::from(translation)).ok()
}

/// Refuses a size that is no picture's.
pub(super) fn size(width: u64, height: u64) -> Result<(u32, u32), String> {
    let side = |n: u64| u32::try_from(n).ok().filter(|n| *n > 0);
    side(width)
        .zip(side(height))
        .ok_or_else(|| format!("a camera is {width}x{height} pixels"))
}
