//! COLMAP models: `cameras`, `images` and `points3D`, as text or binary.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::colmap_records::{Camera, Image, Point};
use super::{colmap_binary, colmap_text};
use crate::DatasetError;
use crate::files::{self, Root};

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

/// True when a folder holds a model, text or binary.
pub fn is_model(folder: &Path) -> bool {
    ["bin", "txt"].iter().any(|extension| {
        ["cameras", "images"]
            .iter()
            .all(|name| folder.join(format!("{name}.{extension}")).is_file())
    })
}

/// Checks that no file of a model leads out of the dataset's folder.
///
/// # Errors
/// As [`Root::check`].
pub(crate) fn check_inside(root: &Root, folder: &Path) -> Result<(), DatasetError> {
    root.check(folder)?;
    for name in ["cameras", "images", "points3D"] {
        for extension in ["bin", "txt"] {
            root.check(&folder.join(format!("{name}.{extension}")))?;
        }
    }
    Ok(())
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
