//! What each dataset is and where to get it, as data: for `datasets list` and for reports.

use serde::Serialize;

/// Facts about one dataset, as its authors state them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Facts {
    /// The format's name, as in `FORMAT=PATH`.
    pub format: &'static str,
    /// Full name.
    pub title: &'static str,
    /// Official page.
    pub page: &'static str,
    /// Terms of use, in brief; the page holds.
    pub terms: &'static str,
    /// What to download.
    pub download: &'static str,
    /// How large that is.
    pub size: &'static str,
    /// The layout that the reader looks for.
    pub layout: &'static str,
    /// The column group of the paper's tables that it feeds; empty for one's own data.
    pub table_column: &'static str,
    /// What the reader cannot know for sure.
    pub caveat: &'static str,
}

/// The facts about every format, in the catalogue's order.
pub fn facts() -> &'static [Facts] {
    &FACTS
}

const FACTS: [Facts; 10] = [
    Facts {
        format: "middlebury",
        title: "Middlebury Stereo 2014",
        page: "https://vision.middlebury.edu/stereo/data/scenes2014/",
        terms: "free to use and publish; cite Scharstein et al., GCPR 2014",
        download: "zip/<Scene>-perfect.zip and -imperfect.zip (23 scenes each), or MiddEval3-data-F.zip \
                   with MiddEval3-GT0-F.zip",
        size: "46 archives; pictures of 5 to 6 megapixels, disparity maps of 24 MB each; one scene is bundled at a \
               quarter of the size",
        layout: "<Scene>/{im0.png, im1.png, calib.txt, disp0.pfm or disp0GT.pfm}",
        table_column: "Middlebury",
        caveat: "the paper says neither which scenes nor which rectification it used",
    },
    Facts {
        format: "booster",
        title: "Booster",
        page: "https://cvlab-unibo.github.io/booster-web/",
        terms: "research use; do not redistribute",
        download: "booster_gt.zip; only the training set has ground truth",
        size: "19.3 GB (8.3 GB unpacked for train/balanced)",
        layout: "train/balanced/<Scene>/{camera_00/*.png, camera_02/*.png, disp_00.npy, \
                 disp_02.npy, calib_00-02.xml}",
        table_column: "Booster",
        caveat: "the paper does not say whether every illumination counts (228 pairs) or one (38)",
    },
    Facts {
        format: "scannetpp",
        title: "ScanNet++ (v1, v2)",
        page: "https://kaldir.vc.in.tum.de/scannetpp/",
        terms: "non-commercial research after application; no redistribution",
        download: "DSLR pictures, nerfstudio/ cameras, splits/, and scans/ for depth",
        size: "371 GB of DSLR pictures for all 1,006 scenes of v2",
        layout: "splits/<split>.txt, data/<scene>/dslr/{resized_images, nerfstudio/transforms.json}, \
                 data/<scene>/scans/mesh_aligned_0.05.ply",
        table_column: "ScanNet++",
        caveat: "the paper names nvs_test, whose test pictures and meshes are withheld; \
                 split=nvs_sem_val has both",
    },
    Facts {
        format: "wildrgbd",
        title: "WildRGB-D",
        page: "https://github.com/wildrgbd/wildrgbd",
        terms: "MIT (the repository's licence; no separate terms for the data)",
        download: "one archive in parts a category; join the parts before unpacking",
        size: "3.37 TB for all 46 categories, 4 TB unpacked",
        layout: "<category>/nvs_list.json, <category>/scenes/scene_*/{rgb, depth, metadata, \
                 cam_poses.txt}",
        table_column: "WildRGBD",
        caveat: "'validation split from nvs list in each scene' reads as scenes or as frames",
    },
    Facts {
        format: "tanks-and-temples",
        title: "Tanks and Temples, training set",
        page: "https://www.tanksandtemples.org/",
        terms: "non-commercial research without redistribution, beside a CC BY 4.0 notice",
        download: "image sets of the seven training scenes, their SfM logs, alignments and laser scans",
        size: "1920x1080 pictures, some hundreds a scene (Barn: 410), and the scans",
        layout: "<Scene>/{<Scene>_COLMAP_SfM.log, <Scene>_trans.txt, <Scene>.ply, images/000001.jpg ...}; \
                 cameras.txt or .bin beside the log or in sparse/0, with images.* if it has several",
        table_column: "Tanks and Temples",
        caveat: "intrinsics were never published: give a COLMAP model or accept 0.7 of the width",
    },
    Facts {
        format: "eth3d",
        title: "ETH3D high-resolution multi-view, training set",
        page: "https://www.eth3d.net/datasets",
        terms: "CC BY-NC-SA 4.0",
        download: "<scene>_dslr_jpg.7z and _dslr_depth.7z of 13 scenes; _dslr_undistorted.7z for images=undistorted",
        size: "24-megapixel pictures; every depth map is 97,542,144 bytes",
        layout: "<scene>/{images/dslr_images, dslr_calibration_jpg, ground_truth_depth/dslr_images}; \
                 or images/dslr_images_undistorted and dslr_calibration_undistorted beside them",
        table_column: "ETH3D",
        caveat: "depth is semi-sparse; the paper estimates overlap from monocular depth",
    },
    Facts {
        format: "nerfstudio",
        title: "your own pictures with transforms.json",
        page: "https://docs.nerf.studio/quickstart/data_conventions.html",
        terms: "yours",
        download: "nothing",
        size: "any",
        layout: "transforms.json (or transforms_train.json) and the pictures it names",
        table_column: "",
        caveat: "the poses' unit is taken as metres; say scale= if it is not",
    },
    Facts {
        format: "colmap",
        title: "your own pictures with a COLMAP model",
        page: "https://colmap.github.io/format.html",
        terms: "yours",
        download: "nothing",
        size: "any",
        layout: "images/, sparse/0/{cameras, images}.{bin or txt}; depth/ if there is any",
        table_column: "",
        caveat: "the model's unit is taken as metres; say scale= if it is not",
    },
    Facts {
        format: "stereo",
        title: "your own rectified pairs",
        page: "",
        terms: "yours",
        download: "nothing",
        size: "any",
        layout: "<pair>/{left.png, right.png, rig.txt}; disparity_left.pfm if there is any",
        table_column: "",
        caveat: "",
    },
    Facts {
        format: "synthetic",
        title: "a procedural scene with exact depth and visibility",
        page: "",
        terms: "part of this program",
        download: "nothing",
        size: "computed",
        layout: "no folder: synthetic or synthetic=seed=7,size=320x240,views=24",
        table_column: "",
        caveat: "no photograph",
    },
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalog::formats;

    #[test]
    fn every_format_has_its_facts_in_the_same_order() {
        let described: Vec<_> = facts().iter().map(|f| f.format).collect();
        let known: Vec<_> = formats().iter().map(|f| f.name).collect();
        assert_eq!(described, known);
    }
}
