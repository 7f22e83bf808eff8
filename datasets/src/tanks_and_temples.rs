//! Tanks and Temples' training set.
//!
//! A scene is a folder with `<S>_COLMAP_SfM.log` (camera-to-world, structure-from-motion units),
//! `<S>_trans.txt` (the similarity to the laser scan's metric world) and `<S>.ply` (the scan). The
//! i-th block of the log belongs to the i-th picture in natural order. Intrinsics were never
//! published: give a COLMAP camera (`cameras.txt` or `.bin` beside the log or in `sparse/0`), else
//! the focal length the download page recommends, 0.7 of the width, is used and said so.

use std::path::{Path, PathBuf};

use crate::files::{self, Root};
use crate::format::{colmap, picture, trajectory};
use crate::lens::{Distortion, Lens};
use crate::posed::{self, Depth, Pinhole, Posed, Skipped, frame_id};
use crate::scan::{Scan, ScanCache};
use crate::spec::{Attempts, Choice, DatasetSpec, Format, Setting};
use crate::{DatasetError, Pairing, Scene};

/// The catalogue's entry.
pub(crate) const FORMAT: Format = Format {
    name: "tanks-and-temples",
    summary: "Tanks and Temples training set: <S>_COLMAP_SfM.log, <S>_trans.txt, <S>.ply, pictures",
    settings: &[
        Setting::choice(
            "intrinsics",
            "where focal length and principal point come from",
            &[
                Choice::new("auto", "a COLMAP camera if there is one, else 0.7w"),
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
    let folders = root.find_folders(3, &|folder| !logs_in(folder).is_empty())?;
    let mut scenes = Vec::new();
    for folder in &folders {
        for log in logs_in(folder) {
            let place = Place {
                root: &root,
                folder,
                log: &log,
            };
            scenes.push(place.read_scene(spec, splat_radius, &cache));
        }
    }
    if scenes.is_empty() {
        return Err(DatasetError::NoScene {
            path: spec.path.clone(),
            format: FORMAT.name,
            expected: "folders with <Scene>_COLMAP_SfM.log and <Scene>_trans.txt",
        });
    }
    Ok(scenes)
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
        let pictures = self.pictures(name)?;
        let mut notes = Vec::new();
        let (lens, camera_file) = self.lens(name, spec, &pictures[0], &mut notes)?;
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
        let mut views = Vec::new();
        for pose in &poses {
            let label = format!("block {}", pose.frame);
            let picture = usize::try_from(pose.frame)
                .ok()
                .and_then(|i| pictures.get(i));
            let Some(image) = picture else {
                skipped.add("there are fewer pictures than blocks", &label);
                continue;
            };
            let moved = pose
                .world_from_camera
                .as_ref()
                .map_err(Clone::clone)
                .and_then(|p| metric.apply_to_pose(p));
            let Ok(world_from_camera) = moved else {
                skipped.add("the pose is not finite or not rigid", &label);
                continue;
            };
            let file_name = image.file_name().unwrap_or_default().to_string_lossy();
            views.push(
                Posed {
                    id: frame_id(&file_name),
                    image: image.clone(),
                    lens,
                    pinhole: Pinhole::WithoutBlankPixels,
                    camera_from_world: world_from_camera.inverse(),
                    mask: None,
                    depth: scan.clone().map_or(Depth::None, Depth::Scan),
                    cameras: [Some(log.clone()), Some(trans.clone()), camera_file.clone()]
                        .into_iter()
                        .flatten()
                        .collect(),
                }
                .into_view()?,
            );
        }
        posed::finish(&mut views);
        notes.extend(skipped.notes(&log));
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

    /// The scene's pictures in natural order; there is at least one.
    fn pictures(&self, name: &str) -> Result<Vec<PathBuf>, DatasetError> {
        let top = self.root.path();
        let candidates = [
            self.folder.join("images"),
            self.folder.join(name),
            self.folder.to_owned(),
            top.join("image_sets").join(name),
            top.join("images").join(name),
            top.join(name),
        ];
        for folder in candidates.iter().filter(|f| f.is_dir()) {
            self.root.check(folder)?;
            let mut pictures = Vec::new();
            for (file_name, path) in files::list(folder)? {
                let extension = file_name.rsplit('.').next().unwrap_or("");
                if ["jpg", "jpeg", "png"].contains(&extension.to_ascii_lowercase().as_str()) {
                    self.root.check(&path)?;
                    pictures.push(path);
                }
            }
            if !pictures.is_empty() {
                return Ok(pictures);
            }
        }
        Err(DatasetError::malformed(
            self.folder,
            format!(
                "no pictures of {name}: neither images/ nor {name}/ here, nor image_sets/{name}/"
            ),
        ))
    }

    /// The one camera of the scene, and the file it is from.
    fn lens(
        &self,
        name: &str,
        spec: &DatasetSpec,
        picture: &Path,
        notes: &mut Vec<String>,
    ) -> Result<(Lens, Option<PathBuf>), DatasetError> {
        let size = picture::dimensions(picture)?;
        let choice = spec.setting("intrinsics");
        if choice == "auto" {
            for place in [".", "sparse/0", "sparse"] {
                let model = self.root.resolve(self.folder, place)?;
                colmap::check_inside(self.root, &model)?;
                let Some((file, cameras)) = colmap::read_cameras(&model)? else {
                    continue;
                };
                let mut lenses = cameras.values();
                let (Some(camera), None) = (lenses.next(), lenses.next()) else {
                    let reason = format!("{} cameras; expected the scene's one", cameras.len());
                    return Err(DatasetError::malformed(file, reason));
                };
                crate::mask::check_size(picture, size, camera.size)?;
                let lens = camera
                    .lens()
                    .map_err(|reason| DatasetError::malformed(&file, reason))?;
                return Ok((lens, Some(file)));
            }
        }
        let share = if choice == "0.6w" { 0.6 } else { 0.7 };
        notes.push(format!(
            "{name}: intrinsics were never published; the focal length is taken as {share} of the \
             width and the principal point as the middle"
        ));
        let (w, h) = (f64::from(size.0), f64::from(size.1));
        let lens = Lens::new(
            (share * w, share * w),
            (w / 2.0, h / 2.0),
            size,
            Distortion::None,
        )
        .map_err(|source| DatasetError::Camera {
            path: picture.to_owned(),
            source,
        })?;
        Ok((lens, None))
    }
}
