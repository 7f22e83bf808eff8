//! Tanks and Temples: how poses and cameras are assigned to pictures.

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;
use sharp::camera::RigidTransform;
use sharp_datasets::View;
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::synthetic::SyntheticScene;

use crate::{agreement, compare_cameras, read, refusal, scene, scores, write};

const FORMAT: &str = "tanks-and-temples";

/// Writes the scene as `Barn` with pictures `images/000001.jpg` and so on, and without a scan.
fn barn(scene: &SyntheticScene) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().join("Barn");
    // World = similarity · SfM: a rotation, a shift and 4.13855 metres per unit.
    let scale = 4.13855;
    let turn = glam::DMat3::from_rotation_y(0.4) * glam::DMat3::from_rotation_x(-0.3);
    let shift = DVec3::new(1.5, -2.0, 0.7);
    let mut matrix = RigidTransform {
        rotation: turn * scale,
        translation: shift,
    }
    .to_row_major();
    matrix[15] = 1.0;
    write::text(&at, "Barn_trans.txt", &write::row(matrix));
    let mut log = String::new();
    for (i, view) in scene.views().iter().enumerate() {
        let pose = view.camera_from_world.inverse();
        let sfm = RigidTransform {
            rotation: turn.transpose() * pose.rotation,
            translation: turn.transpose() * (pose.translation - shift) / scale,
        };
        write::picture(&at, &format!("images/{:06}.jpg", i + 1), view);
        writeln!(log, "{i} {i} 0").unwrap();
        for row in sfm.to_row_major().chunks(4) {
            writeln!(log, "{}", write::row(row.iter().copied())).unwrap();
        }
    }
    write::text(&at, "Barn_COLMAP_SfM.log", &log);
    let (model, params) = write::colmap_camera(&write::lens_of(&scene.views()[0]));
    write::text(
        &at,
        "cameras.txt",
        &format!("1 {model} 96 72 {}", write::row(params)),
    );
    (folder, at)
}

/// Checks that the views read, given by their pictures' numbers, equal those written.
fn check(found: &[View], scene: &SyntheticScene, numbers: &[usize]) {
    let ids: Vec<_> = found.iter().map(|view| view.id.clone()).collect();
    let expected: Vec<_> = numbers.iter().map(|n| format!("{n:06}")).collect();
    assert_eq!(ids, expected);
    for (view, number) in found.iter().zip(numbers) {
        let truth = &scene.views()[number - 1];
        compare_cameras(view, truth);
        assert_eq!(
            view.content.image().unwrap(),
            truth.content.image().unwrap()
        );
    }
}

fn has_note(notes: &[String], part: &str) {
    assert!(
        notes.iter().any(|note| note.contains(part)),
        "'{part}' is not in {notes:?}"
    );
}

#[test]
fn tanks_and_temples() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    let all: Vec<_> = scene.views().iter().flat_map(write::points).collect();
    write::ply(&at, "Barn.ply", &all);
    let found = read("tanks-and-temples,splat-radius=0", folder.path());
    check(&found.views, &scene, &[1, 2, 3, 4, 5]);
    for (a, b) in found.views.iter().zip(scene.views()) {
        let share = agreement(&write::depth_of(a), &write::depth_of(b));
        // Points of other views are visible between the points of this view.
        assert!(share > 0.975, "{share}");
    }
    assert_eq!(scores(&found.views), scores(scene.views()));
    assert!(found.notes.is_empty(), "{:?}", found.notes);
    let guessed = read("tanks-and-temples,intrinsics=0.7w", folder.path());
    assert_eq!(guessed.views[0].intrinsics.fx, 0.7 * 96.0);
    has_note(&guessed.notes, "never published");
}

