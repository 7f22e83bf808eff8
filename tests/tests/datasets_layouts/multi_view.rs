//! Layouts of posed pictures.

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;
use sharp::camera::RigidTransform;
use sharp_datasets::View;
use sharp_datasets::format::{depth_png, exr_depth, npy};
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::synthetic::SyntheticScene;

use crate::{
    Depth, agreement, compare, compare_cameras, fisheye, left_out, psnr, read, scene, scores, write,
};

pub(crate) fn names(
    views: &[View],
    folder: &str,
    extension: &str,
) -> Vec<(String, RigidTransform)> {
    views
        .iter()
        .map(|v| (format!("{folder}{}.{extension}", v.id), v.camera_from_world))
        .collect()
}

pub(crate) fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// `transforms.json` with every frame, the last one first.
pub(crate) fn transforms(
    folder: &Path,
    name: &str,
    keys: &str,
    frames: impl Iterator<Item = String>,
) {
    let mut frames: Vec<_> = frames.collect();
    frames.reverse();
    let text = format!("{{{keys}, \"frames\": [{}]}}", frames.join(",\n"));
    write::text(folder, name, &text);
}

pub(crate) fn pinhole_keys(view: &View) -> String {
    let k = view.intrinsics;
    format!(
        "\"camera_model\": \"PINHOLE\", \"fl_x\": {:?}, \"fl_y\": {:?}, \"cx\": {:?}, \
         \"cy\": {:?}, \"w\": {}, \"h\": {}.0",
        k.fx, k.fy, k.cx, k.cy, k.width, k.height
    )
}

#[test]
fn nerfstudio_with_depth_in_png_npy_and_exr() {
    let scene = scene();
    for (extension, unit, accuracy) in [
        ("png", "0.001", Depth::Millimetres),
        ("npy", "1", Depth::Exact),
        ("exr", "1", Depth::Exact),
    ] {
        let folder = folder();
        for view in scene.views() {
            write::picture(folder.path(), &format!("images/{}.png", view.id), view);
            let path = folder
                .path()
                .join(format!("images/{}_z.{extension}", view.id));
            let depth = write::depth_of(view);
            match extension {
                "png" => depth_png::write(&path, &write::millimetres(&depth)).unwrap(),
                "npy" => npy::write(&path, &depth).unwrap(),
                _ => exr_depth::write(&path, &depth).unwrap(),
            }
        }
        let frames = scene.views().iter().map(|v| {
            format!(
                "{{\"file_path\": \"./images/{0}\", \"depth_file_path\": \"images/{0}_z.{extension}\", \
                 \"transform_matrix\": {1}}}",
                v.id,
                write::opengl_rows(&v.camera_from_world)
            )
        });
        transforms(
            folder.path(),
            "transforms.json",
            &pinhole_keys(&scene.views()[0]),
            frames,
        );
        let found = read(&format!("nerfstudio,depth-unit={unit}"), folder.path());
        compare(&found.views, scene.views(), accuracy);
        assert_eq!(found.views[0].id, "view_00");
    }
}

#[test]
fn nerfstudio_scale_is_metres_of_one_unit() {
    let scene = scene();
    let folder = folder();
    for view in scene.views() {
        write::picture(folder.path(), &format!("{}.png", view.id), view);
    }
    let frames = scene.views().iter().map(|v| {
        let mut pose = v.camera_from_world;
        pose.translation /= 0.25;
        let rows = write::opengl_rows(&pose);
        format!(
            "{{\"file_path\": \"{}.png\", \"transform_matrix\": {rows}}}",
            v.id
        )
    });
    transforms(
        folder.path(),
        "transforms.json",
        &pinhole_keys(&scene.views()[0]),
        frames,
    );
    let found = read("nerfstudio,scale=0.25", folder.path());
    compare(&found.views, scene.views(), Depth::Absent);
}

