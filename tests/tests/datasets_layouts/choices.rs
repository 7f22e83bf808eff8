//! Readers' choices in ambiguous folders and folders with unreadable files: they report what they
//! used, what they skipped and why, and a broken list affects nothing else.

use std::path::Path;

use sharp_datasets::check::DatasetReport;
use sharp_datasets::format::npy;
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::synthetic::SyntheticScene;
use sharp_tests::copy_folder;

use crate::multi_view::{folder, names, pinhole_keys, transforms};
use crate::{Depth, compare, compare_cameras, left_out, read, refusal, scene, spec, write};

fn has_note(notes: &[String], part: &str) {
    assert!(
        notes.iter().any(|note| note.contains(part)),
        "'{part}' is not in {notes:?}"
    );
}

/// Runs `datasets check` on a folder.
fn checked(text: &str, folder: &Path) -> DatasetReport {
    sharp_datasets::check::check(&spec(text, folder), 2, &|_, _| {}).unwrap()
}

/// Frames for some of the views, without extensions.
fn frames(scene: &SyntheticScene, views: &[usize]) -> Vec<String> {
    let frame = |i: &usize| {
        let view = &scene.views()[*i];
        format!(
            "{{\"file_path\": \"images/{}\", \"transform_matrix\": {}}}",
            view.id,
            write::opengl_rows(&view.camera_from_world)
        )
    };
    views.iter().map(frame).collect()
}

/// A folder with PNGs, and all frames in the file `name`, in the form of `transforms.json`.
fn own(scene: &SyntheticScene, name: &str) -> tempfile::TempDir {
    let folder = folder();
    for view in scene.views() {
        write::picture(folder.path(), &format!("images/{}.png", view.id), view);
    }
    write_json(folder.path(), scene, name, &[0, 1, 2, 3, 4]);
    folder
}

fn write_json(folder: &Path, scene: &SyntheticScene, name: &str, views: &[usize]) {
    let keys = pinhole_keys(&scene.views()[0]);
    transforms(folder, name, &keys, frames(scene, views).into_iter());
}

#[test]
fn of_two_files_of_one_stem_the_photograph_is_read_and_the_other_is_noted() {
    let scene = scene();
    let folder = own(&scene, "transforms.json");
    image::RgbImage::new(96, 72)
        .save(folder.path().join("images/view_00.jpg"))
        .unwrap();
    let found = read("nerfstudio", folder.path());
    compare(&found.views, scene.views(), Depth::Absent);
    has_note(
        &found.notes,
        "transforms.json: 1 name(s) match several files that differ in case or extension: images/view_00.png is read, \
         not view_00.jpg",
    );
    std::fs::remove_file(folder.path().join("images/view_00.jpg")).unwrap();
    assert!(read("nerfstudio", folder.path()).notes.is_empty());
}

#[test]
fn two_depth_maps_of_one_picture_are_noted() {
    let scene = scene();
    let folder = folder();
    let at = folder.path();
    for view in scene.views() {
        write::picture(at, &format!("images/{}.png", view.id), view);
    }
    std::fs::create_dir(at.join("depth")).unwrap();
    npy::write(
        &at.join("depth/view_01.npy"),
        &write::depth_of(&scene.views()[1]),
    )
    .unwrap();
    write::bytes(at, "depth/view_01.pfm", b"");
    let lens = write::lens_of(&scene.views()[0]);
    write::colmap_text(
        &at.join("sparse/0"),
        &lens,
        &names(scene.views(), "", "png"),
    );
    let found = read("colmap,depth-unit=1", at);
    let depth = found.views[1].content.depth().unwrap().unwrap();
    assert_eq!(depth, write::depth_of(&scene.views()[1]));
    has_note(&found.notes, "depth/view_01.npy is read, not view_01.pfm");
}

