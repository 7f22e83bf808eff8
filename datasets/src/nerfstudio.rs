//! The user's own pictures with a `transforms.json`.
//!
//! The conventions are nerfstudio's: OpenGL camera-to-world poses, pixel centres at half integers,
//! paths relative to the JSON. Unlike in nerfstudio, poses are not centred and rescaled; the file's
//! units are converted to metres by `scale`.

use std::path::{Path, PathBuf};

use sharp::camera::RigidTransform;

use crate::camera_size::CAMERA_SIZE;
use crate::depth::{DepthEncoding, DepthKind, ViewDepth};
use crate::files::{self, Root};
use crate::format::transforms::{self, JsonFrame};
use crate::format::{FormatError, picture};
use crate::found_scenes::FoundScenes;
use crate::mask::{Keep, MaskFile, WHITE};
use crate::required_files::{PhotographPath, RequiredFile};
use crate::scene_builder::{Pinhole, PosedFrame, SceneBuilder, frame_id, no_pose};
use crate::setting::{OUTSIDE, Setting, choice};
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene, scene_notes};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "nerfstudio",
    display_name: "nerfstudio",
    title: "your own pictures with transforms.json (nerfstudio, instant-ngp, Blender)",
    page: "https://docs.nerf.studio/quickstart/data_conventions.html",
    layout: "transforms.json (or transforms_train.json) and the pictures it names",
    caveat: "the poses' unit is assumed to be metres; otherwise set scale=",
    poses_are_matrices: true,
    settings: &[
        Setting::free("scale", "metres per unit of the poses", "1"),
        Setting::free(
            "depth-unit",
            "metres per unit of the depth maps, for any file format (as in nerfstudio)",
            "0.001",
        ),
        DepthKind::SETTING,
        Setting::choice(
            "intrinsics",
            "which intrinsics to use if a frame's differ from the whole file's",
            &[
                choice("frame", "the frame's intrinsics"),
                choice("file", "the file's intrinsics, as in nerfstudio"),
            ],
        ),
        Setting::choice(
            "masks",
            "what to do with pixels that a mask excludes",
            &[
                choice("ignore", "nothing; masks are not read"),
                choice(
                    "keep-white",
                    "where a mask is below 128, the picture is black, the depth invalid, and the pixel not scored",
                ),
                choice(
                    "keep-black",
                    "like keep-white, but pixels where a mask is 128 or more are excluded: for masks that mark the \
                     pixels to exclude",
                ),
                choice("apply", "the same as keep-white"),
            ],
        ),
        CAMERA_SIZE,
        OUTSIDE,
    ],
    open,
    required_files,
    ..DatasetEntry::OWN
};

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    vec![RequiredFile::camera(photo.above("transforms.json"))]
}

/// File names that are searched for in a folder; the first that exists is read.
const NAMES: [&str; 2] = ["transforms.json", "transforms_train.json"];
/// Names of further files of the same kind, which are read only if given as the path.
const OTHERS: [&str; 2] = ["transforms_val.json", "transforms_test.json"];

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let (folder, only) = if spec.path.is_file() {
        let folder = spec.path.parent().filter(|p| !p.as_os_str().is_empty());
        (folder.unwrap_or(Path::new(".")), Some(spec.path.clone()))
    } else {
        (spec.path.as_path(), None)
    };
    let root = Root::open(folder)?.allowing_outside(spec.setting("outside") == "allow");
    // Parsed before any scene is read, because an invalid value is an error of the whole dataset.
    let units = (spec.positive("scale")?, spec.positive("depth-unit")?);
    let mut found = FoundScenes::default();
    if let Some(json) = only {
        found.add(root.name(), read_scene(spec, &root, &json, units));
        return Ok(found);
    }
    let all = || NAMES.iter().chain(&OTHERS);
    let search = root.find_folders(3, &|folder| all().any(|n| folder.join(n).is_file()))?;
    for folder in &search.folders {
        let mut there = all().filter(|name| folder.join(name).is_file());
        let scene = match there.next() {
            Some(name) if NAMES.contains(name) => {
                let scene = read_scene(spec, &root, &folder.join(name), units);
                scene.map(|mut scene| {
                    scene.notes.extend(choice_note(folder, name, there));
                    scene
                })
            }
            _ => Err(DatasetError::malformed(
                folder,
                "neither transforms.json nor transforms_train.json; to read a file of another name, give its path",
            )),
        };
        found.add(root.id_of(folder), scene);
    }
    let expected = "transforms.json or transforms_train.json, up to three levels down; to read a file of another \
                    name, give its path";
    spec.conclude(found, expected, search.unsearched)
}