#[test]
fn colmap_text_and_binary() {
    let scene = scene();
    let lens = write::lens_of(&scene.views()[0]);
    for binary in [false, true] {
        let folder = folder();
        for view in scene.views() {
            write::picture(folder.path(), &format!("images/cam/{}.png", view.id), view);
            let depth = folder.path().join(format!("depth/cam/{}.npy", view.id));
            std::fs::create_dir_all(depth.parent().unwrap()).unwrap();
            npy::write(&depth, &write::depth_of(view)).unwrap();
        }
        let model = folder.path().join("sparse/0");
        let images = names(scene.views(), "cam/", "png");
        if binary {
            write::colmap_binary(&model, &lens, &images);
        } else {
            write::colmap_text(&model, &lens, &images);
        }
        let found = read("colmap,depth-unit=1", folder.path());
        compare(&found.views, scene.views(), Depth::Exact);
        assert!(found.notes.is_empty(), "{:?}", found.notes);
    }
}

/// If the first camera in the file has an unknown model, only the picture taken with it is lost.
#[test]
fn colmap_binary_with_a_camera_of_an_unknown_model() {
    let scene = scene();
    let folder = folder();
    for view in scene.views() {
        write::picture(folder.path(), &format!("images/{}.png", view.id), view);
    }
    let model = folder.path().join("sparse/0");
    let images = names(scene.views(), "", "png");
    write::colmap_binary(&model, &write::lens_of(&scene.views()[0]), &images);
    let cameras = std::fs::read(model.join("cameras.bin")).unwrap();
    let mut changed = 2_u64.to_le_bytes().to_vec();
    changed.extend(7_u32.to_le_bytes());
    changed.extend(99_i32.to_le_bytes());
    changed.extend([96_u64, 72].iter().flat_map(|side| side.to_le_bytes()));
    changed.extend([0.5_f64; 7].iter().flat_map(|value| value.to_le_bytes()));
    changed.extend(&cameras[8..]);
    write::bytes(&model, "cameras.bin", &changed);
    // The camera of the first image follows the image count, the image's id and seven values.
    let mut images = std::fs::read(model.join("images.bin")).unwrap();
    images[68..72].copy_from_slice(&7_u32.to_le_bytes());
    write::bytes(&model, "images.bin", &images);
    let found = read("colmap", folder.path());
    compare(&found.views, &scene.views()[1..], Depth::Absent);
    let picture = format!("left out ({}.png): ", scene.views()[0].id);
    let reason =
        "camera model '99' is not supported; make pinhole pictures with `colmap image_undistorter`";
    assert!(
        found
            .notes
            .iter()
            .any(|note| note.contains(&picture) && note.ends_with(reason)),
        "{:?}",
        found.notes
    );
    // With an additional byte, no length of the record fits.
    changed.push(0);
    write::bytes(&model, "cameras.bin", &changed);
    let refused = crate::refusal("colmap", folder.path());
    assert!(
        refused.contains("camera 7 has unknown model 99"),
        "{refused}"
    );
}

#[test]
fn colmap_points_are_sparse_depth() {
    let scene = scene();
    let folder = folder();
    let model = folder.path().join("sparse");
    for view in scene.views() {
        write::picture(folder.path(), &format!("images/{}.png", view.id), view);
    }
    let lens = write::lens_of(&scene.views()[0]);
    write::colmap_text(&model, &lens, &names(scene.views(), "", "png"));
    // Every 50th point of the first view, seen by the first and third image (ids 10 and 30).
    let mut text = String::new();
    let points = write::points(&scene.views()[0]);
    for (i, p) in points.iter().step_by(50).enumerate() {
        writeln!(text, "{i} {} 1 2 3 0.5 10 0 30 0", write::row(p.to_array())).unwrap();
    }
    write::text(&model, "points3D.txt", &text);
    let found = read("colmap,depth=points", folder.path());
    let depths: Vec<_> = found.views.iter().map(write::depth_of).collect();
    let valid = |i: usize| depths[i].iter().filter(|z| **z > 0.0).count();
    assert_eq!(valid(0), points.len().div_ceil(50));
    assert!(valid(2) > 20);
    assert_eq!(valid(1), 0);
    let truth = write::depth_of(&scene.views()[0]);
    for (a, b) in depths[0]
        .iter()
        .zip(truth.iter())
        .filter(|(a, _)| **a > 0.0)
    {
        assert!((a - b).abs() < 1e-5 * b);
    }
}

