//! Anyone's own pictures with a COLMAP model.
//!
//! COLMAP's conventions are ours: world-to-camera poses, pixel centres at half integers. The
//! model's units, times `scale`, are metres. Pictures with lens distortion are resampled to a
//! pinhole camera; an EXIF orientation is not applied, as COLMAP does not.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::camera_size::CAMERA_SIZE;
use crate::depth::{DepthEncoding, ViewDepth};
use crate::entry::{DatasetEntry, OUTSIDE, Setting, choice};
use crate::files::Root;
use crate::format::colmap;
use crate::left_out::FoundScenes;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::scene_builder::{Pinhole, PosedFrame, SceneBuilder, frame_id};
use crate::{DatasetError, DatasetSpec, Scene, picture_notes};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "colmap",
    display_name: "COLMAP",
    title: "your own pictures with a COLMAP model",
    page: "https://colmap.github.io/format.html",
    layout: "images/, sparse/0/{cameras, images}.{bin or txt}; depth/ if there is any",
    caveat: "the model's unit is taken as metres; say scale= if it is not",
    settings: &[
        Setting::free("scale", "metres of one unit of the model", "1"),
        Setting::free(
            "images",
            "folder of the pictures, beside the model's",
            "images",
        ),
        Setting::choice(
            "depth",
            "where depth comes from",
            &[
                choice(
                    "folder",
                    "maps named as the pictures, in depth/, if it is there",
                ),
                choice(
                    "points",
                    "the triangulated points that each picture sees: sparse",
                ),
                choice("none", "nowhere"),
            ],
        ),
        Setting::free(
            "depth-unit",
            "metres of one unit of the maps in depth/",
            "0.001",
        ),
        CAMERA_SIZE,
        OUTSIDE,
    ],
    open,
    required_files,
    ..DatasetEntry::OWN
};

/// Where a model may lie, seen from a scene's folder.
const MODELS: [&str; 6] = [
    "sparse/0",
    "sparse",
    "colmap/sparse/0",
    "colmap/sparse",
    "colmap",
    "",
];

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    let file = |list: &str, extension: &str| photo.above(&format!("sparse/0/{list}.{extension}"));
    ["cameras", "images"]
        .map(|list| RequiredFile::camera(file(list, "bin")).or(file(list, "txt")))
        .into()
}

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let root = Root::open(&spec.path)?.allowing_outside(spec.setting("outside") == "allow");
    // Asked once, before any scene: a wrong value is no scene's fault.
    let units = (spec.positive("scale")?, spec.positive("depth-unit")?);
    let model_of = |folder: &Path| {
        let mut places = MODELS.iter().map(|place| folder.join(place));
        places.find(|place| colmap::is_model(place))
    };
    let search = root.find_folders(3, &|folder| {
        let mut places = MODELS.iter().map(|place| folder.join(place));
        let begun = |place: &Path| ["cameras.bin", "cameras.txt"].map(|n| place.join(n).is_file());
        folder.join("sparse").is_dir() || places.any(|place| begun(&place).contains(&true))
    })?;
    let expected = "images/ and sparse/0/ with cameras and images (.bin or .txt)";
    let mut found = FoundScenes::default();
    for folder in &search.folders {
        let scene = match model_of(folder) {
            Some(model) => read_scene(spec, &root, folder, &model, units),
            None => {
                let reason = format!("no whole model; expected {expected}");
                Err(DatasetError::malformed(folder, reason))
            }
        };
        found.add(root.id_of(folder), scene);
    }
    spec.conclude(found, expected, search.unsearched)
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    model_folder: &Path,
    (scale, unit): (f64, f64),
) -> Result<Scene, DatasetError> {
    let model = colmap::read_model_in(root, model_folder)?;
    let pictures = root.resolve(folder, spec.setting("images"))?;
    let maps = root.resolve(folder, "depth")?;
    let from_folder = spec.setting("depth") == "folder" && maps.is_dir();
    let tracks = if spec.setting("depth") == "points" {
        Some(PointTracks::read(model_folder, scale)?)
    } else {
        None
    };
    let mut scene = SceneBuilder::new(spec, root, model.images_file());
    for image in &model.images {
        let found = scene.finder.picture(&pictures, &image.name)?;
        let Some((path, mut pose)) = scene.usable(&image.name, found, image.camera_from_world)
        else {
            continue;
        };
        pose.translation *= scale;
        let id = frame_id(&image.name);
        let map = if from_folder {
            scene.finder.map(&maps, &id)?
        } else {
            None
        };
        let depth = match (&tracks, map) {
            (Some(tracks), _) => Some(tracks.depth_of(image.id)),
            (None, map) => map.map(|map| ViewDepth::Map(map, DepthEncoding::Units(unit))),
        };
        scene.add(PosedFrame {
            id,
            image: path,
            lens: model.lens(image)?,
            pinhole: Pinhole::WithoutBlankPixels,
            camera_from_world: pose,
            mask: None,
            depth,
            cameras: model.files.clone(),
        })?;
    }
    let hint = "; this format has no masks, `nerfstudio` has";
    scene
        .notes
        .extend(picture_notes::unread_masks(folder, hint));
    if model.text_ignored {
        scene.notes.push(format!(
            "{}: the binary model was read, the text model beside it was not",
            model_folder.display()
        ));
    }
    if model_folder.ends_with("sparse/0") && colmap::is_model(&model_folder.with_file_name("1")) {
        scene.notes.push(format!(
            "{}: the first of several models was read, the pictures of the others were not",
            model_folder.display()
        ));
    }
    let hint = format!("; pictures are looked for in {}", pictures.display());
    scene.finish_with_views(root.id_of(folder), &hint)
}

/// The triangulated points that each image sees.
pub(crate) struct PointTracks {
    file: PathBuf,
    points: BTreeMap<u32, Vec<DVec3>>,
}

impl PointTracks {
    /// # Errors
    /// Names the file, also when there is none.
    pub(crate) fn read(model_folder: &Path, scale: f64) -> Result<Self, DatasetError> {
        let (file, list) = colmap::read_points(model_folder)?.ok_or_else(|| {
            DatasetError::malformed(model_folder, "no points3D.bin or points3D.txt")
        })?;
        let mut points: BTreeMap<u32, Vec<DVec3>> = BTreeMap::new();
        for point in list {
            for image in point.seen_by {
                let seen = points.entry(image).or_default();
                seen.push(point.position * scale);
            }
        }
        Ok(Self { file, points })
    }

    pub(crate) fn depth_of(&self, image: u32) -> ViewDepth {
        let points = self.points.get(&image).cloned().unwrap_or_default();
        ViewDepth::Points(self.file.clone(), points)
    }
}
