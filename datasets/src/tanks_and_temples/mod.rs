//! Tanks and Temples' training set.
//!
//! A scene is a folder with `<S>_COLMAP_SfM.log` (camera-to-world, structure-from-motion units),
//! `<S>_trans.txt` (the similarity to the laser scan's metric coordinates) and `<S>.ply` (the
//! scan).
//!
//! * `photographs`: block i of the log, counted from 0, belongs to the picture numbered i + 1.
//! * `cameras`: intrinsics were never published. Provide a COLMAP model (`cameras.txt` or `.bin` next to the log or in
//!   `sparse/0`, with `images` if it has several cameras). A focal length given as a share of the width is a guess, and
//!   depth rendered by the same camera cannot reveal its error. It is used only if a setting requests it.

mod cameras;
mod photographs;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::camera_size::CAMERA_SIZE;
use crate::depth::ViewDepth;
use crate::files::{self, Root};
use crate::format::trajectory;
use crate::found_scenes::FoundScenes;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::scan_depth::{ScanCache, ScanFile};
use crate::scene_builder::{Pinhole, PosedFrame, SceneBuilder, frame_id};
use crate::setting::{Setting, choice};
use crate::spec::PaperOverlap;
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene};
use cameras::SceneCameras;
use photographs::ScenePhotographs;

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "tanks-and-temples",
    display_name: "Tanks and Temples",
    title: "Tanks and Temples, training set",
    page: "https://www.tanksandtemples.org/",
    terms: "non-commercial research without redistribution, although a CC BY 4.0 notice also exists",
    may_publish: false,
    download: "image sets of the seven training scenes, their SfM logs, alignments and laser scans",
    size: "1920x1080 pictures, several hundred per scene (Barn: 410), and the scans",
    layout: "<Scene>/{<Scene>_COLMAP_SfM.log, <Scene>_trans.txt, <Scene>.ply, images/000001.jpg ...}; \
             cameras.txt or .bin next to the log or in sparse/0, with images.* next to it if it has several cameras",
    paper_column: "Tanks and Temples",
    paper_overlap: PaperOverlap::Sparse,
    caveat: "intrinsics were never published: add a COLMAP model, or accept a guessed focal length of 0.7 or \
             0.6 picture widths with intrinsics=0.7w or 0.6w",
    poses_are_matrices: true,
    settings: &[
        Setting::choice(
            "intrinsics",
            "source of focal length and principal point",
            &[
                choice("auto", "a COLMAP model; a scene without one is an error"),
                choice(
                    "0.7w",
                    "a guess, 0.7 of the width: the download page's recommendation",
                ),
                choice(
                    "0.6w",
                    "a guess, 0.6 of the width: close to COLMAP's own result",
                ),
            ],
        ),
        Setting::free(
            "splat-radius",
            "radius in pixels within which a scan's point sets the depth; at 0, hidden surfaces \
             show through",
            "1",
        ),
        CAMERA_SIZE,
    ],
    open,
    required_files,
    archives: |photo| {
        vec![format!(
            "{}.zip and its evaluation data",
            photo.scene_name()
        )]
    },
};

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    let file = |end: &str| format!("{0}/{0}{end}", photo.scene);
    vec![
        RequiredFile::camera(file(LOG)),
        RequiredFile::camera(file(TRANS)),
        RequiredFile::depth(file(".ply")),
    ]
}

const LOG: &str = "_COLMAP_SfM.log";
const TRANS: &str = "_trans.txt";

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let root = Root::open(&spec.path)?;
    let radius = spec.setting("splat-radius");
    let splat_radius = radius.parse().ok().filter(|r: &u32| *r <= 16);
    let splat_radius = splat_radius.ok_or_else(|| {
        spec.refused(format!(
            "'splat-radius' cannot be '{radius}'; it must be a whole number from 0 to 16"
        ))
    })?;
    let cache = ScanCache::default();
    let search = root.find_folders(3, &|folder| {
        !scenes_in(folder).is_empty() || photographs::has_pictures(folder)
    })?;
    let mut found = FoundScenes::default();
    let (only_pictures, scenes): (Vec<&PathBuf>, Vec<&PathBuf>) =
        search.folders.iter().partition(|f| scenes_in(f).is_empty());
    for folder in &scenes {
        for name in &scenes_in(folder) {
            let reader = TanksReader {
                spec,
                root: &root,
                folder,
                name,
            };
            found.add(name, reader.read(splat_radius, &cache));
        }
    }
    // A dataset without any log is not of this format, so folders that only contain pictures are
    // not its scenes.
    for folder in only_pictures.into_iter().filter(|_| !scenes.is_empty()) {
        // `images/` belongs to its parent folder; `image_sets/Barn/` belongs to the scene Barn that has a log.
        let folder = match folder.parent() {
            Some(above) if folder.ends_with("images") => above,
            _ => folder.as_path(),
        };
        let name = root.id_of(folder);
        let name = name.rsplit('/').next().unwrap_or(&name);
        let broken = found.left_out.iter().map(|scene| &scene.id);
        let mut ids = found.scenes.iter().map(|scene| &scene.id).chain(broken);
        if !ids.any(|id| id == name) {
            let reason = format!("there are pictures, but no {name}{LOG}");
            found.add(name, Err(DatasetError::malformed(folder, reason)));
        }
    }
    let expected = "folders with <Scene>_COLMAP_SfM.log and <Scene>_trans.txt";
    spec.conclude(found, expected, search.unsearched)
}