#[test]
fn of_several_transforms_files_the_one_read_is_named() {
    let scene = scene();
    let folder = own(&scene, "transforms_train.json");
    let found = read("nerfstudio", folder.path());
    has_note(
        &found.notes,
        "transforms_train.json was read, because there is no transforms.json",
    );
    write_json(folder.path(), &scene, "transforms_val.json", &[1, 2]);
    write_json(folder.path(), &scene, "transforms_test.json", &[3, 4]);
    let found = read("nerfstudio", folder.path());
    assert_eq!(found.views.len(), 5);
    has_note(
        &found.notes,
        "transforms_train.json was read, not transforms_val.json, transforms_test.json next to it; to read another \
         file, give its path",
    );
    let other = read("nerfstudio", &folder.path().join("transforms_val.json"));
    assert_eq!(other.views.len(), 2);
    assert!(other.notes.is_empty(), "{:?}", other.notes);
    write_json(folder.path(), &scene, "transforms.json", &[0, 1, 2]);
    let found = read("nerfstudio", folder.path());
    assert_eq!(found.views.len(), 3);
    has_note(
        &found.notes,
        "transforms.json was read, not transforms_train.json, transforms_val",
    );
}

#[test]
fn pictures_smaller_than_their_camera_have_it_scaled_on_request() {
    let scene = scene();
    let half = |view: &sharp_datasets::View| {
        let k = view.intrinsics;
        let (focal, center) = ((k.fx / 2.0, k.fy / 2.0), (k.cx / 2.0, k.cy / 2.0));
        let lens = Lens::new(focal, center, (48, 36), Distortion::None).unwrap();
        scene.view_through(&view.id, lens, view.camera_from_world)
    };
    let halves: Vec<_> = scene.views().iter().map(half).collect();
    // `transforms.json` with a camera for the smaller size.
    let folder = own(&scene, "transforms.json");
    for view in &halves {
        write::picture(folder.path(), &format!("images/{}.png", view.id), view);
    }
    let at = folder.path().join("small");
    for view in &halves {
        write::picture(&at, &format!("images/{}.png", view.id), view);
    }
    let all = frames(&scene, &[0, 1, 2, 3, 4]);
    transforms(
        &at,
        "transforms.json",
        &pinhole_keys(&halves[0]),
        all.into_iter(),
    );
    let scaled = read("nerfstudio,camera-size=scaled", folder.path());
    let written = read("nerfstudio", &at);
    compare(&scaled.views, &written.views, Depth::Absent);
    compare(&scaled.views, &halves, Depth::Absent);
    for (a, b) in scaled.views.iter().zip(&written.views) {
        assert_eq!(a.intrinsics, b.intrinsics);
    }
    has_note(
        &scaled.notes,
        "5 camera(s) calibrated for 96x72 were scaled to the pictures' size, 48x36",
    );
    let report = checked("nerfstudio", folder.path());
    let problems = report.scenes[0].problems.join("\n");
    assert!(problems.contains("camera-size=scaled"), "{problems}");
}

#[test]
fn a_colmap_model_of_larger_pictures_is_scaled_with_its_distortion_and_its_depth() {
    let scene = scene();
    let k = write::lens_of(&scene.views()[0]).intrinsics();
    let fisheye = |scale: f64, size| {
        let distortion = Distortion::OpenCvFisheye {
            k: [-0.0295, -0.0076, -0.00093, 0.00031],
        };
        let (focal, center) = ((k.fx * scale, k.fy * scale), (k.cx * scale, k.cy * scale));
        Lens::new(focal, center, size, distortion).unwrap()
    };
    let read_with = |lens: &Lens, settings: &str| {
        let folder = folder();
        let at = folder.path();
        std::fs::create_dir(at.join("depth")).unwrap();
        for view in scene.views() {
            let stored =
                scene.view_through(&view.id, fisheye(1.0, (96, 72)), view.camera_from_world);
            write::picture(at, &format!("images/{}.png", view.id), &stored);
            let map = at.join(format!("depth/{}.npy", view.id));
            npy::write(&map, &write::depth_of(&stored)).unwrap();
        }
        write::colmap_text(&at.join("sparse/0"), lens, &names(scene.views(), "", "png"));
        let found = read(&format!("colmap,depth-unit=1{settings}"), at);
        let content: Vec<_> = found
            .views
            .iter()
            .map(|v| (v.content.image().unwrap(), write::depth_of(v)))
            .collect();
        (found, content)
    };
    let (written, expected) = read_with(&fisheye(1.0, (96, 72)), "");
    let (scaled, content) = read_with(&fisheye(2.0, (192, 144)), ",camera-size=scaled");
    for (a, b) in scaled.views.iter().zip(&written.views) {
        compare_cameras(a, b);
    }
    assert!(content == expected, "picture or depth differ");
}