#[test]
fn wildrgbd() {
    let scene = scene();
    let folder = folder();
    let at = folder.path().join("cup/scenes/scene_000");
    let k = scene.views()[0].intrinsics;
    // Column-major K with integer pixel centres.
    let numbers = [k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx - 0.5, k.cy - 0.5, 1.0];
    let numbers: Vec<_> = numbers.iter().map(|v| format!("{v:?}")).collect();
    write::text(
        &at,
        "metadata",
        &format!(
            "{{\"w\": {}, \"h\": {}, \"K\": [{}]}}",
            k.width,
            k.height,
            numbers.join(", ")
        ),
    );
    let mut poses = String::new();
    for (i, view) in scene.views().iter().enumerate() {
        let frame = 3 * i;
        write::picture(&at, &format!("rgb/{frame:05}.png"), view);
        let map = at.join(format!("depth/{frame:05}.png"));
        std::fs::create_dir_all(map.parent().unwrap()).unwrap();
        depth_png::write(&map, &write::millimetres(&write::depth_of(view))).unwrap();
        let rows = view.camera_from_world.inverse().to_row_major();
        writeln!(poses, "{frame} {}", write::row(rows)).unwrap();
    }
    write::text(&at, "cam_poses.txt", &poses);
    let list = "{\"train\": [\"scenes/scene_001\"], \"val\": [\"scenes/scene_000\", \"scenes/scene_777\"]}";
    write::text(folder.path(), "cup/nvs_list.json", list);
    let found = read("wildrgbd", folder.path());
    compare(&found.views, scene.views(), Depth::Millimetres);
    assert_eq!(found.views[2].id, "00006");
    let list_path = folder.path().join("cup/nvs_list.json");
    assert_eq!(
        left_out("wildrgbd", folder.path())[0],
        [format!(
            "1 scene left out (cup/scenes/scene_777): {}: lists scenes that do not exist",
            list_path.display()
        )]
    );
    compare(
        &read("wildrgbd,split=all-scenes", folder.path()).views,
        scene.views(),
        Depth::Millimetres,
    );
    write::text(
        &at,
        "nvs_list.json",
        "{\"train\": [0, 3, 6], \"val\": [9, 12]}",
    );
    let found = read("wildrgbd,split=val-frames", folder.path());
    compare(&found.views, &scene.views()[3..], Depth::Millimetres);
}

fn thin_prism() -> Lens {
    let distortion = Distortion::ThinPrismFisheye {
        k: [0.21047, 0.21102, -0.158023, 0.406856],
        p: [-5.36231e-06, 0.00051541],
        s: [-8.46499e-05, 0.000861313],
    };
    Lens::new((60.0, 59.9), (48.2, 36.3), (96, 72), distortion).unwrap()
}

/// Raw floats, with +inf where there is no depth.
fn raw_depth(folder: &Path, name: &str, view: &View) {
    let values: Vec<u8> = write::depth_of(view)
        .iter()
        .map(|z| if *z > 0.0 { *z } else { f32::INFINITY })
        .flat_map(f32::to_le_bytes)
        .collect();
    write::bytes(folder, name, &values);
}