/// A note on which file was read, if the folder has several candidates or no transforms.json.
fn choice_note<'a>(
    folder: &Path,
    read: &str,
    others: impl Iterator<Item = &'a &'a str>,
) -> Option<String> {
    let others: Vec<&str> = others.copied().collect();
    let choice = match others.as_slice() {
        [] if read == NAMES[0] => return None,
        [] => format!("because there is no {}", NAMES[0]),
        others => format!(
            "not {} next to it; to read another file, give its path",
            others.join(", ")
        ),
    };
    Some(format!("{}: {read} was read, {choice}", folder.display()))
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    json: &Path,
    (scale, depth_unit): (f64, f64),
) -> Result<Scene, DatasetError> {
    root.check(json)?;
    let mut file = files::parse_text(json, transforms::parse)?;
    let by_file = spec.setting("intrinsics") == "file";
    if by_file {
        file.frames.iter_mut().for_each(JsonFrame::prefer_file);
    }
    let folder = json.parent().unwrap_or(Path::new("."));
    let reader = FrameReader {
        json,
        folder,
        metres: scale / file.applied_scale,
        depth_unit,
        depth_kind: DepthKind::of(spec),
        masks: match spec.setting("masks") {
            "ignore" => None,
            "keep-black" => Some(Keep::Black),
            _ => Some(Keep::White),
        },
    };
    let mut scene = SceneBuilder::new(spec, root, json);
    for frame in &file.frames {
        let name = &frame.file_path;
        // Names that point outside the folder are rejected before any other use.
        let image = scene.finder.picture(folder, name)?;
        let pose = frame.world_from_camera.as_ref().map_err(no_pose);
        let Some((image, world_from_camera)) = scene.usable(name, image, pose) else {
            if let Some(map) = &frame.depth_file_path {
                let map = scene.finder.map(folder, map)?;
                scene.belongs_to_left_out(map);
            }
            continue;
        };
        if let Some(posed) = reader.posed(frame, image, world_from_camera, &mut scene)? {
            scene.add(posed)?;
        }
    }
    let masks = file.frames.iter().filter(|f| f.mask_path.is_some()).count();
    if masks == 0 {
        let hint = "; a frame names its mask with mask_path";
        scene.notes.extend(scene_notes::unread_masks(folder, hint));
    } else if reader.masks.is_none() {
        scene.notes.push(format!(
            "{}: {masks} frame(s) have a mask, which is not used; masks=keep-white would exclude black pixels from \
             scores, masks=keep-black white pixels",
            json.display()
        ));
    }
    let contradicting = file.frames.iter().filter(|f| f.contradicts_file).count();
    if contradicting > 0 {
        scene.notes.push(format!(
            "{}: {contradicting} frame(s) have intrinsics that differ from the file's; those of the {}",
            json.display(),
            if by_file {
                "file are used"
            } else {
                "frames are used (intrinsics=file would use the file's, as nerfstudio does)"
            }
        ));
    }
    let mut folders = vec![(scene.folder_of_pictures(), "are not listed by any frame")];
    let depth = ["depth", "depths"].map(|name| {
        (
            folder.join(name),
            "are not the depth_file_path of any frame",
        )
    });
    folders.extend(depth);
    folders.retain(|(unused, _)| unused != folder);
    // A file for a single split does not list all pictures, so no note is made about pictures that
    // it does not use.
    if json.ends_with(NAMES[0]) {
        scene.note_unused(&folders);
    }
    let mut scene = scene.finish_with_views(root.id_of(folder), "")?;
    if let Some(level) = file.depth_level {
        let stated = level * scale / file.applied_scale;
        let maps = file
            .frames
            .iter()
            .filter_map(|f| f.depth_file_path.as_ref());
        let mut maps = maps.map(|map| map.to_ascii_lowercase());
        if maps.any(|map| map.ends_with(".png")) && (stated / depth_unit - 1.0).abs() > 1e-3 {
            scene.warnings.push(format!(
                "{}: integer_depth_scale states {stated} m per level of depth, but depth-unit is {depth_unit}; set \
                 depth-unit={stated}",
                json.display()
            ));
        }
    }
    Ok(scene)
}

struct FrameReader<'a> {
    json: &'a Path,
    folder: &'a Path,
    metres: f64,
    depth_unit: f64,
    depth_kind: DepthKind,
    /// Which side of masks is kept, black or white; `None` if masks are not read.
    masks: Option<Keep>,
}

impl FrameReader<'_> {
    /// Combines a frame's picture, pose, lens, depth and mask; `None` if the frame is excluded because its depth map or
    /// mask is missing.
    fn posed(
        &self,
        frame: &JsonFrame,
        image: PathBuf,
        world_from_camera: &RigidTransform,
        scene: &mut SceneBuilder<'_>,
    ) -> Result<Option<PosedFrame>, DatasetError> {
        let in_frame = |error: FormatError| {
            let name = &frame.file_path;
            DatasetError::malformed(self.json, format!("frame '{name}': {error}"))
        };
        let size = match frame.size().map_err(in_frame)? {
            Some(size) => size,
            None => picture::size_as_read(&image, &scene.rules)?,
        };
        let mask_name = frame.mask_path.as_ref().filter(|_| self.masks.is_some());
        let mut files = [
            (&frame.depth_file_path.as_ref(), "depth map"),
            (&mask_name, "mask"),
        ]
        .map(|(name, what)| (*name, what, None));
        for (name, what, file) in &mut files {
            let Some(name) = name else { continue };
            *file = scene.finder.map(self.folder, name)?;
            if file.is_none() {
                scene.leave_out_broken(&format!("the {what} does not exist"), &frame.file_path);
                return Ok(None);
            }
        }
        let [depth, mask] = files.map(|(.., file)| file);
        let encoding = DepthEncoding::Units(self.depth_unit, self.depth_kind);
        let depth = depth.map(|file| ViewDepth::Map(file, encoding));
        let mask = mask.zip(self.masks);
        let white = WHITE;
        let mask = mask.map(|(file, keep)| MaskFile { file, keep, white });
        let mut pose = *world_from_camera;
        pose.translation *= self.metres;
        Ok(Some(PosedFrame {
            id: frame_id(&frame.file_path),
            image,
            lens: frame.lens(size).map_err(in_frame)?,
            pinhole: Pinhole::WithoutBlankPixels,
            camera_from_world: pose.inverse(),
            mask,
            depth,
            cameras: vec![self.json.to_owned()],
        }))
    }
}
