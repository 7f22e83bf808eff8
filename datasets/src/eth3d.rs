//! ETH3D's high-resolution multi-view training set.
//!
//! `dslr_calibration_undistorted` and `dslr_calibration_jpg` are COLMAP text models in metres;
//! picture names are relative to `images/`. Ground-truth depth consists of bare f32 metres in the
//! geometry of the *distorted* pictures. The depth is semi-sparse, so its samples are projected to
//! the pinhole camera one by one instead of being looked up.

use std::path::Path;

use crate::depth::{DepthEncoding, ViewDepth};
use crate::files::Root;
use crate::format::colmap;
use crate::found_scenes::FoundScenes;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::scene_builder::{NO_POSE, Pinhole, PosedFrame, SceneBuilder, frame_id};
use crate::setting::{Setting, choice, proxy};
use crate::spec::PaperOverlap;
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "eth3d",
    display_name: "ETH3D",
    title: "ETH3D high-resolution multi-view, training set",
    page: "https://www.eth3d.net/datasets",
    terms: "CC BY-NC-SA 4.0",
    may_publish: true,
    download: "<scene>_dslr_jpg.7z and _dslr_depth.7z of 13 scenes; _dslr_undistorted.7z for images=undistorted",
    size: "24-megapixel pictures; every depth map is 97,542,144 bytes",
    layout: "<scene>/{images/dslr_images, dslr_calibration_jpg, ground_truth_depth/dslr_images}; \
             or images/dslr_images_undistorted and dslr_calibration_undistorted next to them",
    paper_column: "ETH3D",
    paper_overlap: PaperOverlap::Sparse,
    caveat: "depth is semi-sparse; the paper estimates overlap from monocular depth",
    settings: &[Setting::choice(
        "images",
        "which form of the photographs",
        &[
            choice(
                "distorted",
                "as taken, 6048x4032 as the paper states, undistorted by sharp-bench at that size",
            ),
            proxy(
                "undistorted",
                "as published without distortion: 6198x4129 to 6214x4138, depending on the camera",
            ),
        ],
    )],
    poses_are_matrices: false,
    open,
    required_files,
    archives,
};

const DISTORTED: &str = "dslr_calibration_jpg";
const UNDISTORTED: &str = "dslr_calibration_undistorted";
const DEPTH: &str = "ground_truth_depth/dslr_images";

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    let top = photo.picture.split("/images/").next();
    let top = top.unwrap_or(photo.scene);
    // Depth maps are aligned with the distorted pictures, whose cameras are therefore always
    // needed.
    let models: &[&str] = if photo.folder.ends_with("undistorted") {
        &[UNDISTORTED, DISTORTED]
    } else {
        &[DISTORTED]
    };
    let lists = models.iter().flat_map(|model| {
        ["cameras.txt", "images.txt"]
            .map(|list| RequiredFile::camera(format!("{top}/{model}/{list}")))
    });
    let map = format!("{top}/{DEPTH}/{}", photo.name);
    let depth = RequiredFile::depth(map.clone()).or(map + ".gz");
    lists.chain([depth]).collect()
}

fn archives(photo: &PhotographPath<'_>) -> Vec<String> {
    let undistorted = photo.picture.contains("/dslr_images_undistorted/");
    // Depth maps are aligned with the distorted pictures, so the archive with the cameras of these
    // pictures is always needed.
    let parts = ["dslr_jpg", "dslr_depth"].into_iter();
    parts
        .chain(undistorted.then_some("dslr_undistorted"))
        .map(|part| format!("{}_{part}.7z", photo.scene_name()))
        .collect()
}

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let root = Root::open(&spec.path)?;
    let distorted = spec.setting("images") == "distorted";
    let (calibration, expected) = if distorted {
        (
            DISTORTED,
            "<scene>/dslr_calibration_jpg and <scene>/images/dslr_images; for the pictures published without \
             distortion set images=undistorted",
        )
    } else {
        (
            UNDISTORTED,
            "<scene>/dslr_calibration_undistorted and <scene>/images/dslr_images_undistorted",
        )
    };
    let search = root.find_folders(3, &|folder| {
        let parts = [
            DISTORTED,
            UNDISTORTED,
            DEPTH,
            "images/dslr_images",
            "images/dslr_images_undistorted",
        ];
        parts.iter().any(|part| folder.join(part).is_dir())
    })?;
    let mut found = FoundScenes::default();
    for folder in &search.folders {
        let scene = if colmap::is_model(&folder.join(calibration)) {
            read_scene(spec, &root, folder, calibration, distorted)
        } else {
            let reason = format!("no complete model; expected {expected}");
            Err(DatasetError::malformed(folder.join(calibration), reason))
        };
        found.add(root.id_of(folder), scene);
    }
    spec.conclude(found, expected, search.unsearched)
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    calibration: &str,
    distorted: bool,
) -> Result<Scene, DatasetError> {
    let model = colmap::read_model_in(root, &root.resolve(folder, calibration)?)?;
    let id = root.id_of(folder);
    let mut scene = SceneBuilder::new(spec, root, model.images_file());
    // Only the distorted cameras determine the positions of depth samples.
    let stored_folder = root.resolve(folder, DISTORTED)?;
    let stored = if colmap::is_model(&stored_folder) {
        Some(colmap::read_model_in(root, &stored_folder)?)
    } else {
        scene.notes.push(format!(
            "{id}: no dslr_calibration_jpg, which is needed to place the published depth in the pictures, so there is \
             no depth"
        ));
        None
    };
    let pictures = root.resolve(folder, "images")?;
    let maps = root.resolve(folder, DEPTH)?;
    for image in &model.images {
        let found = scene.finder.picture(&pictures, &image.name)?;
        let Some((path, camera_from_world)) =
            scene.usable(&image.name, found, image.camera_from_world.ok_or(NO_POSE))
        else {
            continue;
        };
        let name = image.name.rsplit('/').next().unwrap_or(&image.name);
        let map = [maps.join(name), maps.join(format!("{name}.gz"))]
            .into_iter()
            .find(|p| p.is_file());
        let mut cameras = model.files.clone();
        let depth = match (map, &stored) {
            (Some(map), Some(stored)) => {
                root.check(&map)?;
                cameras.extend(stored.files.iter().cloned());
                // The entry of the same photograph: the one with the same file name, or else with
                // the same camera id.
                let mut entries = stored.images.iter();
                let entry = entries.find(|other| other.name.rsplit('/').next() == Some(name));
                let lens = stored.needed_lens(entry.unwrap_or(image))?;
                Some(ViewDepth::MapOf(map, DepthEncoding::RawFloats, lens))
            }
            _ => None,
        };
        scene.add(PosedFrame {
            id: frame_id(&image.name),
            image: path,
            lens: model.needed_lens(image)?,
            pinhole: Pinhole::WithoutBlankPixels,
            camera_from_world,
            mask: None,
            depth,
            cameras,
        })?;
    }
    if !distorted {
        let note = "pictures: dslr_images_undistorted, as published";
        scene.notes.push(note.to_owned());
    }
    if stored.is_some() {
        let note = if scene.has_depth() {
            "depth: ground_truth_depth/dslr_images, each sample moved by sharp-bench to the \
             pinhole camera"
        } else {
            "depth: none in ground_truth_depth/dslr_images"
        };
        scene.notes.push(note.to_owned());
    }
    let hint = if distorted {
        "; images=undistorted reads the pictures published without distortion"
    } else {
        ""
    };
    scene.finish_with_views(id, hint)
}
