//! Tanks and Temples' training set.
//!
//! A scene is a folder with `<S>_COLMAP_SfM.log` (camera-to-world, structure-from-motion units),
//! `<S>_trans.txt` (the similarity to the laser scan's metric world) and `<S>.ply` (the scan).
//!
//! * `pictures`: block i of the log, from 0, belongs to the picture numbered i + 1.
//! * `cameras`: intrinsics were never published. Give a COLMAP model (`cameras.txt` or `.bin` beside
//!   the log or in `sparse/0`, with `images` if it has several cameras), else the focal length the
//!   download page recommends, 0.7 of the width, is used and said so.

mod cameras;
mod pictures;

use std::path::Path;

use crate::camera_size::{CAMERA_SIZE, CameraSizes};
use crate::files::{self, Root};
use crate::format::trajectory;
use crate::posed::{self, Depth, Pinhole, Posed, frame_id};
use crate::scan::{Scan, ScanCache};
use crate::skipped::Skipped;
use crate::spec::{Attempts, Choice, DatasetSpec, Format, Setting, conclude};
use crate::{DatasetError, Pairing, Scene};
use cameras::Cameras;
use pictures::Pictures;

/// The catalogue's entry.
pub(crate) const FORMAT: Format = Format {
    name: "tanks-and-temples",
    summary: "Tanks and Temples training set: <S>_COLMAP_SfM.log, <S>_trans.txt, <S>.ply, pictures",
    settings: &[
        Setting::choice(
            "intrinsics",
            "where focal length and principal point come from",
            &[
                Choice::new("auto", "a COLMAP model if there is one, else 0.7w"),
                Choice::new(
                    "0.7w",
                    "0.7 of the width: the download page's recommendation",
                ),
                Choice::new("0.6w", "0.6 of the width: what COLMAP itself arrives at"),
            ],
        ),
        Setting::free(
            "splat-radius",
            "pixels around a scan's point that take its depth; 0 lets hidden surfaces shine through",
            "1",
        ),
        CAMERA_SIZE,
    ],
    open,
};

const LOG: &str = "_COLMAP_SfM.log";

fn open(spec: &DatasetSpec) -> Result<Attempts, DatasetError> {
    let root = Root::open(&spec.path)?;
    let radius = spec.setting("splat-radius");
    let splat_radius = radius
        .parse::<u32>()
        .ok()
        .filter(|r| *r <= 16)
        .ok_or_else(|| DatasetError::Spec {
            text: spec.to_string(),
            reason: format!("'splat-radius' cannot be '{radius}'; it is a number from 0 to 16"),
        })?;
    let cache = ScanCache::default();
    let found = root.find_folders(3, &|folder| !logs_in(folder).is_empty())?;
    let mut scenes = Vec::new();
    for folder in &found.folders {
        for log in logs_in(folder) {
            let place = Place {
                root: &root,
                folder,
                log: &log,
            };
            scenes.push(place.read_scene(spec, splat_radius, &cache));
        }
    }
    let expected = "folders with <Scene>_COLMAP_SfM.log and <Scene>_trans.txt";
    conclude(spec, scenes, expected, &[&found.passed_over])
}

fn logs_in(folder: &Path) -> Vec<String> {
    let entries = files::list(folder).unwrap_or_default();
    entries
        .into_iter()
        .map(|e| e.0)
        .filter(|name| name.ends_with(LOG))
        .collect()
}

struct Place<'a> {
    root: &'a Root,
    folder: &'a Path,
    log: &'a str,
}

