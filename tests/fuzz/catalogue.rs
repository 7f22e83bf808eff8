// Whole datasets with one file replaced: how readers treat input that the parsers accept.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use sharp_datasets::{DatasetSpec, open_each};

macro_rules! files {
    ($($name:literal,)*) => {
        &[$(($name, include_bytes!(concat!("datasets/", $name)).as_slice())),*]
    };
}

/// A small dataset of every format: path (its first folder is the format) and bytes.
pub(crate) const FILES: &[(&str, &[u8])] = files![
    "booster/train/balanced/A/calib_00-02.xml",
    "booster/train/balanced/A/camera_00/im0.png",
    "booster/train/balanced/A/camera_02/im0.png",
    "booster/train/balanced/A/disp_00.npy",
    "colmap/depth/0.png",
    "colmap/images/0.png",
    "colmap/images/1.png",
    "colmap/sparse/0/cameras.txt",
    "colmap/sparse/0/images.txt",
    "colmap/sparse/0/points3D.txt",
    "eth3d/yard/dslr_calibration_jpg/cameras.txt",
    "eth3d/yard/dslr_calibration_jpg/images.txt",
    "eth3d/yard/dslr_calibration_undistorted/cameras.txt",
    "eth3d/yard/dslr_calibration_undistorted/images.txt",
    "eth3d/yard/ground_truth_depth/dslr_images/0.JPG",
    "eth3d/yard/ground_truth_depth/dslr_images/1.JPG",
    "eth3d/yard/images/dslr_images/0.JPG",
    "eth3d/yard/images/dslr_images/1.JPG",
    "eth3d/yard/images/dslr_images_undistorted/0.JPG",
    "eth3d/yard/images/dslr_images_undistorted/1.JPG",
    "middlebury/A/calib.txt",
    "middlebury/A/disp0.pfm",
    "middlebury/A/im0.png",
    "middlebury/A/im1.png",
    "nerfstudio/depth/0.png",
    "nerfstudio/depth/1.png",
    "nerfstudio/images/0.png",
    "nerfstudio/images/1.png",
    "nerfstudio/transforms.json",
    "scannetpp/data/s/dslr/nerfstudio/transforms.json",
    "scannetpp/data/s/dslr/render_depth/0.png",
    "scannetpp/data/s/dslr/resized_anon_masks/0.png",
    "scannetpp/data/s/dslr/resized_images/0.JPG",
    "scannetpp/data/s/dslr/resized_images/1.JPG",
    "scannetpp/splits/nvs_test.txt",
    "stereo/p/disparity_left.pfm",
    "stereo/p/left.png",
    "stereo/p/rig.txt",
    "stereo/p/right.png",
    "tanks-and-temples/Barn/Barn.ply",
    "tanks-and-temples/Barn/Barn_COLMAP_SfM.log",
    "tanks-and-temples/Barn/Barn_trans.txt",
    "tanks-and-temples/Barn/cameras.txt",
    "tanks-and-temples/Barn/images/000001.jpg",
    "tanks-and-temples/Barn/images/000002.jpg",
    "wildrgbd/cup/nvs_list.json",
    "wildrgbd/cup/scenes/scene_000/cam_poses.txt",
    "wildrgbd/cup/scenes/scene_000/depth/00000.png",
    "wildrgbd/cup/scenes/scene_000/depth/00001.png",
    "wildrgbd/cup/scenes/scene_000/metadata",
    "wildrgbd/cup/scenes/scene_000/rgb/00000.png",
    "wildrgbd/cup/scenes/scene_000/rgb/00001.png",
];

thread_local! {
    /// The files on disk, written once per thread.
    static FOLDER: OnceCell<Folder> = const { OnceCell::new() };
}

struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        let thread = format!("{:?}", std::thread::current().id());
        let number: String = thread.chars().filter(char::is_ascii_digit).collect();
        let name = format!("sharp-fuzz-{}-{number}", std::process::id());
        let folder = Self(std::env::temp_dir().join(name));
        for (name, bytes) in FILES {
            folder.write(name, bytes);
        }
        folder
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).expect("a folder");
        std::fs::write(path, bytes).expect("a file");
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Replaces one file: the first byte selects it, and the other bytes are its new content.
pub(crate) fn catalogue(bytes: &[u8]) {
    let Some((which, content)) = bytes.split_first() else {
        return;
    };
    let (name, original) = FILES[usize::from(*which) % FILES.len()];
    FOLDER.with(|folder| {
        let folder = folder.get_or_init(Folder::new);
        folder.write(name, content);
        let format = name.split('/').next().unwrap_or("");
        read(format, &folder.0.join(format));
        folder.write(name, original);
    });
}

/// Reads everything in a view, and checks that no file is outside the dataset's folder.
fn read(format: &str, root: &Path) {
    let plain = format!("{format}={}", root.display());
    read_as(&plain, root);
    if format == "eth3d" {
        read_as(&format!("{plain},images=undistorted"), root);
    }
}

fn read_as(spec: &str, root: &Path) {
    let spec = DatasetSpec::parse(spec).expect("a dataset");
    for scene in open_each(&spec).unwrap_or_default().scenes {
        for view in scene.views.iter().take(4) {
            for file in view.content.files() {
                let inside = file
                    .canonicalize()
                    .is_ok_and(|file| root.canonicalize().is_ok_and(|root| file.starts_with(root)));
                assert!(inside || !file.exists(), "{} was read", file.display());
            }
            let _ = view.content.image();
            let _ = view.content.depth();
        }
    }
}
