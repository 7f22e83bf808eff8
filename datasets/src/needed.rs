//! The files that belong to a photograph, by a dataset's layout alone: what has to be downloaded
//! before a list of pairs can be evaluated.

use std::path::Path;

use serde::Serialize;

use crate::View;

/// What a file is needed for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// The photograph itself.
    Picture,
    /// Intrinsics, poses, calibration.
    Camera,
    /// Names of the scenes or frames of a split.
    List,
    /// Pixels to leave out; where there is one.
    Mask,
    /// Depth: for overlap, for methods that take depth, for figures over distance.
    Depth,
}

/// A file that a pair needs.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct NeededFile {
    /// What for.
    pub role: Role,
    /// Relative to the dataset's folder, `/` between levels; the first of several names that do.
    pub path: String,
    /// Other names that do as well.
    pub or: Vec<String>,
}

impl NeededFile {
    fn new(role: Role, path: impl Into<String>) -> Self {
        Self {
            role,
            path: path.into(),
            or: Vec::new(),
        }
    }

    fn or(mut self, other: impl Into<String>) -> Self {
        self.or.push(other.into());
        self
    }
}

/// The photograph of a scene and what a dataset keeps beside it, in order of [`Role`]; of a stereo
/// pair only the source's depth (the left one's). Where files are named in other files
/// (`transforms.json`), or are looked for by their stem, they are known only once those are there:
/// see [`files_of`].
pub fn files_for(format: &str, scene: &str, picture: &str) -> Vec<NeededFile> {
    let mut files = vec![NeededFile::new(Role::Picture, picture)];
    let (folder, name) = picture.rsplit_once('/').unwrap_or(("", picture));
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let new = |role: Role, path: String| NeededFile::new(role, path);
    let beside = |name: &str| match folder {
        "" => name.to_owned(),
        _ => format!("{folder}/{name}"),
    };
    // The folder above the photograph's.
    let up = folder.rsplit_once('/').map_or("", |(up, _)| up);
    let above = |name: &str| match up {
        "" => name.to_owned(),
        _ => format!("{up}/{name}"),
    };
    match format {
        "middlebury" => {
            files.push(new(Role::Camera, beside("calib.txt")));
            if stem == "im0" {
                let map = new(Role::Depth, beside("disp0.pfm"));
                files.push(map.or(beside("disp0GT.pfm")));
            }
        }
        "booster" => {
            let calibration = new(Role::Camera, above("calib_00-02.xml"));
            files.push(calibration.or(above("calib_00-01.xml")));
            if folder.ends_with("camera_00") {
                files.push(new(Role::Depth, above("disp_00.npy")));
            }
        }
        "scannetpp" => {
            let undistorted = folder.contains("undistorted");
            let (json, masks) = if undistorted {
                ("transforms_undistorted.json", "resized_undistorted_masks")
            } else {
                ("transforms.json", "resized_anon_masks")
            };
            files.push(new(Role::Camera, above(&format!("nerfstudio/{json}"))));
            if undistorted {
                // Depth is rendered in the fisheye camera.
                files.push(new(Role::Camera, above("nerfstudio/transforms.json")));
            }
            files.push(NeededFile::new(Role::List, "splits/nvs_test.txt"));
            files.push(new(Role::Mask, above(&format!("{masks}/{stem}.png"))));
            let rendered = new(Role::Depth, above(&format!("render_depth/{stem}.png")));
            let scene = up.strip_suffix("/dslr").unwrap_or(up);
            files.push(rendered.or(format!("{scene}/scans/mesh_aligned_0.05.ply")));
        }
        "wildrgbd" => {
            files.push(new(Role::Camera, above("metadata")));
            files.push(new(Role::Camera, above("cam_poses.txt")));
            let category = picture.split('/').next().unwrap_or("");
            files.push(new(Role::List, format!("{category}/nvs_list.json")));
            files.push(new(Role::Depth, above(&format!("depth/{stem}.png"))));
        }
        "tanks-and-temples" => {
            for end in ["COLMAP_SfM.log", "trans.txt"] {
                files.push(new(Role::Camera, format!("{scene}/{scene}_{end}")));
            }
            files.push(new(Role::Depth, format!("{scene}/{scene}.ply")));
        }
        "eth3d" => {
            let top = picture.split("/images/").next().unwrap_or(scene);
            let own = match folder.ends_with("undistorted") {
                true => "dslr_calibration_undistorted",
                false => "dslr_calibration_jpg",
            };
            // Depth lies in the geometry of the distorted pictures.
            let mut models = vec![own, "dslr_calibration_jpg"];
            models.dedup();
            for model in models {
                for list in ["cameras.txt", "images.txt"] {
                    files.push(new(Role::Camera, format!("{top}/{model}/{list}")));
                }
            }
            let map = format!("{top}/ground_truth_depth/dslr_images/{name}");
            files.push(new(Role::Depth, map.clone()).or(map + ".gz"));
        }
        "nerfstudio" => files.push(new(Role::Camera, above("transforms.json"))),
        "colmap" => {
            for list in ["cameras", "images"] {
                let binary = new(Role::Camera, above(&format!("sparse/0/{list}.bin")));
                files.push(binary.or(above(&format!("sparse/0/{list}.txt"))));
            }
        }
        "stereo" => {
            files.push(new(Role::Camera, beside("rig.txt")));
            if stem == "left" {
                files.push(new(Role::Depth, beside("disparity_left.pfm")));
            }
        }
        _ => {}
    }
    files
}

