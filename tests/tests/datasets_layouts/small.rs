//! The small datasets of the fuzz targets, as two equal scenes.

use std::path::{Path, PathBuf};

use sharp_tests::copy_folder;

use crate::multi_view::folder;
use crate::write;

/// A dataset with two equal scenes; returns the folder of the second scene, which is a copy of the
/// first, and its id.
pub(crate) fn twice(format: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = folder();
    let layouts = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/datasets");
    let (from, copied) = match format {
        "middlebury" => ("A", "B"),
        "booster" => ("train/balanced/A", "train/balanced/B"),
        "scannetpp" => ("data/s", "data/t"),
        "wildrgbd" => ("cup/scenes/scene_000", "cup/scenes/scene_001"),
        "tanks-and-temples" => ("Barn", "Ignatius"),
        "eth3d" => ("yard", "field"),
        "stereo" => ("p", "q"),
        // The layout has a single scene.
        _ => ("", "b"),
    };
    if from.is_empty() {
        copy_folder(&layouts.join(format), &folder.path().join("a")).unwrap();
        copy_folder(&layouts.join(format), &folder.path().join("b")).unwrap();
    } else {
        copy_folder(&layouts.join(format), folder.path()).unwrap();
        copy_folder(&folder.path().join(from), &folder.path().join(copied)).unwrap();
    }
    let second = folder.path().join(copied);
    match format {
        "scannetpp" => write::text(folder.path(), "splits/nvs_test.txt", "s\nt\n"),
        "wildrgbd" => write::text(
            folder.path(),
            "cup/nvs_list.json",
            "{\"val\": [\"scenes/scene_000\", \"scenes/scene_001\"]}",
        ),
        "tanks-and-temples" => {
            for end in ["_COLMAP_SfM.log", "_trans.txt", ".ply"] {
                let named = |name: &str| second.join(format!("{name}{end}"));
                std::fs::rename(named("Barn"), named("Ignatius")).unwrap();
            }
        }
        _ => {}
    }
    (folder, second)
}
