//! Builds multi-view scenes, photograph by photograph, and records what is excluded.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sharp::camera::{CameraError, RigidTransform};
use sharp::image_file::PictureRules;

use crate::camera_size::CameraSizes;
use crate::depth::ViewDepth;
use crate::file_content::FileContent;
use crate::file_finder::FileFinder;
use crate::files::{self, Root, is_picture_extension};
use crate::left_out::{LeftOut, LeftOutViews, first_few};
use crate::lens::Lens;
use crate::mask::MaskFile;
use crate::undistort::{Undistortion, ViewGeometry};
use crate::view::without_depth;
use crate::{DatasetError, DatasetSpec, Pairing, Scene, View, natural_order};

/// A scene under construction.
pub(crate) struct SceneBuilder<'a> {
    dataset: &'a str,
    /// The file that lists the frames, which notes and errors mention.
    list: PathBuf,
    pub(crate) finder: FileFinder<'a>,
    pub(crate) sizes: CameraSizes,
    pub(crate) rules: PictureRules,
    left_out: LeftOut,
    broken: Vec<LeftOutViews>,
    views: Vec<View>,
    /// Pictures that a frame already uses.
    seen: BTreeSet<PathBuf>,
    /// Depth maps that belong to excluded frames.
    of_left_out: BTreeSet<PathBuf>,
    pub(crate) notes: Vec<String>,
}

impl<'a> SceneBuilder<'a> {
    pub(crate) fn new(spec: &'a DatasetSpec, root: &'a Root, list: &Path) -> Self {
        Self {
            dataset: &spec.name,
            list: list.to_owned(),
            finder: FileFinder::new(root, list),
            sizes: CameraSizes::new(spec, list),
            rules: spec.picture_rules(),
            left_out: LeftOut::of("frame"),
            broken: Vec::new(),
            views: Vec::new(),
            seen: BTreeSet::new(),
            of_left_out: BTreeSet::new(),
            notes: Vec::new(),
        }
    }

    pub(crate) fn leave_out(&mut self, reason: impl Into<String>, name: &str) {
        self.left_out.add(reason, name);
    }

    /// Excludes a frame because one of its files is missing or cannot be read.
    pub(crate) fn leave_out_broken(&mut self, reason: &str, name: &str) {
        let reason = format!("{}: {reason}", self.list.display());
        LeftOutViews::add(&mut self.broken, reason, frame_id(name));
    }

    /// Marks a depth map as belonging to an excluded frame, so that it is not reported as unused.
    pub(crate) fn belongs_to_left_out(&mut self, map: Option<PathBuf>) {
        self.of_left_out.extend(map);
    }

    /// Picture and pose of a frame. If one of them is missing, or the picture was used before, the frame is excluded.
    pub(crate) fn usable<P>(
        &mut self,
        name: &str,
        picture: Option<PathBuf>,
        pose: Result<P, &'static str>,
    ) -> Option<(PathBuf, P)> {
        let is_new = picture
            .as_ref()
            .is_none_or(|picture| self.seen.insert(picture.clone()));
        match (picture, pose) {
            (Some(picture), Ok(pose)) if is_new => return Some((picture, pose)),
            (Some(_), Ok(_)) => self.leave_out("the picture is listed twice", name),
            (_, Err(reason)) => self.leave_out(reason, name),
            (None, _) => self.leave_out_broken("the picture does not exist", name),
        }
        None
    }

    /// Adds a view. Its camera is scaled if the settings request this, and the view is resampled to
    /// a pinhole camera if its lens requires it.
    ///
    /// # Errors
    /// If the scaled camera is invalid, or the view's lens cannot be resampled to a pinhole; names the picture.
    pub(crate) fn add(&mut self, mut frame: PosedFrame) -> Result<(), DatasetError> {
        frame.lens = self.sizes.fit(frame.lens, &frame.image)?;
        self.views
            .push(frame.into_view(self.rules, self.sizes.is_offered)?);
        Ok(())
    }

    pub(crate) fn has_depth(&self) -> bool {
        without_depth(&self.views) < self.views.len()
    }

    pub(crate) fn has_masks(&self) -> bool {
        let mut views = self.views.iter();
        views.any(|view| view.content.processing().masked)
    }

