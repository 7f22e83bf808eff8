//! COLMAP models: `cameras`, `images` and `points3D`, as text or binary.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::colmap_records::{ColmapCamera, ColmapImage, ColmapPoint};
use super::{colmap_binary, colmap_text};
use crate::DatasetError;
use crate::files::{self, Root};
use crate::lens::Lens;

/// Cameras, keyed by their ids.
pub type Cameras = BTreeMap<u32, ColmapCamera>;

/// A COLMAP model without its points.
#[derive(Debug)]
pub struct Model {
    /// The cameras that images refer to.
    pub cameras: Cameras,
    /// Images in file order.
    pub images: Vec<ColmapImage>,
    /// The files that were read: the cameras' file, then the images'.
    pub files: Vec<PathBuf>,
    /// Notes on files in the same folder that were not read.
    pub notes: Vec<String>,
}

impl Model {
    /// Path of the file that lists the images.
    pub(crate) fn images_file(&self) -> &Path {
        &self.files[1]
    }

    /// Lens of an image's camera. The inner error says why the camera cannot be used; it affects only the camera's
    /// pictures.
    ///
    /// # Errors
    /// If the image's camera does not exist; names the file.
    pub(crate) fn lens(&self, image: &ColmapImage) -> Result<Result<Lens, String>, DatasetError> {
        let id = image.camera_id;
        let camera = self.cameras.get(&id).ok_or_else(|| {
            let reason = format!("'{}' has camera {id}, which does not exist", image.name);
            DatasetError::malformed(self.images_file(), reason)
        })?;
        let file = self.files[0].file_name().unwrap_or_default().display();
        let lens = camera.lens();
        Ok(lens.map_err(|error| format!("camera {id} of {file}: {error}")))
    }

    /// Like [`Self::lens`], for callers that require a lens for every picture.
    ///
    /// # Errors
    /// If the camera does not exist or cannot be used; names the file and the camera.
    pub(crate) fn needed_lens(&self, image: &ColmapImage) -> Result<Lens, DatasetError> {
        let lens = self.lens(image)?;
        lens.map_err(|reason| DatasetError::malformed(&self.files[0], reason))
    }
}

/// True if a folder contains a model, text or binary.
pub fn is_model(folder: &Path) -> bool {
    has_model(folder, "bin") || has_model(folder, "txt")
}

fn has_model(folder: &Path, extension: &str) -> bool {
    let mut names = ["cameras", "images"].iter();
    names.all(|name| folder.join(format!("{name}.{extension}")).is_file())
}

/// File extension of the model to read, `bin` or `txt`: `txt` only if there is a complete text
/// model but no complete binary one, as in COLMAP.
fn kind(folder: &Path) -> &'static str {
    let only_text = has_model(folder, "txt") && !has_model(folder, "bin");
    if only_text { "txt" } else { "bin" }
}

/// Number of pictures in a model.
///
/// # Errors
/// If a file is missing or invalid; names the file.
pub(crate) fn picture_count(folder: &Path) -> Result<usize, DatasetError> {
    Ok(read_images(folder, kind(folder))?.1.len())
}

/// Like [`read_model`], but rejects files outside the dataset's folder.
pub(crate) fn read_model_in(root: &Root, folder: &Path) -> Result<Model, DatasetError> {
    check_inside(root, folder)?;
    read_model(folder)
}

/// Like [`read_cameras`], but rejects files outside the dataset's folder.
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

/// Reads a model; binary if both kinds exist, as in COLMAP. All files must be of the same kind.
///
/// # Errors
/// If a file is missing or invalid; names the file.
pub fn read_model(folder: &Path) -> Result<Model, DatasetError> {
    let kind = kind(folder);
    let (images_file, images) = read_images(folder, kind)?;
    let (cameras_file, cameras) = read_cameras(folder)?
        .ok_or_else(|| DatasetError::malformed(folder, "no cameras.bin or cameras.txt"))?;
    let model = Model {
        cameras,
        images,
        files: vec![cameras_file, images_file],
        notes: Vec::new(),
    };
    let notes = unread_notes(folder, &model, kind);
    Ok(Model { notes, ..model })
}

fn read_images(folder: &Path, kind: &str) -> Result<(PathBuf, Vec<ColmapImage>), DatasetError> {
    let file = folder.join(format!("images.{kind}"));
    let images = match kind {
        "bin" => files::parse(&file, colmap_binary::images)?,
        _ => files::parse_text(&file, colmap_text::images)?,
    };
    Ok((file, images))
}

