//! WildRGB-D: phone captures of objects, with LiDAR depth in millimetres.
//!
//! A category has `nvs_list.json` and `scenes/scene_000/` with `rgb/00000.png`, `depth/00000.png`,
//! `metadata` (JSON) and `cam_poses.txt` (frame number and camera-to-world matrix, metres, OpenCV
//! axes). K in `metadata` is column-major, with the first pixel's centre at (0, 0), so 0.5 is added
//! to the principal point. The dataset has terabytes of data, so the lists are read first, and only
//! the folders that they list are accessed.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::depth::{DepthEncoding, DepthKind, ViewDepth};
use crate::files::{self, Root};
use crate::format::{lenient_json, trajectory};
use crate::found_scenes::FoundScenes;
use crate::left_out::LeftOut;
use crate::lens::{Distortion, Lens};
use crate::required_files::{PhotographPath, RequiredFile};
use crate::scene_builder::{Pinhole, PosedFrame, SceneBuilder, no_pose};
use crate::setting::{Setting, choice, proxy};
use crate::spec::PaperOverlap;
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene, natural_order};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "wildrgbd",
    display_name: "WildRGB-D",
    title: "WildRGB-D",
    page: "https://github.com/wildrgbd/wildrgbd",
    terms: "MIT (the repository's licence; no separate terms for the data)",
    may_publish: true,
    download: "one multi-part archive per category; join the parts before unpacking",
    size: "3.37 TB for all 46 categories, 4 TB unpacked",
    layout: "<category>/nvs_list.json, <category>/scenes/scene_*/{rgb, depth, metadata, \
             cam_poses.txt}",
    paper_column: "WildRGBD",
    paper_overlap: PaperOverlap::Dense,
    caveat: "the paper's 'validation split from nvs list in each scene' may mean scenes or frames",
    poses_are_matrices: true,
    settings: &[Setting::choice(
        "split",
        "which scenes and frames of the nvs list",
        &[
            choice("val-scenes", "all frames of the scenes in 'val'"),
            choice(
                "val-frames",
                "the frames in 'val' of a nvs_list.json inside each scene's own folder",
            ),
            proxy("train-scenes", "all frames of the scenes in 'train'"),
            proxy("all-scenes", "every scene folder, without a list"),
        ],
    )
    .left_open()],
    open,
    required_files,
    archives: |photo| vec![format!("category {}", photo.top())],
};

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    vec![
        RequiredFile::camera(photo.above("metadata")),
        RequiredFile::camera(photo.above("cam_poses.txt")),
        RequiredFile::list(format!("{}/{LIST}", photo.top())),
        RequiredFile::depth(photo.above(&format!("depth/{}.png", photo.stem))),
    ]
}

const LIST: &str = "nvs_list.json";

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let root = Root::open(&spec.path)?;
    let split = spec.setting("split");
    let by_list = matches!(split, "val-scenes" | "train-scenes");
    let categories = root.find_folders(1, &|folder| {
        folder.join(LIST).is_file()
            || folder.join("scenes").is_dir()
            || every_scene(&root, folder).is_ok_and(|scenes| !scenes.is_empty())
    })?;
    let mut found = FoundScenes::default();
    for category in &categories.folders {
        let folders = if by_list {
            listed_scenes(&root, category, split)
        } else {
            every_scene(&root, category)
        };
        // If a list cannot be read, or a name points outside, the other scenes must still be found.
        let folders = folders.unwrap_or_else(|error| vec![(root.id_of(category), Err(error))]);
        for (id, folder) in folders {
            let by_frame = split == "val-frames";
            let scene = folder.and_then(|folder| read_scene(spec, &root, &folder, by_frame));
            found.add(id, scene);
        }
    }
    let expected = "<category>/nvs_list.json and the scenes that it names, or split=all-scenes";
    spec.conclude(found, expected, categories.unsearched)
}

/// Ids of a category's scenes, each with the scene's folder, or with an error if that folder does not exist.
type Folders = Vec<(String, Result<PathBuf, DatasetError>)>;

/// Folders of the scenes that the category's list names, in natural order.
fn listed_scenes(root: &Root, category: &Path, split: &str) -> Result<Folders, DatasetError> {
    let file = root.resolve(category, LIST)?;
    let key = split.trim_end_matches("-scenes");
    let mut names = names_in(&file, key)?;
    names.sort_by(|a, b| natural_order::compare(a, b));
    let folder_of = |name: &str| -> Result<PathBuf, DatasetError> {
        let direct = root.resolve_listed(&file, category, name)?;
        let nested = root.resolve_listed(&file, category, &format!("scenes/{name}"))?;
        let mut both = [direct, nested].into_iter();
        let there = both.find(|folder| folder.is_dir());
        there.ok_or_else(|| DatasetError::malformed(&file, "lists scenes that do not exist"))
    };
    let with_id = |name: String| match folder_of(&name) {
        Ok(folder) => (root.id_of(&folder), Ok(folder)),
        Err(error) => (format!("{}/{name}", root.id_of(category)), Err(error)),
    };
    Ok(names.into_iter().map(with_id).collect())
}