    /// Folder of the first picture; an empty path if there is none.
    pub(crate) fn folder_of_pictures(&self) -> PathBuf {
        let first = self.seen.first().and_then(|picture| picture.parent());
        first.map_or_else(PathBuf::new, Path::to_owned)
    }

    /// Adds a note on the files in `folders` that no view uses, with the reason given for each folder. Pictures of
    /// excluded frames are not listed, because they have notes of their own.
    pub(crate) fn note_unused(&mut self, folders: &[(PathBuf, &'static str)]) {
        let used = self.views.iter().flat_map(|view| view.content.files());
        let known = self.seen.iter().chain(&self.of_left_out).cloned();
        let used: BTreeSet<PathBuf> = used.chain(known).collect();
        for (folder, why) in folders {
            let mut names = Vec::new();
            if folder.as_os_str().is_empty() {
                continue;
            }
            unused(folder, &used, 2, &mut names);
            let name = |path: &PathBuf| {
                let below = path.strip_prefix(folder).unwrap_or(path);
                below.to_string_lossy().into_owned()
            };
            let names: Vec<String> = names.iter().map(name).collect();
            self.notes.extend((!names.is_empty()).then(|| {
                let (count, first) = (names.len(), first_few(&names));
                format!("{}: {count} file(s) {why} ({first})", folder.display())
            }));
        }
    }

    /// Finishes the scene. Views are in natural order. The folders that all views share are removed
    /// from their ids; extensions are included only if they distinguish pictures. The scene's id is
    /// also its cluster.
    pub(crate) fn finish(mut self, id: String) -> Scene {
        let shared = shorten_ids(&mut self.views);
        let broken = self.broken.iter_mut().flat_map(|group| &mut group.views);
        for id in broken {
            if let Some(rest) = id.strip_prefix(&shared) {
                *id = rest.trim_start_matches('/').to_owned();
            }
        }
        tell_apart(&mut self.views);
        self.views
            .sort_by(|a, b| natural_order::compare(&a.id, &b.id));
        self.notes.extend(self.left_out.notes(&self.list));
        self.notes.extend(self.finder.notes());
        self.notes.extend(self.sizes.notes());
        Scene {
            notes: self.notes,
            left_out: self.broken,
            ..Scene::new(self.dataset, id, self.views, Pairing::MultiView)
        }
    }

    /// Like [`SceneBuilder::finish`], but rejects a scene without views.
    ///
    /// # Errors
    /// [`DatasetError::Malformed`] that names the list of frames, and ends with the notes and `hint`.
    pub(crate) fn finish_with_views(self, id: String, hint: &str) -> Result<Scene, DatasetError> {
        let list = self.list.clone();
        let scene = self.finish(id);
        if scene.views.is_empty() {
            let causes = scene.left_out.iter().map(ToString::to_string);
            let causes: Vec<String> = causes.chain(scene.notes).collect();
            let reason = format!("no usable picture; {}{hint}", causes.join("; "));
            return Err(DatasetError::malformed(list, reason));
        }
        Ok(scene)
    }
}

/// Reason for excluding a frame with an invalid pose.
pub(crate) const NO_POSE: &str = "the pose is not finite or not rigid (if its rotation is scaled, divide the columns by their length)";

/// Reason for excluding a frame with an invalid matrix.
pub(crate) fn no_pose(error: &CameraError) -> &'static str {
    match error {
        CameraError::NotRigid { determinant, .. } if *determinant < 0.0 => {
            "the pose mirrors space (its determinant is below zero, so an axis is negated or two are swapped)"
        }
        CameraError::Transposed => {
            "the matrix of the pose is transposed (its last row holds the translation); transpose it"
        }
        _ => NO_POSE,
    }
}

/// Choice of the pinhole camera to which a picture with lens distortion is resampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pinhole {
    /// The widest camera that shows nothing beyond the stored picture.
    WithoutBlankPixels,
    /// The camera that ScanNet++'s toolbox uses.
    LikeScanNetPp,
}