/// The files of a view that is there, as its reader found them, relative to the dataset's folder.
/// For a folder that is not the view's, whole paths.
pub fn files_of(view: &View, folder: &Path) -> Vec<NeededFile> {
    let relative = |file: &Path| {
        let inside = file.strip_prefix(folder).unwrap_or(file);
        let levels: Vec<_> = inside.iter().map(|level| level.to_string_lossy()).collect();
        levels.join("/")
    };
    let files = view.content.files_by_role().into_iter();
    files
        .map(|(role, file)| NeededFile::new(role, relative(&file)))
        .collect()
}

/// The archives of a dataset's official page that hold a scene; empty where that is not known.
pub fn archives_for(format: &str, scene: &str, picture: &str) -> Vec<String> {
    let last = scene.rsplit('/').next().unwrap_or(scene);
    let first = picture.split('/').next().unwrap_or(scene);
    match format {
        "middlebury" if last.ends_with("perfect") => vec![format!("zip/{last}.zip")],
        "middlebury" => ["F", "H", "Q"]
            .into_iter()
            .filter(|size| scene.contains(&format!("training{size}")))
            .flat_map(|size| {
                [
                    format!("MiddEval3-data-{size}.zip"),
                    format!("MiddEval3-GT0-{size}.zip"),
                ]
            })
            .collect(),
        "booster" => vec!["booster_gt.zip".to_owned()],
        "scannetpp" => vec![format!("scene {last}")],
        "wildrgbd" => vec![format!("category {first}")],
        "tanks-and-temples" => vec![format!("{last}.zip and its evaluation data")],
        "eth3d" => {
            // Depth lies in the geometry of the distorted pictures.
            let mut parts = vec!["dslr_jpg", "dslr_depth"];
            if picture.contains("/dslr_images_undistorted/") {
                parts.push("dslr_undistorted");
            }
            let name = |part| format!("{last}_{part}.7z");
            parts.into_iter().map(name).collect()
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(format: &str, scene: &str, picture: &str) -> Vec<String> {
        let files = files_for(format, scene, picture);
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
        let of = |format, scene| archives_for(format, scene, "cup/x");
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
        assert_eq!(archives_for("eth3d", "yard", undistorted).len(), 3);
        assert!(of("nerfstudio", "x").is_empty());
    }
}