/// Reads a list of names in a JSON object; numbers are converted to names.
fn names_in(file: &Path, key: &str) -> Result<Vec<String>, DatasetError> {
    let malformed = |reason: String| DatasetError::malformed(file, reason);
    let list = files::parse_text(file, lenient_json::parse)?;
    let names = list
        .get(key)
        .and_then(Value::as_array)
        .ok_or_else(|| malformed(format!("there is no list '{key}'")))?;
    names
        .iter()
        .map(|name| match name {
            Value::String(name) => Ok(name.clone()),
            Value::Number(n) => Ok(n.to_string()),
            other => Err(malformed(format!("'{key}' contains {other}, not a name"))),
        })
        .collect()
}

fn every_scene(root: &Root, category: &Path) -> Result<Folders, DatasetError> {
    let folder = category.join("scenes");
    let folder = if folder.is_dir() {
        folder
    } else {
        category.to_owned()
    };
    Ok(files::list(&folder)?
        .into_iter()
        .filter(|(name, _)| name.starts_with("scene_") || name.starts_with("scenes_"))
        .map(|(_, path)| (root.id_of(&path), Ok(path)))
        .collect())
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    by_frame: bool,
) -> Result<Scene, DatasetError> {
    let metadata = root.resolve(folder, "metadata")?;
    let lens = read_lens(&metadata)?;
    let poses_file = root.resolve(folder, "cam_poses.txt")?;
    let poses = files::parse_text(&poses_file, trajectory::parse_rows)?;
    let wanted: Option<Vec<i64>> = if by_frame {
        let list = root.resolve(folder, LIST)?;
        let number = |name: &String| {
            let reason = || format!("'val' contains '{name}', which is not a frame's number");
            number_of(name).ok_or_else(|| DatasetError::malformed(&list, reason()))
        };
        let frames = names_in(&list, "val")?;
        Some(frames.iter().map(number).collect::<Result<_, _>>()?)
    } else {
        None
    };
    let mut linked = LeftOut::of("file");
    let mut by_number = |name: &str| -> Result<Vec<(i64, PathBuf)>, DatasetError> {
        let files = root.files_in(&root.resolve(folder, name)?, &mut linked);
        let numbered = files.into_iter();
        let numbered = numbered.filter_map(|(name, path)| Some((number_of(&name)?, path)));
        let mut files: Vec<_> = numbered.collect();
        files.sort();
        Ok(files)
    };
    let (pictures, maps) = (by_number("rgb")?, by_number("depth")?);
    let find = |files: &[(i64, PathBuf)], frame: i64| {
        let i = files.binary_search_by_key(&frame, |f| f.0).ok()?;
        Some(files[i].1.clone())
    };
    let mut scene = SceneBuilder::new(spec, root, &poses_file);
    let all: Vec<i64> = pictures.iter().map(|picture| picture.0).collect();
    for frame in wanted.as_ref().unwrap_or(&all) {
        if poses.iter().all(|pose| pose.frame != *frame) {
            scene.leave_out("the frame has no pose", &format!("{frame:05}"));
        }
    }
    for pose in &poses {
        if wanted.as_ref().is_some_and(|w| !w.contains(&pose.frame)) {
            continue;
        }
        let id = format!("{:05}", pose.frame);
        let picture = find(&pictures, pose.frame);
        let world_from_camera = pose.world_from_camera.as_ref().map_err(no_pose);
        let Some((image, world_from_camera)) = scene.usable(&id, picture, world_from_camera) else {
            continue;
        };
        let map = find(&maps, pose.frame);
        scene.add(PosedFrame {
            id,
            image,
            lens,
            pinhole: Pinhole::WithoutBlankPixels,
            camera_from_world: world_from_camera.inverse(),
            mask: None,
            depth: map.map(|map| ViewDepth::Map(map, DepthEncoding::Units(0.001, DepthKind::Z))),
            cameras: vec![metadata.clone(), poses_file.clone()],
        })?;
    }
    scene.notes.extend(linked.notes(folder));
    if !scene.has_depth() {
        let note = "depth: no map of these frames in depth/";
        scene.notes.push(note.to_owned());
    }
    scene.finish_with_views(root.id_of(folder), "")
}

/// The number of a frame, given its name with or without an extension.
fn number_of(name: &str) -> Option<i64> {
    let stem = name.rsplit('/').next().unwrap_or(name);
    stem.split('.').next()?.parse().ok()
}

fn read_lens(file: &Path) -> Result<Lens, DatasetError> {
    let malformed = |reason: String| DatasetError::malformed(file, reason);
    let metadata = files::parse_text(file, lenient_json::parse)?;
    let side = |key: &str| {
        metadata
            .get(key)
            .and_then(Value::as_u64)
            .and_then(|n| u32::try_from(n).ok())
            .ok_or_else(|| malformed(format!("'{key}' is not a number of pixels")))
    };
    let k: Vec<f64> = metadata
        .get("K")
        .and_then(Value::as_array)
        .map(|k| k.iter().filter_map(Value::as_f64).collect())
        .unwrap_or_default();
    let k = <[f64; 9]>::try_from(k).map_err(|_| malformed("'K' is not nine numbers".into()))?;
    // K is column-major, so the principal point is where a row-major K has zeros.
    if k[2] != 0.0 || k[5] != 0.0 {
        return Err(malformed(
            "'K' is not column-major: its third and sixth numbers are not zero".into(),
        ));
    }
    Lens::new(
        (k[0], k[4]),
        (k[6] + 0.5, k[7] + 0.5),
        (side("w")?, side("h")?),
        Distortion::None,
    )
    .map_err(|source| DatasetError::camera(file, source))
}