#[test]
fn eth3d() {
    let scene = scene();
    let lens = thin_prism();
    let folder = folder();
    let at = folder.path().join("courtyard");
    let mut through = Vec::new();
    for view in scene.views() {
        let stored = scene.view_through(&view.id, lens, view.camera_from_world);
        let name = format!("{}.JPG", view.id);
        write::picture(&at, &format!("images/dslr_images_undistorted/{name}"), view);
        write::picture(&at, &format!("images/dslr_images/{name}"), &stored);
        raw_depth(
            &at,
            &format!("ground_truth_depth/dslr_images/{name}"),
            &stored,
        );
        through.push(stored);
    }
    let pinhole = write::lens_of(&scene.views()[0]);
    write::colmap_text(
        &at.join("dslr_calibration_undistorted"),
        &pinhole,
        &names(scene.views(), "dslr_images_undistorted/", "JPG"),
    );
    write::colmap_text(
        &at.join("dslr_calibration_jpg"),
        &lens,
        &names(scene.views(), "dslr_images/", "JPG"),
    );
    let found = read("eth3d,images=undistorted", folder.path());
    for (a, b) in found.views.iter().zip(scene.views()) {
        compare_cameras(a, b);
        assert_eq!(a.content.image().unwrap(), b.content.image().unwrap());
        let share = agreement(&write::depth_of(a), &write::depth_of(b));
        // It is resampled twice, so pixels along depth edges change sides.
        assert!(share > 0.985, "{share}");
    }
    assert_eq!(scores(&found.views), scores(scene.views()));
    check_undistorted(&scene, &read("eth3d", folder.path()).views, 0.93);
}

/// Checks that pictures undistorted by the reader show what a pinhole camera in the view's position
/// sees.
fn check_undistorted(scene: &SyntheticScene, found: &[View], share: f64) {
    assert_eq!(found.len(), scene.views().len());
    for (a, b) in found.iter().zip(scene.views()) {
        let truth = scene.view_through("truth", write::lens_of(a), b.camera_from_world);
        compare_cameras(a, &truth);
        let quality = psnr(&a.content.image().unwrap(), &truth.content.image().unwrap());
        assert!(quality > 20.0, "{quality}");
        let agree = agreement(&write::depth_of(a), &write::depth_of(&truth));
        assert!(agree > share, "{agree}");
    }
}

/// The camera of a `transforms.json` for a fisheye lens.
pub(crate) fn fisheye_keys(lens: &Lens) -> String {
    let i = lens.intrinsics();
    let mut keys = format!(
        "\"camera_model\": \"OPENCV_FISHEYE\", \"fl_x\": {:?}, \"fl_y\": {:?}, \"cx\": {:?}, \
         \"cy\": {:?}, \"w\": {}, \"h\": {}",
        i.fx, i.fy, i.cx, i.cy, i.width, i.height
    );
    if let Distortion::OpenCvFisheye { k } = lens.distortion() {
        for (i, k) in k.iter().enumerate() {
            write!(keys, ", \"k{}\": {k:?}", i + 1).unwrap();
        }
    }
    keys
}

/// A frame of ScanNet++'s JSON, which swaps the world's axes.
pub(crate) fn scannetpp_frame(view: &View, file: &str, extra: &str) -> String {
    let pose = view.camera_from_world.inverse();
    let swap = |v: DVec3| DVec3::new(v.y, v.x, -v.z);
    let r = pose.rotation;
    let swapped = RigidTransform {
        rotation: glam::DMat3::from_cols(swap(r.x_axis), swap(r.y_axis), swap(r.z_axis)),
        translation: swap(pose.translation),
    };
    format!(
        "{{\"file_path\": \"{file}\", {extra}\"transform_matrix\": {}}}",
        write::opengl_rows(&swapped.inverse())
    )
}