/// Names of the scenes for which a folder contains a log or an alignment.
fn scenes_in(folder: &Path) -> BTreeSet<String> {
    let entries = files::list(folder).unwrap_or_default().into_iter();
    entries
        .filter_map(|(name, _)| {
            let mut ends = [LOG, TRANS].into_iter();
            ends.find_map(|end| name.strip_suffix(end).map(str::to_owned))
        })
        .collect()
}

struct TanksReader<'a> {
    spec: &'a DatasetSpec,
    root: &'a Root,
    folder: &'a Path,
    name: &'a str,
}

impl TanksReader<'_> {
    fn read(&self, splat_radius: u32, cache: &ScanCache) -> Result<Scene, DatasetError> {
        let name = self.name;
        let file = |end: &str| self.root.resolve(self.folder, &format!("{name}{end}"));
        let (log, trans, scan) = (file(LOG)?, file(TRANS)?, file(".ply")?);
        let poses = files::parse_text(&log, trajectory::parse_log)?;
        let metric = files::parse_text(&trans, trajectory::parse_similarity)?;
        let photos = ScenePhotographs::find(self.root, self.folder, name, poses.blocks.len())?;
        let by_block = photos
            .by_block(&poses)
            .map_err(|reason| DatasetError::malformed(&log, reason))?;
        let mut scene = SceneBuilder::new(self.spec, self.root, &log);
        scene.notes.extend(photos.notes.iter().cloned());
        if by_block.first_number == Some(0) {
            scene.notes.push(format!(
                "{name}: the pictures are numbered from 0, so block i is assigned to picture i"
            ));
        }
        // Uses the size of a matched picture, if there is one.
        let first = by_block.files.values().next().copied();
        let cameras = self.cameras(first.unwrap_or(&photos.files[0]), &mut scene.notes)?;
        let camera_files = [&[log.clone(), trans], cameras.files.as_slice()].concat();
        scene.sizes.cameras_from(cameras.files.first());
        let scan = scan.is_file().then(|| ScanFile {
            file: scan.clone(),
            cache: cache.clone(),
            splat_radius,
        });
        if scan.is_none() {
            let note = format!("{name}: no {name}.ply, so the views have no depth");
            scene.notes.push(note);
        }
        for file in &by_block.left_over {
            scene.leave_out("no block of the log belongs to the picture", &name_of(file));
        }
        for block in &poses.blocks {
            let posed = poses.poses.binary_search_by_key(block, |pose| pose.frame);
            let Some(image) = by_block.files.get(block) else {
                let label = by_block.label(*block);
                scene.leave_out_broken("the block's picture does not exist", &label);
                continue;
            };
            let Ok(pose) = posed.map(|i| &poses.poses[i].world_from_camera) else {
                let reason = "the log says that the picture has no pose";
                scene.leave_out(reason, &name_of(image));
                continue;
            };
            let moved = pose.as_ref().map_err(Clone::clone);
            let Ok(world_from_camera) = moved.and_then(|p| metric.apply_to_pose(p)) else {
                let label = by_block.label(*block);
                scene.leave_out("the pose is not finite or not rigid", &label);
                continue;
            };
            let Some(lens) = cameras.of(image) else {
                let reason = "the COLMAP model has several cameras and does not list the picture";
                scene.leave_out(reason, &name_of(image));
                continue;
            };
            scene.add(PosedFrame {
                id: frame_id(&name_of(image)),
                image: image.to_path_buf(),
                lens,
                pinhole: Pinhole::WithoutBlankPixels,
                camera_from_world: world_from_camera.inverse(),
                mask: None,
                depth: scan.clone().map(ViewDepth::Scan),
                cameras: camera_files.clone(),
            })?;
        }
        scene.finish_with_views(name.to_owned(), "")
    }

    fn cameras(
        &self,
        picture: &Path,
        notes: &mut Vec<String>,
    ) -> Result<SceneCameras, DatasetError> {
        let share = match self.spec.setting("intrinsics") {
            "0.7w" => 0.7,
            "0.6w" => 0.6,
            _ => {
                let model = SceneCameras::of_model(self.root, self.folder)?;
                return model.ok_or_else(|| {
                    let reason = format!(
                        "no COLMAP model, and the intrinsics of {} were never published; add cameras.txt or .bin \
                         next to the log, or set intrinsics=0.7w (the download page's guess) or intrinsics=0.6w \
                         (closer to COLMAP's result) to accept a focal length that is a fraction of the width",
                        self.name
                    );
                    DatasetError::malformed(self.folder, reason)
                });
            }
        };
        notes.push(format!(
            "{}: intrinsics were never published; the focal length is taken as {share} of the \
             width and the principal point as the middle",
            self.name
        ));
        SceneCameras::recommended(share, picture)
    }
}

fn name_of(file: &Path) -> String {
    let name = file.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}
