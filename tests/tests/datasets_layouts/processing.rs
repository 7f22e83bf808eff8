//! Masks and missing depth, and the notes about these and about lenses.

use std::path::Path;

use glam::DVec2;
use image::{GrayImage, Luma};
use sharp_datasets::check::{DatasetReport, check};
use sharp_datasets::format::{depth_png, npy};
use sharp_datasets::undistort::Undistortion;
use sharp_datasets::{DatasetSpec, Scene};

use crate::multi_view::{fisheye_keys, names, scannetpp_frame, transforms};
use crate::{fisheye, read, scene, write};

/// Whether a pixel of the stored picture is masked.
fn is_masked(x: i64, y: i64) -> bool {
    (20..31).contains(&x) && (0..22).contains(&y) || (x, y) == (60, 40)
}

/// ScanNet++ as published: fisheye pictures, one of them with a mask, and rendered depth.
fn scannetpp(folder: &Path) {
    let (scene, lens) = (scene(), fisheye());
    write::text(folder, "splits/nvs_test.txt", "s\n");
    let dslr = folder.join("data/s/dslr");
    for view in scene.views() {
        let stored = scene.view_through(&view.id, lens, view.camera_from_world);
        write::picture(&dslr, &format!("resized_images/{}.JPG", view.id), &stored);
        let map = dslr.join(format!("render_depth/{}.png", view.id));
        std::fs::create_dir_all(map.parent().unwrap()).unwrap();
        depth_png::write(&map, &write::millimetres(&write::depth_of(&stored))).unwrap();
    }
    let mask = GrayImage::from_fn(96, 72, |x, y| {
        Luma([if is_masked(x.into(), y.into()) {
            0
        } else {
            255
        }])
    });
    std::fs::create_dir_all(dslr.join("resized_anon_masks")).unwrap();
    mask.save(dslr.join("resized_anon_masks/view_01.png"))
        .unwrap();
    let frames = scene.views().iter();
    let frames = frames.map(|v| scannetpp_frame(v, &format!("{}.JPG", v.id), ""));
    let file = "nerfstudio/transforms.json";
    transforms(&dslr, file, &fisheye_keys(&lens), frames);
}

fn says(scene: &Scene, start: &str, part: &str) {
    let fits = |note: &&String| note.starts_with(start) && note.contains(part);
    let found = scene.notes.iter().filter(fits).count();
    assert_eq!(found, 1, "{start} … {part}: {:?}", scene.notes);
}

fn checked(text: &str) -> DatasetReport {
    let spec = DatasetSpec::parse(text).unwrap();
    check(&spec, 10, &|_, _| {}).unwrap()
}

#[test]
fn masks_follow_fisheye_pictures_to_the_pinhole() {
    let folder = tempfile::tempdir().unwrap();
    scannetpp(folder.path());
    let with = read("scannetpp", folder.path());
    let without = read("scannetpp,masks=ignore", folder.path());
    let pixels = |scene: &Scene, i: usize| {
        let content = &scene.views[i].content;
        (content.image().unwrap(), content.depth().unwrap().unwrap())
    };
    assert_eq!(pixels(&with, 0), pixels(&without, 0));
    let (picture, depth) = pixels(&with, 1);
    let (plain_picture, plain_depth) = pixels(&without, 1);
    let undistortion = Undistortion::like_scannetpp(fisheye()).unwrap();
    // The masked share of the pixels blended at a position.
    let masked_share = |place: DVec2| {
        let corner = (place - 0.5).floor();
        let blend = place - 0.5 - corner;
        let taps = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| {
            let share = DVec2::new(
                if i == 0 { 1.0 - blend.x } else { blend.x },
                if j == 0 { 1.0 - blend.y } else { blend.y },
            );
            let masked = is_masked(corner.x as i64 + i, corner.y as i64 + j);
            share.x * share.y * f64::from(u8::from(masked))
        });
        taps.iter().sum::<f64>()
    };
    let (mut black, mut rim, mut kept) = (0, 0, 0);
    for (x, y, pixel) in picture.enumerate_pixels() {
        let place = undistortion.stored_place(x, y).unwrap();
        let share = masked_share(place);
        let z = depth.get_pixel(x, y);
        // The limit is half a level of the mask.
        if share > 0.501 / 255.0 {
            assert_eq!((pixel.0, z.0), ([0; 3], [0.0]), "({x}, {y}): {share}");
            black += 1;
            rim += u32::from(share < 0.5);
        } else if share < 0.499 / 255.0 {
            assert_eq!(pixel, plain_picture.get_pixel(x, y), "({x}, {y})");
            assert_eq!(z, plain_depth.get_pixel(x, y), "({x}, {y})");
            kept += 1;
        }
    }
    assert!(
        black > 200 && rim > 10 && kept > 5000,
        "{black} {rim} {kept}"
    );
}