#[cfg(unix)]
#[test]
fn scenes_behind_links_that_lead_out_are_counted_in_notes_and_errors() {
    let scene = scene();
    let (set, outside) = (folder(), own(&scene, "transforms.json"));
    let link = set.path().join("linked");
    std::os::unix::fs::symlink(outside.path(), &link).unwrap();
    let error = refusal("nerfstudio", set.path());
    assert!(error.contains("no nerfstudio scene found"), "{error}");
    let reason = "a symbolic link points outside the dataset's folder";
    assert!(
        error.contains(reason) && error.contains("(linked)"),
        "{error}"
    );
    let inside = own(&scene, "transforms.json");
    std::fs::rename(inside.path(), set.path().join("own")).unwrap();
    let found = read("nerfstudio", set.path());
    assert_eq!(found.id, "own");
    has_note(&left_out("nerfstudio", set.path())[0], reason);
    let both = sharp_datasets::open(&spec("nerfstudio,outside=allow", set.path())).unwrap();
    assert_eq!(both.len(), 2);
    let error = refusal("stereo", set.path());
    assert!(error.contains(reason), "{error}");
}

/// Two categories of the small WildRGB-D layout that the fuzzer starts from.
fn two_categories() -> tempfile::TempDir {
    let folder = folder();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/datasets/wildrgbd/cup");
    for category in ["apple", "cup"] {
        copy_folder(&source, &folder.path().join(category)).unwrap();
    }
    folder
}

#[test]
fn a_broken_list_hides_no_other_category() {
    for (text, reason) in [
        ("{", "apple/nvs_list.json: not JSON"),
        (
            "{\"val\": [\"../../../cup/scenes/scene_000\"]}",
            "apple/nvs_list.json: the path '../../../cup/scenes/scene_000' points outside",
        ),
    ] {
        let folder = two_categories();
        write::text(folder.path(), "apple/nvs_list.json", text);
        let report = checked("wildrgbd", folder.path());
        assert_eq!(report.scenes.len(), 1, "{text}");
        assert_eq!(report.scenes[0].id, "cup/scenes/scene_000");
        assert_eq!(report.unreadable.len(), 1);
        assert!(
            report.unreadable[0].contains(reason),
            "{:?}",
            report.unreadable
        );
    }
}

#[test]
fn names_that_are_not_there_are_counted_as_scenes() {
    let folder = two_categories();
    let list = "{\"val\": [\"scenes/scene_000\", \"scenes/scene_007\"]}";
    write::text(folder.path(), "apple/nvs_list.json", list);
    let found = sharp_datasets::open_each(&spec("wildrgbd", folder.path())).unwrap();
    assert_eq!(found.scenes.len(), 2);
    let [broken, _] = left_out("wildrgbd", folder.path());
    has_note(&broken, "1 scene left out (apple/scenes/scene_007)");
    has_note(&broken, "nvs_list.json: lists scenes that do not exist");
    // Callers that request only the scenes get all of them or an error.
    let error = refusal("wildrgbd", folder.path());
    assert!(error.contains("lists scenes that do not exist"), "{error}");
}