#[test]
fn a_missing_picture_does_not_shift_the_poses_of_those_that_follow() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    std::fs::remove_file(at.join("images/000003.jpg")).unwrap();
    let found = read(FORMAT, folder.path());
    check(&found.views, &scene, &[1, 2, 4, 5]);
    let left_out: Vec<String> = found.left_out.iter().map(ToString::to_string).collect();
    has_note(&left_out, "1 view left out (block 2 (picture 000003)): ");
    has_note(&left_out, "the block's picture does not exist");
}

#[test]
fn a_picture_without_a_block_is_left_out_and_named() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    write::picture(&at, "images/000006.jpg", &scene.views()[0]);
    write::picture(&at, "images/000009.jpg", &scene.views()[0]);
    let found = read(FORMAT, folder.path());
    check(&found.views, &scene, &[1, 2, 3, 4, 5]);
    has_note(
        &found.notes,
        "2 frame(s) left out (000006.jpg, 000009.jpg): no block of the log belongs to the picture",
    );
    // As many pictures as blocks, but one picture does not belong to the sequence.
    for name in ["000003", "000006", "000009"] {
        std::fs::remove_file(at.join(format!("images/{name}.jpg"))).unwrap();
    }
    write::picture(&at, "images/cover.jpg", &scene.views()[0]);
    let found = read(FORMAT, folder.path());
    check(&found.views, &scene, &[1, 2, 4, 5]);
    has_note(
        &found.notes,
        "(cover.jpg): no block of the log belongs to the picture",
    );
}

#[test]
fn blocks_go_by_their_own_index_and_unregistered_pictures_are_named() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    let log = at.join("Barn_COLMAP_SfM.log");
    let text = std::fs::read_to_string(&log).unwrap();
    // The block of picture 2 is removed, and that of picture 4 is marked as having no pose.
    let lines: Vec<&str> = text.lines().collect();
    let without: Vec<&str> = [&lines[..5], &lines[10..]].concat();
    let text = without.join("\n").replace("3 3 0\n", "3 -1 0\n");
    std::fs::write(&log, text).unwrap();
    let found = read(FORMAT, folder.path());
    check(&found.views, &scene, &[1, 3, 5]);
    has_note(
        &found.notes,
        "(000002.jpg): no block of the log belongs to the picture",
    );
    has_note(
        &found.notes,
        "(000004.jpg): the log says that the picture has no pose",
    );
}

#[test]
fn other_names_count_by_order_only_if_there_are_as_many_as_blocks() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    for number in 1..=5 {
        let from = at.join(format!("images/{number:06}.jpg"));
        std::fs::rename(from, at.join(format!("images/IMG_{number}.jpg"))).unwrap();
    }
    let found = read(FORMAT, folder.path());
    assert_eq!(found.views[4].id, "IMG_5");
    for (a, b) in found.views.iter().zip(scene.views()) {
        compare_cameras(a, b);
    }
    write::picture(&at, "images/a_preview.jpg", &scene.views()[0]);
    let error = refusal(FORMAT, folder.path());
    for part in [
        "Barn_COLMAP_SfM.log",
        "6 pictures in ",
        "5 blocks",
        "IMG_1.jpg",
    ] {
        assert!(error.contains(part), "{error}");
    }
    std::fs::remove_file(at.join("images/IMG_2.jpg")).unwrap();
    std::fs::remove_file(at.join("images/IMG_3.jpg")).unwrap();
    let error = refusal(FORMAT, folder.path());
    assert!(error.contains("4 pictures in "), "{error}");
}

#[test]
fn of_several_folders_the_one_that_fits_the_log_is_read_and_the_others_are_named() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    // All pictures are next to the log, and one in images/ has another picture's content.
    for number in 1..=5 {
        let name = format!("{number:06}.jpg");
        std::fs::rename(at.join("images").join(&name), at.join(&name)).unwrap();
    }
    write::picture(&at, "images/000001.jpg", &scene.views()[4]);
    let found = read(FORMAT, folder.path());
    check(&found.views, &scene, &[1, 2, 3, 4, 5]);
    let left = at.join("images").display().to_string();
    has_note(
        &found.notes,
        &format!("and the 1 file(s) in {left} are ignored"),
    );
}

