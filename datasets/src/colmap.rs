//! Anyone's own pictures with a COLMAP model.
//!
//! COLMAP's conventions are ours: world-to-camera poses, pixel centres at half integers. The
//! model's units, times `scale`, are metres. Pictures with lens distortion are resampled to a
//! pinhole camera; an EXIF orientation is not applied, as COLMAP does not.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::camera_size::{CAMERA_SIZE, CameraSizes};
use crate::depth::{Encoding, Resampling};
use crate::files::Root;
use crate::finder::Finder;
use crate::format::colmap;
use crate::posed::{self, Depth, Pinhole, Posed, frame_id};
use crate::skipped::Skipped;
use crate::spec::{Attempts, Choice, DatasetSpec, Format, OUTSIDE, Setting, conclude};
use crate::{DatasetError, Pairing, Scene};

/// The catalogue's entry.
pub(crate) const FORMAT: Format = Format {
    name: "colmap",
    summary: "your own pictures with a COLMAP model, text or binary: images/ and sparse/0/",
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
                Choice::new(
                    "folder",
                    "maps named as the pictures, in depth/, if it is there",
                ),
                Choice::new(
                    "points",
                    "the triangulated points that each picture sees: sparse",
                ),
                Choice::new("none", "nowhere"),
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
};

/// Where a model may lie, seen from a scene's folder.
const MODELS: [&str; 6] = [
    "sparse/0",
    "sparse",
    "colmap/sparse/0",
    "colmap/sparse",
    "colmap",
    ".",
];

fn open(spec: &DatasetSpec) -> Result<Attempts, DatasetError> {
    let root = Root::open(&spec.path)?.allowing_outside(spec.setting("outside") == "allow");
    // Asked once, before any scene: a wrong value is no scene's fault.
    let units = (spec.positive("scale")?, spec.positive("depth-unit")?);
    let found = root.find_folders(3, &|folder| model_of(folder).is_some())?;
    let mut scenes = Vec::new();
    for folder in &found.folders {
        if let Some(model) = model_of(folder) {
            scenes.push(read_scene(spec, &root, folder, &model, units));
        }
    }
    let expected = "images/ and sparse/0/ with cameras and images (.bin or .txt)";
    conclude(spec, scenes, expected, &[&found.passed_over])
}

fn model_of(folder: &Path) -> Option<PathBuf> {
    MODELS
        .iter()
        .map(|m| {
            if *m == "." {
                folder.to_owned()
            } else {
                folder.join(m)
            }
        })
        .find(|m| colmap::is_model(m))
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    model_folder: &Path,
    (scale, unit): (f64, f64),
) -> Result<Scene, DatasetError> {
    colmap::check_inside(root, model_folder)?;
    let model = colmap::read_model(model_folder)?;
    let images_file = model.files.last().cloned().unwrap_or_default();
    let pictures = root.resolve(folder, spec.setting("images"))?;
    let maps = root.resolve(folder, "depth")?;
    let from_folder = spec.setting("depth") == "folder" && maps.is_dir();
    let tracks = if spec.setting("depth") == "points" {
        Some(Tracks::read(model_folder, scale)?)
    } else {
        None
    };

    let mut finder = Finder::new(root, &images_file);
    let mut skipped = Skipped::default();
    let mut sizes = CameraSizes::new(spec);
    let mut views = Vec::new();
    for image in &model.images {
        let found = finder.picture(&pictures, &image.name)?;
        let Some(mut pose) = image.camera_from_world else {
            skipped.add(
                "the pose is not finite or its quaternion is zero",
                &image.name,
            );
            continue;
        };
        let Some(path) = found else {
            skipped.add("the picture does not exist", &image.name);
            continue;
        };
        let malformed = |reason: String| {
            DatasetError::malformed(
                &model.files[0],
                format!("camera {}: {reason}", image.camera_id),
            )
        };
        let lens = model
            .cameras
            .get(&image.camera_id)
            .ok_or_else(|| malformed(format!("does not exist, but '{}' names it", image.name)))?
            .lens()
            .map_err(malformed)?;
        let lens = sizes.fit(lens, &path)?;
        pose.translation *= scale;
        let id = frame_id(&image.name);
        let map = if from_folder {
            finder.map(&maps, &id)?
        } else {
            None
        };
        let depth = match (&tracks, map) {
            (Some(tracks), _) => tracks.of(image.id),
            (None, Some(map)) => Depth::Map(map, Encoding::Units(unit), Resampling::Nearest),
            (None, None) => Depth::None,
        };
        views.push(
            Posed {
                id,
                image: path,
                lens,
                pinhole: Pinhole::WithoutBlankPixels,
                camera_from_world: pose,
                mask: None,
                depth,
                cameras: model.files.clone(),
            }
            .into_view()?,
        );
    }
    posed::finish(&mut views);
    let mut notes = skipped.notes(&images_file);
    notes.extend(finder.notes());
    notes.extend(sizes.notes(&images_file));
    if model.text_ignored {
        notes.push(format!(
            "{}: the binary model was read, the text model beside it was not",
            model_folder.display()
        ));
    }
    if views.is_empty() {
        return Err(DatasetError::malformed(
            images_file,
            format!(
                "no usable picture in {}; {}",
                pictures.display(),
                notes.join("; ")
            ),
        ));
    }
    let id = root.id_of(folder);
    Ok(Scene {
        dataset: spec.name.clone(),
        cluster: id.clone(),
        id,
        views,
        pairing: Pairing::MultiView,
        notes,
    })
}

/// The points that each image sees.
pub(crate) struct Tracks {
    file: PathBuf,
    points: BTreeMap<u32, Vec<DVec3>>,
}

impl Tracks {
    /// Reads a model's points.
    ///
    /// # Errors
    /// Names the file, also when there is none.
    pub(crate) fn read(model_folder: &Path, scale: f64) -> Result<Self, DatasetError> {
        let (file, list) = colmap::read_points(model_folder)?.ok_or_else(|| {
            DatasetError::malformed(model_folder, "no points3D.bin or points3D.txt")
        })?;
        let mut points: BTreeMap<u32, Vec<DVec3>> = BTreeMap::new();
        for point in list {
            for image in point.seen_by {
                points
                    .entry(image)
                    .or_default()
                    .push(point.position * scale);
            }
        }
        Ok(Self { file, points })
    }

    /// The depth of one image.
    pub(crate) fn of(&self, image: u32) -> Depth {
        Depth::Points(
            self.file.clone(),
            self.points.get(&image).cloned().unwrap_or_default(),
        )
    }
}
