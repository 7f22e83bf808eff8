//! How readers treat a dataset's folder, in every layout: they read nothing outside it, through
//! symbolic links or names, and write nothing into it. The layouts are the small datasets of the
//! fuzz targets.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

use std::path::{Path, PathBuf};

use sharp_datasets::{DatasetSpec, Scene, open_each};
use sharp_tests::{copy_folder, rows};

/// Formats, with and without settings that make readers use other files of a layout.
const FORMATS: [&str; 10] = [
    "middlebury",
    "booster",
    "scannetpp",
    "wildrgbd",
    "tanks-and-temples",
    "eth3d",
    "eth3d,images=undistorted",
    "nerfstudio",
    "colmap",
    "stereo",
];

fn source(format: &str) -> PathBuf {
    let layout = format.split(',').next().unwrap();
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz/datasets")
        .join(layout)
}

/// Everything below a folder, sorted; files with their bytes, folders without.
fn tree(folder: &Path) -> Vec<(PathBuf, Option<Vec<u8>>)> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            let bytes = path.is_file().then(|| std::fs::read(&path).unwrap());
            if bytes.is_none() {
                open.push(path.clone());
            }
            found.push((path.strip_prefix(folder).unwrap().to_owned(), bytes));
        }
    }
    found.sort();
    found
}

fn read(format: &str, folder: &Path) -> Result<Vec<Scene>, sharp_datasets::DatasetError> {
    let (layout, settings) = format.split_at(format.find(',').unwrap_or(format.len()));
    let spec = DatasetSpec::parse(&format!("{layout}={}{settings}", folder.display())).unwrap();
    let found = open_each(&spec)?;
    if found.scenes.is_empty() {
        return found.all();
    }
    Ok(found.scenes)
}

/// Decodes everything; returns the number of views and of depth maps.
fn decode(scenes: &[Scene]) -> (usize, usize) {
    let views = scenes.iter().flat_map(|scene| &scene.views);
    let (mut pictures, mut maps) = (0, 0);
    for view in views {
        view.content.image().unwrap();
        pictures += 1;
        maps += usize::from(view.content.depth().unwrap().is_some());
    }
    (pictures, maps)
}

#[test]
fn every_layout_is_read_and_left_as_it_was() {
    for format in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        copy_folder(&source(format), folder.path()).unwrap();
        let before = tree(folder.path());
        for (path, _) in &before {
            set_readonly(&folder.path().join(path), true);
        }
        let (pictures, maps) = decode(&read(format, folder.path()).unwrap());
        assert_eq!(pictures, 2, "{format}");
        assert!(maps > 0, "{format}");
        assert_eq!(tree(folder.path()), before, "{format}");
        for (path, _) in &before {
            set_readonly(&folder.path().join(path), false);
        }
    }
}

fn set_readonly(path: &Path, readonly: bool) {
    let mut permissions = std::fs::metadata(path).unwrap().permissions();
    permissions.set_readonly(readonly);
    std::fs::set_permissions(path, permissions).unwrap();
}

/// Each file and folder in turn is replaced by a link to its own copy outside. The reader must
/// refuse it or leave it out, and no view may refer to a file outside.
#[cfg(unix)]
#[test]
fn no_symbolic_link_leaves_a_dataset() {
    for format in FORMATS {
        let (outside, mut refused) = (tempfile::tempdir().unwrap(), 0);
        copy_folder(&source(format), outside.path()).unwrap();
        for (path, bytes) in tree(&source(format)) {
            let folder = tempfile::tempdir().unwrap();
            copy_folder(&source(format), folder.path()).unwrap();
            let inside = folder.path().join(&path);
            match bytes {
                Some(_) => std::fs::remove_file(&inside).unwrap(),
                None => std::fs::remove_dir_all(&inside).unwrap(),
            }
            std::os::unix::fs::symlink(outside.path().join(&path), &inside).unwrap();
            let Ok(scenes) = read(format, folder.path()) else {
                refused += 1;
                continue;
            };
            let root = folder.path().canonicalize().unwrap();
            for view in scenes.iter().flat_map(|scene| &scene.views) {
                for file in view.content.files() {
                    let target = file.canonicalize().unwrap();
                    assert!(
                        target.starts_with(&root),
                        "{format}: {} leads to {}",
                        path.display(),
                        target.display()
                    );
                }
            }
        }
        assert!(refused > 0, "{format}");
    }
}

/// Formats, files, names in them, and what takes their place.
const NAMES: &str = "\
nerfstudio | transforms.json | images/0.png | ../0.png
nerfstudio | transforms.json | depth/0.png | ../../0.png
nerfstudio | transforms.json | images/0.png | /etc/hostname
colmap | sparse/0/images.txt | 0.png | ../../0.png
scannetpp | splits/nvs_test.txt | s | ../../s
scannetpp | data/s/dslr/nerfstudio/transforms.json | 0.JPG | ../../../../../0.JPG
wildrgbd | cup/nvs_list.json | scenes/scene_000 | ../../scene_000
eth3d | yard/dslr_calibration_jpg/images.txt | dslr_images/0 | ../../../0
eth3d,images=undistorted | yard/dslr_calibration_undistorted/images.txt | dslr_images_undistorted/0 | ../../../0";

/// Names in lists and camera files that lead outside are refused, and the error states the name.
#[test]
fn no_name_in_a_file_leaves_a_dataset() {
    for [format, file, from, to] in rows(NAMES) {
        let folder = tempfile::tempdir().unwrap();
        copy_folder(&source(format), folder.path()).unwrap();
        let path = folder.path().join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{format}: {text}");
        std::fs::write(&path, text.replace(from, to)).unwrap();
        let error = read(format, folder.path()).unwrap_err().to_string();
        assert!(error.contains("points outside"), "{format}: {error}");
    }
}