/// Notes on files of the kind, text or binary, that was not read from a model's folder. If they contradict the model,
/// the notes say so.
fn unread_notes(folder: &Path, model: &Model, kind: &str) -> Vec<String> {
    let (read, unread, other) = match kind {
        "bin" => ("binary", "text", "txt"),
        _ => ("text", "binary", "bin"),
    };
    let cameras_file = folder.join(format!("cameras.{other}"));
    if !cameras_file.is_file() {
        return Vec::new();
    }
    let cameras = read_cameras_of(&cameras_file);
    let whole = has_model(folder, other);
    let mut contradictions = Vec::new();
    if !cameras.is_ok_and(|cameras| are_same_cameras(&cameras, &model.cameras)) {
        contradictions.push("other cameras");
    }
    let images = whole.then(|| read_images(folder, other));
    if images.is_some_and(|found| !found.is_ok_and(|(_, i)| are_same_images(&i, &model.images))) {
        contradictions.push("other pictures or poses");
    }
    let what = if whole {
        format!("the {unread} model next to it")
    } else {
        format!("cameras.{other} next to it")
    };
    let contradiction = match contradictions.is_empty() {
        true if !whole => return Vec::new(),
        true => String::new(),
        false => format!(", which states {}", contradictions.join(" and ")),
    };
    vec![format!(
        "{}: read the {read} model and ignored {what}{contradiction}",
        folder.display()
    )]
}

/// Compares with a tolerance, because text files are rounded.
fn are_close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 + 1e-4 * a.abs().max(b.abs())
}

fn are_same_cameras(a: &Cameras, b: &Cameras) -> bool {
    let same = |a: &ColmapCamera, b: &ColmapCamera| {
        let (of_a, of_b) = (a.params.iter(), b.params.iter());
        (&a.model, a.size, of_a.len()) == (&b.model, b.size, of_b.len())
            && of_a.zip(of_b).all(|(a, b)| are_close(*a, *b))
    };
    a.len() == b.len()
        && a.iter()
            .all(|(id, a)| b.get(id).is_some_and(|b| same(a, b)))
}

fn are_same_images(a: &[ColmapImage], b: &[ColmapImage]) -> bool {
    let by_name = |images: &'_ [ColmapImage]| -> BTreeMap<String, ColmapImage> {
        let named = images
            .iter()
            .map(|image| (image.name.clone(), image.clone()));
        named.collect()
    };
    let (a, b) = (by_name(a), by_name(b));
    let same = |a: &ColmapImage, b: &ColmapImage| match (a.camera_from_world, b.camera_from_world) {
        (Some(one), Some(other)) => {
            let turned = (one.rotation - other.rotation).to_cols_array();
            let moved = one.translation - other.translation;
            turned.iter().all(|d| d.abs() < 1e-4)
                && moved.length() < 1e-6 + 1e-4 * one.translation.length()
        }
        (one, other) => one.is_none() == other.is_none(),
    };
    a.len() == b.len()
        && a.iter()
            .all(|(name, a)| b.get(name).is_some_and(|b| same(a, b)))
}

/// Reads only the cameras of a model, in the same format as its images; `None` if the folder has no
/// cameras file.
///
/// # Errors
/// If the file is invalid; names the file. If there are no images, text and binary cameras that
/// contradict each other are rejected.
pub fn read_cameras(folder: &Path) -> Result<Option<(PathBuf, Cameras)>, DatasetError> {
    let [binary, text] = ["bin", "txt"].map(|kind| folder.join(format!("cameras.{kind}")));
    let file = match (binary.is_file(), text.is_file()) {
        (false, false) => return Ok(None),
        (true, true) if kind(folder) == "txt" => text,
        (true, true) if !is_model(folder) => {
            let cameras = read_cameras_of(&binary)?;
            if !are_same_cameras(&cameras, &read_cameras_of(&text)?) {
                let reason = "contradicts cameras.txt next to it; remove the wrong file";
                return Err(DatasetError::malformed(binary, reason));
            }
            return Ok(Some((binary, cameras)));
        }
        (true, _) => binary,
        (false, true) => text,
    };
    let cameras = read_cameras_of(&file)?;
    Ok(Some((file, cameras)))
}

fn read_cameras_of(file: &Path) -> Result<Cameras, DatasetError> {
    if file.extension().is_some_and(|extension| extension == "bin") {
        files::parse(file, colmap_binary::cameras)
    } else {
        files::parse_text(file, colmap_text::cameras)
    }
}

/// Reads the points of a model; text or binary, like the model's other files. `None` if the model
/// has no points file.
///
/// # Errors
/// If the file is invalid; names the file.
pub fn read_points(folder: &Path) -> Result<Option<(PathBuf, Vec<ColmapPoint>)>, DatasetError> {
    let of_kind = |kind: &str| Some(folder.join(format!("points3D.{kind}")));
    let first = of_kind(kind(folder)).filter(|file| file.is_file());
    let others = ["bin", "txt"].iter().filter_map(|kind| of_kind(kind));
    // A folder without a complete model may still have a file of points, of either kind.
    let others = others.filter(|file| !is_model(folder) && file.is_file());
    let Some(file) = first.into_iter().chain(others).next() else {
        return Ok(None);
    };
    let points = if file.extension().is_some_and(|extension| extension == "bin") {
        files::parse(&file, colmap_binary::points)?
    } else {
        files::parse_text(&file, colmap_text::points)?
    };
    Ok(Some((file, points)))
}
