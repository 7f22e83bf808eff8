//! The user's own pictures with a COLMAP model.
//!
//! COLMAP's conventions are the same as ours: world-to-camera poses, pixel centres at half integers. The model's units
//! are converted to metres by `scale`. Pictures with lens distortion are resampled to a pinhole camera; EXIF
//! orientations are ignored, as in COLMAP.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::camera_size::CAMERA_SIZE;
use crate::depth::{DepthEncoding, DepthKind, ViewDepth};
use crate::files::{self, Root};
use crate::format::colmap;
use crate::found_scenes::FoundScenes;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::scene_builder::{NO_POSE, Pinhole, PosedFrame, SceneBuilder, frame_id};
use crate::setting::{OUTSIDE, Setting, choice};
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene, scene_notes};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "colmap",
    display_name: "COLMAP",
    title: "your own pictures with a COLMAP model",
    page: "https://colmap.github.io/format.html",
    layout: "images/, sparse/0/{cameras, images}.{bin or txt}; depth/ if available",
    caveat: "the unit is assumed to be metres; otherwise set scale=",
    settings: &[
        Setting::free("scale", "metres per unit of the model", "1"),
        Setting::free(
            "images",
            "folder of the pictures, next to the model's folder",
            "images",
        ),
        Setting::free(
            "model",
            "folder of the model, relative to the scene's folder, e.g. sparse/1 (first: the first model found)",
            "first",
        ),
        Setting::choice(
            "depth",
            "source of depth",
            &[
                choice(
                    "folder",
                    "maps in depth/ with the pictures' names, if that folder exists",
                ),
                choice(
                    "points",
                    "the triangulated points that each picture sees (sparse)",
                ),
                choice("none", "no depth"),
            ],
        ),
        Setting::free(
            "depth-unit",
            "metres per unit of the maps in depth/, for any file format",
            "0.001",
        ),
        DepthKind::SETTING,
        CAMERA_SIZE,
        OUTSIDE,
    ],
    open,
    required_files,
    ..DatasetEntry::OWN
};

/// Possible locations of a model, relative to a scene's folder.
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
    // Parsed before any scene is read, because an invalid value is an error of the whole dataset.
    let units = (spec.positive("scale")?, spec.positive("depth-unit")?);
    let chosen = Some(spec.setting("model")).filter(|model| *model != "first");
    let places = chosen.map_or(MODELS.to_vec(), |model| vec![model]);
    let model_of = |folder: &Path| -> Result<Option<PathBuf>, DatasetError> {
        let places = places.iter().map(|place| root.resolve(folder, place));
        let places = places.collect::<Result<Vec<_>, _>>()?.into_iter();
        Ok(places.into_iter().find(|place| colmap::is_model(place)))
    };
    let search = root.find_folders(3, &|folder| {
        let mut places = places.iter().map(|place| folder.join(place));
        let begun = |place: &Path| ["cameras.bin", "cameras.txt"].map(|n| place.join(n).is_file());
        folder.join("sparse").is_dir() || places.any(|place| begun(&place).contains(&true))
    })?;
    let expected = "images/ and sparse/0/ with cameras and images (.bin or .txt)";
    let mut found = FoundScenes::default();
    for folder in &search.folders {
        let scene = match model_of(folder) {
            Ok(Some(model)) => read_scene(spec, &root, folder, &model, units),
            Ok(None) => {
                let reason = match chosen {
                    Some(model) => format!("no complete model in {model}"),
                    None => format!("no complete model; expected {expected}"),
                };
                Err(DatasetError::malformed(folder, reason))
            }
            Err(error) => Err(error),
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
        let stated = image.camera_from_world.ok_or(NO_POSE);
        let Some((path, mut pose)) = scene.usable(&image.name, found, stated) else {
            continue;
        };
        pose.translation *= scale;
        let lens = match model.lens(image)? {
            Ok(lens) => lens,
            Err(reason) => {
                scene.leave_out(reason, &image.name);
                continue;
            }
        };
        let id = frame_id(&image.name);
        let map = if from_folder {
            scene.finder.map(&maps, &id)?
        } else {
            None
        };
        let depth = match (&tracks, map) {
            (Some(tracks), _) => Some(tracks.depth_of(image.id)),
            (None, map) => {
                map.map(|map| ViewDepth::Map(map, DepthEncoding::Units(unit, DepthKind::of(spec))))
            }
        };
        scene.add(PosedFrame {
            id,
            image: path,
            lens,
            pinhole: Pinhole::WithoutBlankPixels,
            camera_from_world: pose,
            mask: None,
            depth,
            cameras: model.files.clone(),
        })?;
    }
    let hint = "; this format does not support masks, but `nerfstudio` does";
    scene.notes.extend(scene_notes::unread_masks(folder, hint));
    scene.notes.extend(model.notes);
    if spec.setting("model") == "first" {
        let all = model.images.len();
        let others = other_models(folder, model_folder);
        scene.notes.extend((!others.is_empty()).then(|| {
            format!(
                "{}: the first of several models was read ({}), not {}",
                model_folder.display(),
                pictures_of(Ok(all)),
                others.join(", ")
            )
        }));
    }
    let mut folders = vec![(pictures.clone(), "have no pose in the model")];
    folders.extend(from_folder.then_some((maps, "belong to no picture")));
    scene.note_unused(&folders);
    let hint = format!("; pictures are looked for in {}", pictures.display());
    scene.finish_with_views(root.id_of(folder), &hint)
}

/// The models in a scene's folder that were not read, with their sizes and the setting that selects
/// each.
fn other_models(folder: &Path, read: &Path) -> Vec<String> {
    let mut models: Vec<PathBuf> = MODELS.iter().map(|place| folder.join(place)).collect();
    for place in ["sparse", "colmap/sparse"] {
        let numbered = files::list(&folder.join(place)).unwrap_or_default();
        models.extend(numbered.into_iter().map(|(_, path)| path));
    }
    let mut seen = BTreeSet::from([read.to_owned()]);
    models.retain(|model| seen.insert(model.clone()) && colmap::is_model(model));
    let models = models.iter().map(|model| {
        let place = model.strip_prefix(folder).unwrap_or(model).display();
        let size = pictures_of(colmap::picture_count(model));
        format!("{place} with {size} (model={place} would read it)")
    });
    models.collect()
}

fn pictures_of(count: Result<usize, DatasetError>) -> String {
    match count {
        Ok(1) => "1 picture".to_owned(),
        Ok(count) => format!("{count} pictures"),
        Err(_) => "pictures that cannot be read".to_owned(),
    }
}

/// The triangulated points seen by each image.
pub(crate) struct PointTracks {
    file: PathBuf,
    points: BTreeMap<u32, Vec<DVec3>>,
}

impl PointTracks {
    /// Reads a model's points. `scale` is the number of metres per unit of the model.
    ///
    /// # Errors
    /// If the file is missing or invalid; names the file.
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