#[test]
fn what_was_done_to_pictures_is_said_once_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    scannetpp(folder.path());
    let found = read("scannetpp", folder.path());
    says(
        &found,
        "pictures: 5 of 5 undistorted by sharp-bench",
        "OPENCV_FISHEYE",
    );
    let k = found.views[0].intrinsics;
    says(&found, "pictures: 5", &format!("fx {:.3}", k.fx));
    says(&found, "pictures: 5", "96x72");
    says(&found, "masks: 1 of 5", "excluded pixels are black");
    says(
        &found,
        "depth: dslr/render_depth",
        "rendered by the toolbox",
    );
    assert_eq!(found.notes.len(), 3, "{:?}", found.notes);
    let other = read("scannetpp,masks=ignore,depth=none", folder.path());
    assert_eq!(other.notes.len(), 1, "{:?}", other.notes);

    let colmap = tempfile::tempdir().unwrap();
    for view in scene().views() {
        write::picture(colmap.path(), &format!("images/{}.png", view.id), view);
    }
    let names = names(scene().views(), "", "png");
    write::colmap_text(&colmap.path().join("sparse"), &fisheye(), &names);
    let found = read("colmap", colmap.path());
    says(
        &found,
        "pictures: 5 of 5 undistorted",
        "without blank pixels",
    );
    assert_eq!(found.notes.len(), 1, "{:?}", found.notes);
}

#[test]
fn absent_depth_is_said_and_a_problem_where_it_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    scannetpp(folder.path());
    let maps = folder.path().join("data/s/dslr/render_depth");
    std::fs::remove_file(maps.join("view_02.png")).unwrap();
    std::fs::remove_file(maps.join("view_04.png")).unwrap();
    let found = read("scannetpp", folder.path());
    says(
        &found,
        "depth: 2 of 5 pictures have no depth",
        "view_02.JPG, view_04.JPG",
    );
    let text = format!("scannetpp={}", folder.path().display());
    assert_eq!(checked(&format!("{text},depth=rendered")).problems, 0);
    std::fs::remove_dir_all(&maps).unwrap();
    let report = checked(&format!("{text},depth=rendered"));
    assert_eq!(report.problems, 1, "{:?}", report.scenes[0].problems);
    let problem = &report.scenes[0].problems[0];
    assert!(
        problem.contains("depth=rendered was requested"),
        "{problem}"
    );
    assert_eq!(checked(&text).problems, 0);
    // Every picture needs the same file, so this is one problem.
    let report = checked(&format!("{text},depth=mesh"));
    assert_eq!(report.problems, 1, "{:?}", report.scenes[0].problems);
    assert!(report.scenes[0].problems[0].contains("mesh_aligned_0.05.ply"));
}

#[test]
fn a_map_that_lacks_is_named_in_colmap_folders_too() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene();
    std::fs::create_dir_all(folder.path().join("depth")).unwrap();
    for view in scene.views() {
        write::picture(folder.path(), &format!("images/{}.png", view.id), view);
        let map = folder.path().join(format!("depth/{}.npy", view.id));
        if view.id != "view_03" {
            npy::write(&map, &write::depth_of(view)).unwrap();
        }
    }
    let lens = write::lens_of(&scene.views()[0]);
    let names = names(scene.views(), "", "png");
    write::colmap_text(&folder.path().join("sparse"), &lens, &names);
    let found = read("colmap,depth-unit=1", folder.path());
    says(&found, "depth: 1 of 5", "view_03.png");
    // A picture of a wrong size also makes the view's depth unusable: one problem per picture.
    let wrong = GrayImage::new(48, 36);
    wrong
        .save(folder.path().join("images/view_01.png"))
        .unwrap();
    let report = checked(&format!("colmap={},depth-unit=1", folder.path().display()));
    assert_eq!(report.problems, 1, "{:?}", report.scenes[0].problems);
}