/// One camera per picture, with different focal lengths, and ids in another order than the
/// pictures.
fn several_cameras(at: &Path, count: usize) {
    let mut cameras = String::new();
    let mut images = String::new();
    for number in 1..=count {
        let id = 100 - number;
        writeln!(
            cameras,
            "{id} PINHOLE 96 72 {}.5 80.25 47.5 36.5",
            80 + number
        )
        .unwrap();
        writeln!(images, "{number} 1 0 0 0 0 0 0 {id} Barn/{number:06}.png\n").unwrap();
    }
    write::text(at, "cameras.txt", &cameras);
    write::text(at, "images.txt", &images);
}

#[test]
fn of_several_cameras_each_picture_has_the_one_that_the_model_names() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    several_cameras(&at, 5);
    let found = read(FORMAT, folder.path());
    let focal: Vec<f64> = found.views.iter().map(|view| view.intrinsics.fx).collect();
    assert_eq!(focal, [81.5, 82.5, 83.5, 84.5, 85.5]);
    assert!(
        found.views[0]
            .content
            .files()
            .contains(&at.join("images.txt"))
    );
    several_cameras(&at, 4);
    let found = read(FORMAT, folder.path());
    assert_eq!(found.views.len(), 4);
    has_note(
        &found.notes,
        "(000005.jpg): the COLMAP model has several cameras and does not list the picture",
    );
}

#[test]
fn several_cameras_that_nothing_assigns_are_refused_with_the_way_out() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    several_cameras(&at, 5);
    let images = std::fs::read_to_string(at.join("images.txt")).unwrap();
    let twice = format!("{images}9 1 0 0 0 0 0 0 98 Other/000001.jpg\n\n");
    write::text(&at, "images.txt", &twice);
    let error = refusal(FORMAT, folder.path());
    assert!(
        error.contains("images.txt: assigns more than one camera to pictures named 000001"),
        "{error}"
    );
    write::text(&at, "images.txt", &images.replace(" 98 ", " 7 "));
    let error = refusal(FORMAT, folder.path());
    assert!(
        error.contains("images.txt: 'Barn/000002.png' has camera 7"),
        "{error}"
    );
    std::fs::remove_file(at.join("images.txt")).unwrap();
    let error = refusal(FORMAT, folder.path());
    for part in [
        "cameras.txt: has 5 cameras",
        "single_camera",
        "intrinsics=0.7w",
    ] {
        assert!(error.contains(part), "{error}");
    }
    read("tanks-and-temples,intrinsics=0.7w", folder.path());
}

#[test]
fn a_model_of_another_size_is_scaled_on_request() {
    let scene = scene();
    let (folder, at) = barn(&scene);
    let small = write::lens_of(&scene.views()[0]).intrinsics();
    let twice = Lens::new(
        (2.0 * small.fx, 2.0 * small.fy),
        (2.0 * small.cx, 2.0 * small.cy),
        (192, 144),
        Distortion::None,
    )
    .unwrap();
    let (model, params) = write::colmap_camera(&twice);
    let camera = format!("1 {model} 192 144 {}", write::row(params));
    write::text(&at, "cameras.txt", &camera);
    let found = read("tanks-and-temples,camera-size=scaled", folder.path());
    check(&found.views, &scene, &[1, 2, 3, 4, 5]);
    has_note(
        &found.notes,
        "5 camera(s) calibrated for 192x144 were scaled to the pictures' size, 96x72",
    );
    let refused = read(FORMAT, folder.path()).views[0].content.image();
    let error = refused.unwrap_err().to_string();
    assert!(
        error.contains("000001.jpg: is 96x72, but its camera is for 192x144"),
        "{error}"
    );
    assert!(error.contains("camera-size=scaled"), "{error}");
}
