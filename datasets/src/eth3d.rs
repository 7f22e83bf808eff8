//! ETH3D's high-resolution multi-view training set.
//!
//! `dslr_calibration_undistorted` and `dslr_calibration_jpg` are COLMAP text models in metres;
//! picture names are relative to `images/`. Ground-truth depth is bare f32 metres in the geometry
//! of the *distorted* pictures and semi-sparse, so its samples are carried to the pinhole camera
//! one by one instead of being looked up.

use std::path::Path;
use std::sync::Arc;

use crate::depth::{Encoding, Resampling, StoredDepth};
use crate::files::Root;
use crate::finder::Finder;
use crate::format::colmap::{self, Model};
use crate::format::colmap_records::Image;
use crate::posed::{self, Depth, Pinhole, Posed, frame_id};
use crate::skipped::Skipped;
use crate::spec::{Attempts, Choice, DatasetSpec, Format, Setting, conclude};
use crate::undistort::Undistortion;
use crate::{DatasetError, Pairing, Scene, processing};

/// The catalogue's entry.
pub(crate) const FORMAT: Format = Format {
    name: "eth3d",
    summary: "ETH3D high-resolution multi-view: <scene>/images/dslr_images, dslr_calibration_jpg, \
              ground_truth_depth",
    settings: &[Setting::choice(
        "images",
        "which photographs",
        &[
            Choice::new(
                "distorted",
                "as taken, 6048x4032 as the paper states, undistorted by us at that size",
            ),
            Choice::proxy(
                "undistorted",
                "as published without distortion: 6198x4129 to 6214x4138, a size a camera",
            ),
        ],
    )],
    open,
};

fn open(spec: &DatasetSpec) -> Result<Attempts, DatasetError> {
    let root = Root::open(&spec.path)?;
    let distorted = spec.setting("images") == "distorted";
    let calibration = if distorted {
        "dslr_calibration_jpg"
    } else {
        "dslr_calibration_undistorted"
    };
    let found = root.find_folders(3, &|folder| colmap::is_model(&folder.join(calibration)))?;
    let scenes = found
        .folders
        .iter()
        .map(|folder| read_scene(spec, &root, folder, calibration, distorted))
        .collect();
    let expected = if distorted {
        "<scene>/dslr_calibration_jpg and <scene>/images/dslr_images; for the pictures published \
         without distortion say images=undistorted"
    } else {
        "<scene>/dslr_calibration_undistorted and <scene>/images/dslr_images_undistorted"
    };
    conclude(spec, scenes, expected, &[&found.passed_over])
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    calibration: &str,
    distorted: bool,
) -> Result<Scene, DatasetError> {
    let model_folder = root.resolve(folder, calibration)?;
    colmap::check_inside(root, &model_folder)?;
    let model = colmap::read_model(&model_folder)?;
    let id = root.id_of(folder);
    let mut notes = Vec::new();
    // Only the distorted cameras say where a depth sample lies.
    let stored_folder = root.resolve(folder, "dslr_calibration_jpg")?;
    let stored = if colmap::is_model(&stored_folder) {
        colmap::check_inside(root, &stored_folder)?;
        Some(colmap::read_model(&stored_folder)?)
    } else {
        notes.push(format!(
            "{id}: no dslr_calibration_jpg, without which the published depth cannot be placed"
        ));
        None
    };
    let pictures = root.resolve(folder, "images")?;
    let maps = root.resolve(folder, "ground_truth_depth/dslr_images")?;
    let images_file = model.files.last().map_or(model_folder.as_path(), |f| f);
    let mut finder = Finder::new(root, images_file);
    let mut skipped = Skipped::default();
    let mut views = Vec::new();
    for image in &model.images {
        let Some(camera_from_world) = image.camera_from_world else {
            skipped.add(
                "the pose is not finite or its quaternion is zero",
                &image.name,
            );
            continue;
        };
        let Some(path) = finder.picture(&pictures, &image.name)? else {
            skipped.add("the picture does not exist", &image.name);
            continue;
        };
        let lens = lens_of(&model, image)?;
        let name = image.name.rsplit('/').next().unwrap_or(&image.name);
        let plain = maps.join(name);
        let map = [plain.clone(), maps.join(format!("{name}.gz"))]
            .into_iter()
            .find(|p| p.is_file());
        let depth = match (map, &stored) {
            (Some(map), Some(stored)) => {
                root.check(&map)?;
                let stored_lens = lens_of(stored, &same_picture(stored, image, name))?;
                let k = stored_lens.intrinsics();
                if distorted {
                    Depth::Map(map, Encoding::RawFloats, Resampling::Splat)
                } else {
                    let undistortion = Undistortion::new(stored_lens, lens.intrinsics());
                    Depth::Ready(Arc::new(StoredDepth {
                        file: map,
                        encoding: Encoding::RawFloats,
                        size: (k.width, k.height),
                        undistortion: Some((undistortion, Resampling::Splat)),
                    }))
                }
            }
            _ => Depth::None,
        };
        views.push(
            Posed {
                id: frame_id(&image.name),
                image: path,
                lens,
                pinhole: Pinhole::WithoutBlankPixels,
                camera_from_world,
                mask: None,
                depth,
                cameras: model.files.clone(),
            }
            .into_view()?,
        );
    }
    posed::finish(&mut views);
    if !distorted {
        notes.push("pictures: dslr_images_undistorted, as published".to_owned());
    }
    if stored.is_some() {
        let said = if processing::without_depth(&views) == views.len() {
            "depth: none in ground_truth_depth/dslr_images"
        } else {
            "depth: ground_truth_depth/dslr_images, each sample carried by us to the pinhole camera"
        };
        notes.push(said.to_owned());
    }
    notes.extend(skipped.notes(&model_folder));
    notes.extend(finder.notes());
    if views.is_empty() {
        let other = if distorted {
            "; images=undistorted reads those published without distortion"
        } else {
            ""
        };
        return Err(DatasetError::malformed(
            model_folder,
            format!("no usable picture; {}{other}", notes.join("; ")),
        ));
    }
    Ok(Scene {
        dataset: spec.name.clone(),
        cluster: id.clone(),
        id,
        views,
        pairing: Pairing::MultiView,
        notes,
    })
}

/// The entry of the same photograph in another model: by file name, else as if by camera id.
fn same_picture(stored: &Model, image: &Image, name: &str) -> Image {
    stored
        .images
        .iter()
        .find(|other| other.name.rsplit('/').next() == Some(name))
        .unwrap_or(image)
        .clone()
}

fn lens_of(model: &Model, image: &Image) -> Result<crate::lens::Lens, DatasetError> {
    let malformed = |reason: String| {
        DatasetError::malformed(
            model.files[0].clone(),
            format!("camera {}: {reason}", image.camera_id),
        )
    };
    model
        .cameras
        .get(&image.camera_id)
        .ok_or_else(|| malformed(format!("does not exist, but '{}' names it", image.name)))?
        .lens()
        .map_err(malformed)
}