#[test]
fn scannetpp() {
    let scene = scene();
    let lens = fisheye();
    let folder = folder();
    write::text(folder.path(), "splits/nvs_test.txt", "a1b2c3\nnot_here\n");
    let at = folder.path().join("data/a1b2c3");
    let dslr = at.join("dslr");
    let keys = fisheye_keys(&lens);
    for view in scene.views() {
        let stored = scene.view_through(&view.id, lens, view.camera_from_world);
        write::picture(&dslr, &format!("resized_images/{}.JPG", view.id), &stored);
        let map = dslr.join(format!("render_depth/{}.png", view.id));
        std::fs::create_dir_all(map.parent().unwrap()).unwrap();
        depth_png::write(&map, &write::millimetres(&write::depth_of(&stored))).unwrap();
    }
    let frames = |extra: &'static str| {
        scene
            .views()
            .iter()
            .map(move |v| scannetpp_frame(v, &format!("{}.JPG", v.id), extra))
    };
    transforms(
        &dslr,
        "nerfstudio/transforms.json",
        &keys,
        frames("\"is_bad\": false, "),
    );
    let found = read("scannetpp", folder.path());
    // Near the border, a pixel of the fisheye picture covers more than one pixel of the pinhole
    // picture.
    check_undistorted(&scene, &found.views, 0.97);
    let [broken, _] = left_out("scannetpp", folder.path());
    assert_eq!(broken.len(), 1);
    assert!(broken[0].contains("(not_here)"), "{broken:?}");

    // The toolbox's undistorted pictures, used unchanged.
    for view in scene.views() {
        write::picture(
            &dslr,
            &format!("resized_undistorted_images/{}.JPG", view.id),
            view,
        );
    }
    let keys = pinhole_keys(&scene.views()[0]);
    transforms(
        &dslr,
        "nerfstudio/transforms_undistorted.json",
        &keys,
        frames(""),
    );
    let found = read("scannetpp,depth=none", folder.path());
    compare(&found.views, scene.views(), Depth::Absent);
    // The depth of the undistorted pictures is looked up in the fisheye map.
    let found = read("scannetpp", folder.path());
    for (a, b) in found.views.iter().zip(scene.views()) {
        let share = agreement(&write::depth_of(a), &write::depth_of(b));
        assert!(share > 0.97, "{share}");
    }
    // Once the axes are swapped back, the scan is in the same world as the poses.
    let all: Vec<_> = scene.views().iter().flat_map(write::points).collect();
    write::ply(&at, "scans/mesh_aligned_0.05.ply", &all);
    let found = read("scannetpp,depth=mesh", folder.path());
    for (a, b) in found.views.iter().zip(scene.views()) {
        let share = agreement(&write::depth_of(a), &write::depth_of(b));
        // Points of other views are visible between the points of this view.
        assert!(share > 0.975, "{share}");
    }
}

#[test]
fn scannetpp_drops_bad_poses_and_blackens_masks() {
    let scene = scene();
    let folder = folder();
    write::text(folder.path(), "splits/mine.txt", "s\n");
    let dslr = folder.path().join("data/s/dslr");
    for view in scene.views() {
        write::picture(&dslr, &format!("resized_images/{}.JPG", view.id), view);
    }
    let mut mask = image::GrayImage::from_pixel(96, 72, image::Luma([255]));
    mask.put_pixel(5, 6, image::Luma([254]));
    let path = dslr.join("resized_anon_masks/view_01.png");
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    mask.save(path).unwrap();
    let frames = scene.views().iter().map(|v| {
        let bad = v.id == "view_00";
        scannetpp_frame(v, &format!("{}.JPG", v.id), &format!("\"is_bad\": {bad}, "))
    });
    transforms(
        &dslr,
        "nerfstudio/transforms.json",
        &pinhole_keys(&scene.views()[0]),
        frames,
    );
    let found = read("scannetpp,split=mine", folder.path());
    assert_eq!(found.views.len(), scene.views().len() - 1);
    assert!(
        found.notes.iter().any(|n| n.contains("pose as bad")),
        "{:?}",
        found.notes
    );
    assert!(
        found.notes.iter().any(|n| n.contains("no depth")),
        "{:?}",
        found.notes
    );
    let image = found.views[0].content.image().unwrap();
    let truth = scene.views()[1].content.image().unwrap();
    assert_eq!(image.get_pixel(5, 6).0, [0, 0, 0]);
    assert_eq!(image.get_pixel(6, 6), truth.get_pixel(6, 6));
    let kept = read("scannetpp,split=mine,bad=keep,masks=ignore", folder.path());
    compare(&kept.views, scene.views(), Depth::Absent);
}