#[cfg(unix)]
#[test]
fn pictures_behind_links_that_lead_out_are_counted() {
    let folder = two_categories();
    let outside = two_categories();
    let rgb = "cup/scenes/scene_000/rgb";
    let entry = std::fs::read_dir(folder.path().join(rgb))
        .unwrap()
        .next()
        .unwrap()
        .unwrap();
    std::fs::remove_file(entry.path()).unwrap();
    let target = outside.path().join(rgb).join(entry.file_name());
    std::os::unix::fs::symlink(target, entry.path()).unwrap();
    let scenes = sharp_datasets::open(&spec("wildrgbd", folder.path())).unwrap();
    assert_eq!(scenes[1].views.len(), scenes[0].views.len() - 1);
    has_note(&scenes[1].notes, "1 file(s) left out (");
    has_note(&scenes[1].notes, "): a symbolic link points outside");
}

#[test]
fn a_bad_line_of_a_split_hides_no_other_scene() {
    let folder = folder();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/datasets/scannetpp");
    copy_folder(&source, folder.path()).unwrap();
    write::text(
        folder.path(),
        "splits/nvs_test.txt",
        "../../elsewhere\ns\nt\n",
    );
    let report = checked("scannetpp", folder.path());
    assert_eq!(report.scenes.len(), 1);
    assert_eq!(report.scenes[0].id, "s");
    has_note(&report.unreadable, "(t): ");
    let reason = "splits/nvs_test.txt: the path '../../elsewhere/dslr' points outside";
    has_note(&report.unreadable, reason);
}

#[test]
fn names_that_lead_out_name_the_file_that_holds_them() {
    let scene = scene();
    let folder = own(&scene, "transforms.json");
    let json = folder.path().join("transforms.json");
    let text = std::fs::read_to_string(&json).unwrap();
    std::fs::write(&json, text.replace("images/view_03", "../view_03")).unwrap();
    let error = refusal("nerfstudio", folder.path());
    assert!(
        error.contains("transforms.json: the path '../view_03' points outside"),
        "{error}"
    );
    let lens = write::lens_of(&scene.views()[0]);
    let model = folder.path().join("sparse/0");
    write::colmap_text(&model, &lens, &names(scene.views(), "../../", "png"));
    let error = refusal("colmap", folder.path());
    assert!(
        error.contains("sparse/0/images.txt: the path '../../view_0"),
        "{error}"
    );
}

#[test]
fn a_right_picture_that_no_scene_has_is_named_with_its_setting() {
    let folder = folder();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/datasets/middlebury/A");
    copy_folder(&source, &folder.path().join("A-perfect")).unwrap();
    copy_folder(&source, &folder.path().join("B-perfect")).unwrap();
    let error = refusal("middlebury,right=im1E", folder.path());
    for part in [
        "right=",
        "2 scenes left out (A-perfect, B-perfect): there is no im1E.png, which right=im1E requires",
    ] {
        assert!(error.contains(part), "{error}");
    }
    let error = refusal("middlebury,rectification=imperfect", folder.path());
    assert!(error.contains("rectification="), "{error}");
    let im1 = folder.path().join("A-perfect/im1.png");
    std::fs::copy(&im1, folder.path().join("A-perfect/im1E.png")).unwrap();
    let found = read("middlebury,right=im1E", folder.path());
    assert_eq!(found.id, "A-perfect");
    let [broken, ruled_out] = left_out("middlebury,right=im1E", folder.path());
    assert!(broken.is_empty(), "{broken:?}");
    has_note(
        &ruled_out,
        "1 scene left out (B-perfect): there is no im1E.png",
    );
}

#[test]
fn a_unit_that_is_no_number_is_a_wrong_setting_and_no_broken_scene() {
    let scene = scene();
    let folder = own(&scene, "transforms.json");
    for text in [
        "nerfstudio,scale=nan",
        "nerfstudio,depth-unit=0",
        "colmap,scale=-1",
    ] {
        let spec = spec(text, folder.path());
        let error = sharp_datasets::check::check(&spec, 10, &|_, _| {}).unwrap_err();
        assert!(
            matches!(error, sharp_datasets::DatasetError::Spec { .. }),
            "{error}"
        );
    }
}