/// A photograph with its pose, lens and depth.
#[derive(Debug)]
pub(crate) struct PosedFrame {
    pub(crate) id: String,
    pub(crate) image: PathBuf,
    pub(crate) lens: Lens,
    pub(crate) pinhole: Pinhole,
    pub(crate) camera_from_world: RigidTransform,
    pub(crate) mask: Option<MaskFile>,
    pub(crate) depth: Option<ViewDepth>,
    /// Files from which lens and pose were read.
    pub(crate) cameras: Vec<PathBuf>,
}

impl PosedFrame {
    fn into_view(self, rules: PictureRules, has_camera_size: bool) -> Result<View, DatasetError> {
        let undistortion = if self.lens.is_pinhole() {
            None
        } else {
            let made = match self.pinhole {
                Pinhole::WithoutBlankPixels => Undistortion::without_blank_pixels(self.lens),
                Pinhole::LikeScanNetPp => Undistortion::like_scannetpp(self.lens),
            };
            Some(made.map_err(|error| DatasetError::malformed(&self.image, error.to_string()))?)
        };
        let stored = self.lens.intrinsics();
        let pinhole = undistortion.map_or(stored, |u| *u.pinhole());
        let camera_from_world = self.camera_from_world;
        Ok(View {
            id: self.id,
            intrinsics: pinhole,
            camera_from_world,
            content: Arc::new(FileContent {
                image: self.image,
                rules,
                geometry: ViewGeometry {
                    size: (stored.width, stored.height),
                    undistortion,
                    pinhole,
                    camera_from_world,
                },
                mask: self.mask,
                depth: self.depth,
                cameras: self.cameras,
                has_camera_size,
            }),
        })
    }
}

/// Removes the folders that all views share from their ids, and returns these folders.
fn shorten_ids(views: &mut [View]) -> String {
    let folders = views
        .iter()
        .map(|v| v.id.rsplit_once('/').map_or("", |(folder, _)| folder));
    let shared = folders.reduce(common_folders).unwrap_or("").to_owned();
    for view in views.iter_mut() {
        view.id = view.id[shared.len()..].trim_start_matches('/').to_owned();
    }
    shared
}

/// Adds extensions to the ids of pictures whose ids would be equal.
fn tell_apart(views: &mut [View]) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for view in views.iter() {
        *counts.entry(view.id.clone()).or_default() += 1;
    }
    for view in views.iter_mut().filter(|view| counts[&view.id] > 1) {
        let file = view.content.image_file();
        if let Some(extension) = file.and_then(Path::extension) {
            view.id = format!("{}.{}", view.id, extension.to_string_lossy());
        }
    }
}

/// Collects pictures and maps at most `depth` levels below a folder that are not in `used`, in natural order.
fn unused(folder: &Path, used: &BTreeSet<PathBuf>, depth: usize, into: &mut Vec<PathBuf>) {
    for (name, path) in files::list(folder).unwrap_or_default() {
        let extension = name.rsplit_once('.').map_or("", |(_, extension)| extension);
        if is_picture_extension(extension)
            || MAPS.contains(&extension.to_ascii_lowercase().as_str())
        {
            if !used.contains(&path) {
                into.push(path);
            }
        } else if depth > 0 && path.is_dir() {
            unused(&path, used, depth - 1, into);
        }
    }
}

const MAPS: [&str; 4] = ["npy", "npz", "exr", "pfm"];

/// The leading path components that two folders share.
fn common_folders<'a>(a: &'a str, b: &str) -> &'a str {
    let mut length = 0;
    for (i, (x, y)) in a.split('/').zip(b.split('/')).enumerate() {
        if x != y {
            break;
        }
        length += x.len() + usize::from(i > 0);
    }
    &a[..length]
}

/// Id of a picture: its name without `./` and extension, with `/` between folders.
pub(crate) fn frame_id(name: &str) -> String {
    let name = name.replace('\\', "/");
    let name = name.trim_start_matches("./");
    match name.rsplit_once('.') {
        Some((stem, extension)) if is_picture_extension(extension) => stem.to_owned(),
        _ => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_folders_are_counted_by_component() {
        assert_eq!(common_folders("images/left", "images/left_2"), "images");
        assert_eq!(common_folders("images", "images"), "images");
        assert_eq!(common_folders("", "images"), "");
        assert_eq!(common_folders("a/b/c", "a/b"), "a/b");
    }
}
