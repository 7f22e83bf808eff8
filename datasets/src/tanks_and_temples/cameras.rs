//! Cameras of a scene: from a COLMAP model, or as recommended on the download page.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::DatasetError;
use crate::files::Root;
use crate::format::{colmap, picture};
use crate::lens::{Distortion, Lens};
use crate::scene_builder::frame_id;

#[derive(Debug)]
pub(super) struct SceneCameras {
    kind: Kind,
    /// Files from which the cameras were read; empty for recommended cameras.
    pub(super) files: Vec<PathBuf>,
}

#[derive(Debug)]
enum Kind {
    One(Lens),
    /// One camera per picture, by the picture's name without folder and extension.
    Each(BTreeMap<String, Lens>),
}

impl SceneCameras {
    /// Cameras of the first COLMAP model found: next to the log, in `sparse/0` or in `sparse`;
    /// `None` if there is no model. If the model has only one camera, it applies to all pictures;
    /// otherwise the model's `images` assigns a camera to each picture.
    ///
    /// # Errors
    /// Names the file that is broken, or that has several cameras without an assignment to
    /// pictures.
    pub(super) fn of_model(root: &Root, folder: &Path) -> Result<Option<Self>, DatasetError> {
        for place in [".", "sparse/0", "sparse"] {
            let model = root.resolve(folder, place)?;
            let Some((file, cameras)) = colmap::read_cameras_in(root, &model)? else {
                continue;
            };
            if let (1, Some(camera)) = (cameras.len(), cameras.values().next()) {
                let lens = camera.lens();
                return Ok(Some(Self {
                    kind: Kind::One(lens.map_err(|e| DatasetError::format(&file, e))?),
                    files: vec![file],
                }));
            }
            if cameras.is_empty() || !colmap::is_model(&model) {
                return Err(DatasetError::malformed(
                    file,
                    format!(
                        "has {} cameras; it must have a single camera for the whole scene (COLMAP's \
                         --ImageReader.single_camera 1), or images.bin or images.txt next to it, which assigns \
                         cameras to pictures; intrinsics=0.7w needs no model",
                        cameras.len()
                    ),
                ));
            }
            return Self::by_name(colmap::read_model_in(root, &model)?).map(Some);
        }
        Ok(None)
    }

    fn by_name(model: colmap::Model) -> Result<Self, DatasetError> {
        let mut lenses = BTreeMap::new();
        let mut ids = BTreeMap::new();
        for image in &model.images {
            let name = key_of(&image.name);
            if *ids.entry(name.clone()).or_insert(image.camera_id) != image.camera_id {
                let reason = format!("assigns more than one camera to pictures named {name}");
                return Err(DatasetError::malformed(model.images_file(), reason));
            }
            lenses.insert(name, model.needed_lens(image)?);
        }
        Ok(Self {
            kind: Kind::Each(lenses),
            files: model.files,
        })
    }

    /// One camera for all pictures: its focal length is `share` of the first picture's width, and its principal point
    /// is the centre.
    ///
    /// # Errors
    /// If the picture cannot be read; names the picture.
    pub(super) fn recommended(share: f64, picture: &Path) -> Result<Self, DatasetError> {
        let size = picture::dimensions(picture)?;
        let (w, h) = (f64::from(size.0), f64::from(size.1));
        let lens = Lens::new(
            (share * w, share * w),
            (w / 2.0, h / 2.0),
            size,
            Distortion::None,
        );
        Ok(Self {
            kind: Kind::One(lens.map_err(|source| DatasetError::camera(picture, source))?),
            files: Vec::new(),
        })
    }

    /// Camera of a picture; `None` if the model does not list it.
    pub(super) fn of(&self, picture: &Path) -> Option<Lens> {
        match &self.kind {
            Kind::One(lens) => Some(*lens),
            Kind::Each(lenses) => {
                let name = picture.file_name().unwrap_or_default().to_string_lossy();
                lenses.get(&key_of(&name)).copied()
            }
        }
    }
}

/// Name of a picture without folders and extension, because the model may use another extension.
fn key_of(name: &str) -> String {
    let id = frame_id(name);
    id.rsplit('/').next().unwrap_or(&id).to_owned()
}