impl Place<'_> {
    fn read_scene(
        &self,
        spec: &DatasetSpec,
        splat_radius: u32,
        cache: &ScanCache,
    ) -> Result<Scene, DatasetError> {
        let name = self.log.trim_end_matches(LOG);
        let log = self.root.resolve(self.folder, self.log)?;
        let trans = self
            .root
            .resolve(self.folder, &format!("{name}_trans.txt"))?;
        let poses = trajectory::read_log(&log)?;
        let metric = trajectory::read_similarity(&trans)?;
        let pictures = Pictures::find(self.root, self.folder, name, poses.blocks.len())?;
        let by_block = pictures
            .by_block(&poses)
            .map_err(|reason| DatasetError::malformed(&log, reason))?;
        let mut notes = pictures.notes.clone();
        if by_block.first_number == Some(0) {
            notes.push(format!(
                "{name}: the pictures are numbered from 0, so block i is taken to be that of picture i"
            ));
        }
        // The size of a picture that is used, where any is.
        let first = by_block.files.values().next().copied();
        let first = first.unwrap_or(&pictures.files[0]);
        let cameras = self.cameras(name, spec, first, &mut notes)?;
        let mut camera_files = vec![log.clone(), trans];
        camera_files.extend(cameras.files.iter().cloned());
        let mut sizes = CameraSizes::new(spec);
        let scan = self.root.resolve(self.folder, &format!("{name}.ply"))?;
        let scan = scan.is_file().then(|| Scan {
            file: scan.clone(),
            cache: cache.clone(),
            splat_radius,
        });
        if scan.is_none() {
            notes.push(format!("{name}: no {name}.ply, so the views have no depth"));
        }
        let mut skipped = Skipped::default();
        for file in &by_block.left_over {
            skipped.add("no block of the log belongs to the picture", &name_of(file));
        }
        for block in &poses.blocks {
            let posed = poses.poses.binary_search_by_key(block, |pose| pose.frame);
            match by_block.files.get(block) {
                None => skipped.add(
                    "the block's picture does not exist",
                    &by_block.label(*block),
                ),
                Some(file) if posed.is_err() => {
                    skipped.add("the log says that the picture has no pose", &name_of(file));
                }
                Some(_) => {}
            }
        }
        let mut views = Vec::new();
        for pose in &poses.poses {
            let Some(image) = by_block.files.get(&pose.frame) else {
                continue;
            };
            let moved = pose
                .world_from_camera
                .as_ref()
                .map_err(Clone::clone)
                .and_then(|p| metric.apply_to_pose(p));
            let Ok(world_from_camera) = moved else {
                let label = by_block.label(pose.frame);
                skipped.add("the pose is not finite or not rigid", &label);
                continue;
            };
            let Some(lens) = cameras.of(image) else {
                let reason = "the COLMAP model has several cameras and does not list the picture";
                skipped.add(reason, &name_of(image));
                continue;
            };
            views.push(
                Posed {
                    id: frame_id(&name_of(image)),
                    image: image.to_path_buf(),
                    lens: sizes.fit(lens, image)?,
                    pinhole: Pinhole::WithoutBlankPixels,
                    camera_from_world: world_from_camera.inverse(),
                    mask: None,
                    depth: scan.clone().map_or(Depth::None, Depth::Scan),
                    cameras: camera_files.clone(),
                }
                .into_view()?,
            );
        }
        posed::finish(&mut views);
        notes.extend(skipped.notes(&log));
        notes.extend(sizes.notes(cameras.files.first().unwrap_or(&log)));
        if views.is_empty() {
            return Err(DatasetError::malformed(
                log,
                format!("no usable pose; {}", notes.join("; ")),
            ));
        }
        Ok(Scene {
            dataset: spec.name.clone(),
            id: name.to_owned(),
            cluster: name.to_owned(),
            views,
            pairing: Pairing::MultiView,
            notes,
        })
    }

    fn cameras(
        &self,
        name: &str,
        spec: &DatasetSpec,
        picture: &Path,
        notes: &mut Vec<String>,
    ) -> Result<Cameras, DatasetError> {
        let choice = spec.setting("intrinsics");
        if choice == "auto"
            && let Some(cameras) = Cameras::of_model(self.root, self.folder)?
        {
            return Ok(cameras);
        }
        let share = if choice == "0.6w" { 0.6 } else { 0.7 };
        notes.push(format!(
            "{name}: intrinsics were never published; the focal length is taken as {share} of the \
             width and the principal point as the middle"
        ));
        Cameras::recommended(share, picture)
    }
}

fn name_of(file: &Path) -> String {
    file.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}
