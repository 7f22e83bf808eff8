//! The files that belong to a photograph: they must be downloaded before a list of pairs can be
//! evaluated.

use serde::Serialize;

/// Purpose of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FileRole {
    Picture,
    /// File with intrinsics, poses or a calibration.
    Camera,
    /// Names of the scenes or frames in a split.
    List,
    /// Mask of pixels to exclude; not every picture has a mask.
    Mask,
    /// Depth, used for overlap, for methods that require depth, and for results by distance.
    Depth,
}

/// A file that a pair needs.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct RequiredFile {
    pub role: FileRole,
    /// Path relative to the dataset's folder, with `/` as the separator.
    pub path: String,
    /// Other paths at which the file may be found instead of `path`.
    pub or: Vec<String>,
}

impl RequiredFile {
    pub(crate) fn new(role: FileRole, path: impl Into<String>) -> Self {
        Self {
            role,
            path: path.into(),
            or: Vec::new(),
        }
    }

    pub fn picture(path: &str) -> Self {
        Self::new(FileRole::Picture, path)
    }

    pub(crate) fn camera(path: impl Into<String>) -> Self {
        Self::new(FileRole::Camera, path)
    }

    pub(crate) fn list(path: impl Into<String>) -> Self {
        Self::new(FileRole::List, path)
    }

    pub(crate) fn mask(path: impl Into<String>) -> Self {
        Self::new(FileRole::Mask, path)
    }

    pub(crate) fn depth(path: impl Into<String>) -> Self {
        Self::new(FileRole::Depth, path)
    }

    pub(crate) fn or(mut self, other: impl Into<String>) -> Self {
        self.or.push(other.into());
        self
    }
}

/// Location of a photograph according to the layout, before any file exists.
pub(crate) struct PhotographPath<'a> {
    pub(crate) scene: &'a str,
    /// Path relative to the dataset's folder.
    pub(crate) picture: &'a str,
    pub(crate) folder: &'a str,
    /// File name with its extension.
    pub(crate) name: &'a str,
    pub(crate) stem: &'a str,
}

impl<'a> PhotographPath<'a> {
    pub(crate) fn new(scene: &'a str, picture: &'a str) -> Self {
        let (folder, name) = picture.rsplit_once('/').unwrap_or(("", picture));
        Self {
            scene,
            picture,
            folder,
            name,
            stem: name.rsplit_once('.').map_or(name, |(stem, _)| stem),
        }
    }

    /// Last component of the scene's id.
    pub(crate) fn scene_name(&self) -> &'a str {
        self.scene.rsplit('/').next().unwrap_or(self.scene)
    }

    /// First folder of the path.
    pub(crate) fn top(&self) -> &'a str {
        self.picture.split('/').next().unwrap_or("")
    }

    /// Folder that contains the photograph's folder.
    pub(crate) fn up(&self) -> &'a str {
        self.folder.rsplit_once('/').map_or("", |(up, _)| up)
    }

    pub(crate) fn beside(&self, name: &str) -> String {
        joined(self.folder, name)
    }

    pub(crate) fn above(&self, name: &str) -> String {
        joined(self.up(), name)
    }
}

fn joined(folder: &str, name: &str) -> String {
    match folder {
        "" => name.to_owned(),
        _ => format!("{folder}/{name}"),
    }
}

#[cfg(test)]
mod tests {
    use crate::registry::entry;

    fn paths(format: &str, scene: &str, picture: &str) -> Vec<String> {
        let files = entry(format).unwrap().required_files(scene, picture);
        assert!(files.is_sorted_by_key(|f| f.role), "{files:?}");
        files.into_iter().map(|f| f.path).collect()
    }

    #[test]
    fn every_layout_names_cameras_and_depth() {
        assert_eq!(
            paths("middlebury", "Pipes-perfect", "Pipes-perfect/im0.png"),
            [
                "Pipes-perfect/im0.png",
                "Pipes-perfect/calib.txt",
                "Pipes-perfect/disp0.pfm"
            ]
        );
        assert_eq!(
            paths("booster", "x", "train/balanced/Case/camera_00/im3.png")[1..],
            [
                "train/balanced/Case/calib_00-02.xml",
                "train/balanced/Case/disp_00.npy"
            ]
        );
        assert_eq!(
            paths("scannetpp", "s", "data/s/dslr/resized_images/D.JPG")[1..],
            [
                "data/s/dslr/nerfstudio/transforms.json",
                "splits/nvs_test.txt",
                "data/s/dslr/resized_anon_masks/D.png",
                "data/s/dslr/render_depth/D.png",
            ]
        );
        assert_eq!(
            paths(
                "wildrgbd",
                "cup/scenes/scene_1",
                "cup/scenes/scene_1/rgb/00003.png"
            )[1..],
            [
                "cup/scenes/scene_1/metadata",
                "cup/scenes/scene_1/cam_poses.txt",
                "cup/nvs_list.json",
                "cup/scenes/scene_1/depth/00003.png",
            ]
        );
        assert_eq!(
            paths("tanks-and-temples", "Barn", "image_sets/Barn/000001.jpg")[1..],
            [
                "Barn/Barn_COLMAP_SfM.log",
                "Barn/Barn_trans.txt",
                "Barn/Barn.ply"
            ]
        );
        let eth3d = paths("eth3d", "yard", "yard/images/dslr_images_undistorted/D.JPG");
        assert_eq!(eth3d.len(), 6, "{eth3d:?}");
        assert_eq!(eth3d[5], "yard/ground_truth_depth/dslr_images/D.JPG");
    }

    #[test]
    fn archives_are_those_of_the_scene() {
        let of = |format, scene| entry(format).unwrap().archives(scene, "cup/x");
        assert_eq!(
            of("middlebury", "Pipes-imperfect"),
            ["zip/Pipes-imperfect.zip"]
        );
        assert_eq!(
            of("middlebury", "trainingH/Pipes"),
            ["MiddEval3-data-H.zip", "MiddEval3-GT0-H.zip"]
        );
        assert_eq!(of("wildrgbd", "cup/scenes/scene_1"), ["category cup"]);
        assert_eq!(
            of("eth3d", "yard"),
            ["yard_dslr_jpg.7z", "yard_dslr_depth.7z"]
        );
        let undistorted = "yard/images/dslr_images_undistorted/D.JPG";
        assert_eq!(
            entry("eth3d").unwrap().archives("yard", undistorted).len(),
            3
        );
        assert!(of("nerfstudio", "x").is_empty());
    }
}
