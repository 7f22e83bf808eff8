//! Damaged and incomplete scenes: in every layout they are reported with a reason, affect no other
//! scene, and are distinguished from scenes that a setting excludes.

use std::path::Path;

use sharp_datasets::check::check;
use sharp_datasets::open_each;
use sharp_tests::{copy_folder, rows};

use crate::multi_view::folder;
use crate::small::twice;
use crate::{left_out, refusal, spec, write};

/// Damaged scenes: the format with its settings, the file or folder in the second scene (without one, the scene
/// itself), `removed` or its new text, the scene that is left out, and a part of the reason.
const DAMAGED: &str = "\
middlebury          | im0.png                          | removed      | B                    | there is no im0.png
middlebury          | im1.png                          | removed      | B                    | there is no im1.png
middlebury          | calib.txt                        | removed      | B                    | there is no calib.txt
middlebury          | calib.txt                        | cam0         | B                    | calib.txt: the key 'cam0'
booster             | camera_00                        | removed      | train/balanced/B     | camera_00
booster             | camera_02                        | removed      | train/balanced/B     | camera_02
booster             | camera_00/im0.png                | removed      | train/balanced/B/im0 | camera_00/im0.png
booster             | camera_02/im0.png                | removed      | train/balanced/B/im0 | camera_02/im0.png
booster             | calib_00-02.xml                  | removed      | train/balanced/B     | missing calib_00-02.xml
booster             | calib_00-02.xml                  | <            | train/balanced/B/im0 | calib_00-02.xml
scannetpp           |                                  | removed      | t                    | nvs_test.txt: lists scenes that do not exist
scannetpp           | dslr                             | removed      | t                    | there is no dslr/
scannetpp           | dslr/resized_images              | removed      | t                    | no usable picture
scannetpp           | dslr/nerfstudio/transforms.json  | {            | t                    | transforms.json: not JSON
scannetpp,split=all | dslr                             | removed      | t                    | there is no dslr/
wildrgbd            |                                  | removed      | cup/scenes/scene_001 | nvs_list.json: lists scenes
wildrgbd            | metadata                         | {}           | cup/scenes/scene_001 | metadata: 'K' is not
wildrgbd            | cam_poses.txt                    | 0 1          | cup/scenes/scene_001 | cam_poses.txt
wildrgbd            | rgb                              | removed      | cup/scenes/scene_001 | no usable picture
tanks-and-temples   | Ignatius_COLMAP_SfM.log          | removed      | Ignatius             | Ignatius_COLMAP_SfM.log
tanks-and-temples   | Ignatius_trans.txt               | removed      | Ignatius             | Ignatius_trans.txt
tanks-and-temples   | Ignatius_trans.txt               | 1 0          | Ignatius             | Ignatius_trans.txt
tanks-and-temples   | images                           | removed      | Ignatius             | no pictures of Ignatius
eth3d               | dslr_calibration_jpg             | removed      | field                | set images=undistorted
eth3d               | dslr_calibration_jpg/images.txt  | removed      | field                | no complete model
eth3d               | dslr_calibration_jpg/cameras.txt | 0 PINHOLE 12 | field                | cameras.txt
nerfstudio          | transforms.json                  | []           | b                    | transforms.json: the document
colmap              | sparse/0/images.txt              | removed      | b                    | no complete model
colmap              | sparse/0/cameras.txt             | removed      | b                    | no complete model
colmap              | sparse/0/cameras.txt             | 1 PINHOLE x  | b                    | cameras.txt
stereo              | rig.txt                          | removed      | q                    | rig.txt
stereo              | right.png                        | removed      | q                    | no right.png";

#[test]
fn a_scene_that_is_there_is_read_or_named_with_its_reason() {
    for [format, file, damage, id, reason] in rows(DAMAGED) {
        let what = format!("{format} {file}");
        let (folder, second) = twice(format.split(',').next().unwrap());
        let path = match file {
            "" => second,
            file => second.join(file),
        };
        match damage {
            "removed" if path.is_dir() => std::fs::remove_dir_all(path).unwrap(),
            "removed" => std::fs::remove_file(path).unwrap(),
            text => std::fs::write(path, text).unwrap(),
        }
        let found = open_each(&spec(format, folder.path())).unwrap();
        assert_eq!(found.scenes.len(), 1, "{what}");
        let [scene] = &found.left_out[..] else {
            panic!("{what}: {:?}", found.left_out);
        };
        assert_eq!(scene.id, id, "{what}");
        let why = scene.why.to_string();
        assert!(
            scene.why.is_fault() && why.contains(reason),
            "{what}: {why}"
        );
        // `check` counts the damage as a problem, and readers that require all scenes return it as an error.
        let report = check(&spec(format, folder.path()), 1, &|_, _| {}).unwrap();
        let in_scenes: usize = report.scenes.iter().map(|s| s.problems.len()).sum();
        assert_eq!(report.problems - in_scenes, 1, "{what}");
        assert!(refusal(format, folder.path()).contains(reason), "{what}");
    }
}

#[test]
fn of_two_rectifications_the_perfect_one_counts_unless_asked_otherwise() {
    let folder = folder();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/datasets/middlebury/A");
    for name in [
        "A-perfect",
        "deep/A-imperfect",
        "B-imperfect",
        "C-perfect",
        "D",
    ] {
        copy_folder(&source, &folder.path().join(name)).unwrap();
    }
    let ids = |settings: &str| -> Vec<String> {
        let found = open_each(&spec(&format!("middlebury{settings}"), folder.path())).unwrap();
        found.scenes.into_iter().map(|scene| scene.id).collect()
    };
    assert_eq!(ids(""), ["A-perfect", "B-imperfect", "C-perfect", "D"]);
    let all = [
        "A-perfect",
        "B-imperfect",
        "C-perfect",
        "D",
        "deep/A-imperfect",
    ];
    assert_eq!(ids(",rectification=any"), all);
    assert_eq!(
        ids(",rectification=perfect"),
        ["A-perfect", "C-perfect", "D"]
    );
    assert_eq!(
        ids(",rectification=imperfect"),
        ["B-imperfect", "D", "deep/A-imperfect"]
    );
    let [broken, ruled_out] = left_out("middlebury", folder.path());
    assert!(broken.is_empty(), "{broken:?}");
    let reason =
        "rectification=one reads only <Scene>-perfect if it exists (rectification=any reads both)";
    assert_eq!(
        ruled_out,
        [format!("1 scene left out (deep/A-imperfect): {reason}")]
    );
    // A damaged perfect scene is not silently replaced by the imperfect one.
    std::fs::remove_file(folder.path().join("A-perfect/im1.png")).unwrap();
    assert_eq!(ids(""), ["B-imperfect", "C-perfect", "D"]);
}

#[test]
fn what_settings_rule_out_is_listed_and_is_no_fault() {
    let (folder, second) = twice("booster");
    for camera in ["camera_00", "camera_02"] {
        let picture = |name: &str| second.join(camera).join(name);
        std::fs::copy(picture("im0.png"), picture("im1.png")).unwrap();
    }
    copy_folder(&second, &folder.path().join("test_stereo/balanced/C")).unwrap();
    let [broken, ruled_out] = left_out("booster,illuminations=first", folder.path());
    assert!(broken.is_empty(), "{broken:?}");
    assert_eq!(
        ruled_out,
        [
            "1 scene left out (test_stereo/balanced/C): split=train and set=balanced",
            "1 scene left out (train/balanced/B/im1): illuminations=first",
        ]
    );
    let (folder, _) = twice("scannetpp");
    write::text(folder.path(), "splits/mine.txt", "t\r\n\r\n");
    let [broken, ruled_out] = left_out("scannetpp,split=mine", folder.path());
    assert!(broken.is_empty(), "{broken:?}");
    assert_eq!(
        ruled_out,
        ["1 scene left out (s): split=mine does not list them"]
    );
    let report = check(&spec("scannetpp,split=mine", folder.path()), 1, &|_, _| {}).unwrap();
    assert_eq!((report.unreadable.len(), report.ruled_out), (0, ruled_out));
}

#[test]
fn pictures_without_a_log_are_no_second_scene_of_one_that_has_it() {
    let (folder, second) = twice("tanks-and-temples");
    let sets = folder.path().join("image_sets");
    copy_folder(&second.join("images"), &sets.join("Ignatius")).unwrap();
    std::fs::remove_dir_all(second.join("images")).unwrap();
    assert_eq!(left_out("tanks-and-temples", folder.path())[0].len(), 0);
    copy_folder(&sets.join("Ignatius"), &sets.join("Truck")).unwrap();
    let [broken, _] = left_out("tanks-and-temples", folder.path());
    assert_eq!(broken.len(), 1);
    assert!(
        broken[0].contains("pictures, but no Truck_COLMAP_SfM.log"),
        "{broken:?}"
    );
}

#[test]
fn pictures_of_further_models_are_mentioned() {
    let (folder, second) = twice("colmap");
    copy_folder(&second.join("sparse/0"), &second.join("sparse/1")).unwrap();
    let found = open_each(&spec("colmap", folder.path())).unwrap();
    let notes = &found.scenes[1].notes;
    assert!(
        notes
            .iter()
            .any(|note| note.contains("the first of several models")),
        "{notes:?}"
    );
}
