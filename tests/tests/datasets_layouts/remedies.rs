//! Missing files are only requested if they are needed, with a remedy; a guess must be confirmed.

use sharp_datasets::check::check;
use sharp_datasets::open_each;
use sharp_tests::copy_folder;

use crate::small::twice;
use crate::{spec, write};

#[test]
fn a_guessed_focal_length_has_to_be_confirmed() {
    let (folder, second) = twice("tanks-and-temples");
    std::fs::remove_file(second.join("cameras.txt")).unwrap();
    let found = open_each(&spec("tanks-and-temples", folder.path())).unwrap();
    assert_eq!(found.scenes.len(), 1);
    let why = found.left_out[0].why.to_string();
    for part in [
        "Ignatius",
        "never published",
        "cameras.txt",
        "intrinsics=0.7w",
        "intrinsics=0.6w",
    ] {
        assert!(why.contains(part), "{why}");
    }
    for (settings, focal) in [("0.7w", 0.7 * 12.0), ("0.6w", 0.6 * 12.0)] {
        let spec = spec(
            &format!("tanks-and-temples,intrinsics={settings}"),
            folder.path(),
        );
        let found = open_each(&spec).unwrap();
        assert_eq!((found.scenes.len(), found.left_out.len()), (2, 0));
        assert_eq!(found.scenes[1].views[0].intrinsics.fx, focal);
    }
}

#[test]
fn scannetpp_needs_the_fisheye_cameras_only_where_something_is_in_them() {
    let (folder, second) = twice("scannetpp");
    let json = second.join("dslr/nerfstudio/transforms.json");
    let text = std::fs::read_to_string(&json).unwrap();
    std::fs::remove_file(&json).unwrap();
    let why = || {
        let found = open_each(&spec("scannetpp", folder.path())).unwrap();
        let left_out = found.left_out.first();
        left_out.map(|scene| scene.why.to_string())
    };
    let error = why().unwrap();
    for part in [
        "nerfstudio/transforms.json: does not exist",
        "transforms_undistorted.json",
    ] {
        assert!(error.contains(part), "{error}");
    }
    // The toolbox's pictures, and depth that was rendered in the fisheye camera.
    let dslr = second.join("dslr");
    copy_folder(
        &dslr.join("resized_images"),
        &dslr.join("resized_undistorted_images"),
    )
    .unwrap();
    let pinhole = text
        .replace("OPENCV_FISHEYE", "PINHOLE")
        .replace("-0.03", "0");
    write::text(&dslr, "nerfstudio/transforms_undistorted.json", &pinhole);
    let error = why().unwrap();
    for part in [
        "transforms.json: does not exist",
        "render_depth",
        "depth=mesh",
    ] {
        assert!(error.contains(part), "{error}");
    }
    std::fs::remove_dir_all(dslr.join("render_depth")).unwrap();
    assert_eq!(why(), None);
    // A file that is not used may contain anything.
    write::text(&dslr, "nerfstudio/transforms.json", "{");
    assert_eq!(why(), None);
}

#[test]
fn files_that_place_depth_are_files_of_the_view() {
    let (folder, second) = twice("scannetpp");
    let dslr = second.join("dslr");
    copy_folder(
        &dslr.join("resized_images"),
        &dslr.join("resized_undistorted_images"),
    )
    .unwrap();
    let fisheye = dslr.join("nerfstudio/transforms.json");
    let text = std::fs::read_to_string(&fisheye).unwrap();
    let pinhole = text
        .replace("OPENCV_FISHEYE", "PINHOLE")
        .replace("-0.03", "0");
    write::text(&dslr, "nerfstudio/transforms_undistorted.json", &pinhole);
    let found = open_each(&spec("scannetpp", folder.path())).unwrap();
    let with_map = &found.scenes[1].views[0];
    assert!(with_map.content.files().contains(&fisheye), "{with_map:?}");
    let (folder, _) = twice("eth3d");
    let found = open_each(&spec("eth3d,images=undistorted", folder.path())).unwrap();
    let stored = folder.path().join("field/dslr_calibration_jpg/cameras.txt");
    assert!(found.scenes[0].views[0].content.files().contains(&stored));
}

#[test]
fn a_check_says_that_without_depth_no_pair_can_be_selected() {
    for (format, parts) in [
        ("colmap", ["depth/", "depth=points", "missing-depth=accept"]),
        (
            "nerfstudio",
            ["depth_file_path", "--overlap-depth", "missing-depth=accept"],
        ),
    ] {
        let (folder, second) = twice(format);
        let said = || {
            let report = check(&spec(format, folder.path()), 1, &|_, _| {}).unwrap();
            let notes = report.scenes.last().unwrap().notes.clone();
            notes
                .into_iter()
                .find(|note| note.contains("no pair can be selected"))
        };
        assert_eq!(said(), None);
        std::fs::remove_dir_all(second.join("depth")).unwrap();
        if format == "nerfstudio" {
            let json = second.join("transforms.json");
            let text = std::fs::read_to_string(&json).unwrap();
            std::fs::write(json, text.replace("depth_file_path", "other")).unwrap();
        }
        let said = said().unwrap();
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
}
