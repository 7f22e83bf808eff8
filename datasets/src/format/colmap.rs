//! COLMAP models: `cameras`, `images` and `points3D`, as text or binary.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::colmap_records::{ColmapCamera, ColmapImage, ColmapPoint};
use super::{FormatError, colmap_binary, colmap_text};
use crate::DatasetError;
use crate::files::{self, Root};
use crate::lens::Lens;

/// Cameras by their ids.
pub type Cameras = BTreeMap<u32, ColmapCamera>;

/// A model without its points.
#[derive(Debug)]
pub struct Model {
    /// The cameras that images name.
    pub cameras: Cameras,
    /// In the file's order.
    pub images: Vec<ColmapImage>,
    /// The files that were read: of the cameras, then of the images.
    pub files: Vec<PathBuf>,
    /// True when a text model lay beside the binary one that was read.
    pub text_ignored: bool,
}

impl Model {
    /// The file that names the pictures.
    pub(crate) fn images_file(&self) -> &Path {
        &self.files[1]
    }

    /// The camera of an image with its lens.
    pub(crate) fn lens(&self, image: &ColmapImage) -> Result<Lens, DatasetError> {
        let id = image.camera_id;
        let camera = self.cameras.get(&id).ok_or_else(|| {
            let reason = format!("'{}' has camera {id}, which does not exist", image.name);
            DatasetError::malformed(self.images_file(), reason)
        })?;
        camera.lens().map_err(|error| {
            DatasetError::malformed(&self.files[0], format!("camera {id}: {error}"))
        })
    }
}

/// True when a folder holds a model, text or binary.
pub fn is_model(folder: &Path) -> bool {
    has_model(folder, "bin") || has_model(folder, "txt")
}

fn has_model(folder: &Path, extension: &str) -> bool {
    let mut names = ["cameras", "images"].iter();
    names.all(|name| folder.join(format!("{name}.{extension}")).is_file())
}

/// As [`read_model`], refusing files that lead out of the dataset's folder.
pub(crate) fn read_model_in(root: &Root, folder: &Path) -> Result<Model, DatasetError> {
    check_inside(root, folder)?;
    read_model(folder)
}

/// As [`read_cameras`], refusing files that lead out of the dataset's folder.
pub(crate) fn read_cameras_in(
    root: &Root,
    folder: &Path,
) -> Result<Option<(PathBuf, Cameras)>, DatasetError> {
    check_inside(root, folder)?;
    read_cameras(folder)
}

fn check_inside(root: &Root, folder: &Path) -> Result<(), DatasetError> {
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
    let extension = if has_model(folder, "bin") {
        "bin"
    } else {
        "txt"
    };
    let images_file = folder.join(format!("images.{extension}"));
    let images = if extension == "bin" {
        files::parse(&images_file, colmap_binary::images)?
    } else {
        files::parse_text(&images_file, colmap_text::images)?
    };
    let (cameras_file, cameras) = read_cameras(folder)?
        .ok_or_else(|| DatasetError::malformed(folder, "no cameras.bin or cameras.txt"))?;
    Ok(Model {
        cameras,
        images,
        files: vec![cameras_file, images_file],
        text_ignored: extension == "bin" && has_model(folder, "txt"),
    })
}

/// Reads only the cameras of a model; `None` when a folder has none.
///
/// # Errors
/// Names the file and what is wrong with it.
pub fn read_cameras(folder: &Path) -> Result<Option<(PathBuf, Cameras)>, DatasetError> {
    read_either(
        folder,
        "cameras",
        colmap_binary::cameras,
        colmap_text::cameras,
    )
}

/// Reads the points of a model, of the same kind as its other files; `None` when there are none.
///
/// # Errors
/// Names the file and what is wrong with it.
pub fn read_points(folder: &Path) -> Result<Option<(PathBuf, Vec<ColmapPoint>)>, DatasetError> {
    read_either(
        folder,
        "points3D",
        colmap_binary::points,
        colmap_text::points,
    )
}

fn read_either<T>(
    folder: &Path,
    name: &str,
    binary: fn(&[u8]) -> Result<T, FormatError>,
    text: fn(&str) -> Result<T, FormatError>,
) -> Result<Option<(PathBuf, T)>, DatasetError> {
    let file = |extension: &str| folder.join(format!("{name}.{extension}"));
    let (in_binary, in_text) = (file("bin"), file("txt"));
    Ok(if in_binary.is_file() {
        let content = files::parse(&in_binary, binary)?;
        Some((in_binary, content))
    } else if in_text.is_file() {
        let content = files::parse_text(&in_text, text)?;
        Some((in_text, content))
    } else {
        None
    })
}
