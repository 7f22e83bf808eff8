//! Files without an entry in `EXPECTED.json`; each test states the expected result itself.

use std::path::Path;

use image::RgbImage;
use libtest_mimic::Trial;
use sharp_datasets::files::parse_text;
use sharp_datasets::format::{calib, colmap, colmap_records, trajectory};
use sharp_datasets::{DatasetError, DatasetSpec, Scene, open};
use tempfile::TempDir;

use crate::{Outcome, check, equal, fixture, refused};

pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = Vec::new();
    let mut add = |name: &'static str, test: fn(&'static str) -> Outcome| {
        trials.push(Trial::test(name, move || test(name)));
    };
    // Line ends, a byte order mark, blanks around `=`, and a missing doffs change nothing.
    add("calib_crlf.txt", the_rig);
    add("calib_bom_spaces.txt", the_rig);
    add("calib_nodoffs.txt", the_rig);
    add("calib_nan.txt", |name| {
        refused(
            parse_text(&fixture(name), calib::parse),
            name,
            "doffs is 'nan'",
        )
    });

    // An empty line of observations, CRLF and a missing last line do not lose an image.
    add("images_empty_points.txt", two_images);
    add("images_crlf.txt", two_images);
    add("images_no_final_newline.txt", two_images);
    // The name is the rest of the line, including folders and blanks.
    add("images_spaces.txt", |name| {
        check_names(name, &["my img (402).jpg", "sub dir/b.JPG"])
    });
    add("images_exponent.txt", exponents);
    add("images_unnormalised_quat_nan.txt", quaternions);

    // A block marked -1 has no pose; tabs, trailing blanks and blank lines are ignored.
    add("traj_missing_pose.log", one_identity);
    add("traj_tabs_trailing.log", one_identity);
    add("traj_truncated.log", |name| {
        refused(
            parse_text(&fixture(name), trajectory::parse_log),
            name,
            "block 0 has 11 numbers",
        )
    });
    // Frames are matched by their number, not by their row.
    add("cam_poses_gap.txt", |name| {
        let poses = parse_text(&fixture(name), trajectory::parse_rows)?;
        let frames: Vec<_> = poses.iter().map(|p| p.frame).collect();
        equal(&frames, &[0, 2])
    });
    add("pose_inf.txt", |name| {
        let read = parse_text(&fixture(name), trajectory::parse_similarity);
        refused(read, name, "not finite")
    });

    add("transforms_3x4.json", |name| {
        let scene = transforms(name, &[("a.png", 640, 480)])?.1;
        check_ids(&scene, &["a"])
    });
    // Without a size, the size is taken from the picture, and the focal length follows from the
    // angle.
    add("transforms_blender.json", blender);
    add("transforms_noext_dotslash.json", |name| {
        let scene = transforms(name, &[("images/r_0.png", 640, 480)])?.1;
        check_ids(&scene, &["r_0"])
    });
    add("transforms_dup.json", |name| {
        left_out(name, &["a"], "(a.png): the picture is listed twice")
    });
    add("transforms_nan.json", |name| {
        left_out(name, &["b"], "(a.png): the pose is not finite or not rigid")
    });
    // A frame's own intrinsics take precedence over the file's, which is reported.
    add("transforms_perframe.json", per_frame);
    add("transforms_traversal.json", |name| {
        let result = transforms(name, &[]);
        let name = "../../../../etc/hostname";
        refused(result, name, "points outside the dataset's folder")
    });
    trials
}

fn the_rig(name: &str) -> Outcome {
    let rig = parse_text(&fixture(name), calib::parse)?;
    equal(&rig.focal, &994.97775)?;
    equal(&rig.left_center, &(311.193, 254.87675))?;
    check((rig.doffs - 31.08575).abs() < 1e-12, || format!("{rig:?}"))?;
    equal(&rig.baseline_m, &0.193_001)?;
    equal(&rig.size, &Some((741, 500)))
}

/// The images of a text model whose `images.txt` is the fixture.
fn images(name: &str) -> Result<Vec<colmap_records::ColmapImage>, DatasetError> {
    let folder = TempDir::new().unwrap();
    let camera = "1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 500 500 320 240\n";
    std::fs::write(folder.path().join("cameras.txt"), camera).unwrap();
    std::fs::copy(fixture(name), folder.path().join("images.txt")).unwrap();
    Ok(colmap::read_model(folder.path())?.images)
}

fn check_names(name: &str, expected: &[&str]) -> Outcome {
    let images = images(name)?;
    let names: Vec<_> = images.iter().map(|i| i.name.as_str()).collect();
    equal(&names, expected)
}

fn two_images(name: &str) -> Outcome {
    check_names(name, &["a.jpg", "b.jpg"])?;
    let images = images(name)?;
    let pose = images[1].camera_from_world.ok_or("no pose")?;
    equal(&pose.translation, &glam::DVec3::X)
}

fn exponents(name: &str) -> Outcome {
    let images = images(name)?;
    let pose = images[0].camera_from_world.ok_or("no pose")?;
    // R12 of the quaternion (0.525, 8.616e-2, −0.833, −0.151), computed by hand.
    let (w, x, y, z) = (0.525_316_3, 0.086_164_98, -0.832_881_1, -0.151_418_2);
    let expected = 2.0 * (x * y - w * z);
    let found = pose.rotation.y_axis.x;
    check((found - expected).abs() < 1e-6, || {
        format!("{found} {expected}")
    })?;
    equal(&pose.translation.z, &71.6)
}

/// A quaternion of length 2 is normalised. With a NaN, a zero quaternion or an infinite
/// translation, an image has no pose, and readers leave it out and count it.
fn quaternions(name: &str) -> Outcome {
    let images = images(name)?;
    let has_pose: Vec<_> = images
        .iter()
        .map(|i| i.camera_from_world.is_some())
        .collect();
    equal(&has_pose, &[true, false, false, false])?;
    let folder = TempDir::new()?;
    let model = folder.path().join("sparse/0");
    std::fs::create_dir_all(&model)?;
    std::fs::write(model.join("cameras.txt"), "1 PINHOLE 8 6 5 5 4 3\n")?;
    std::fs::copy(fixture(name), model.join("images.txt"))?;
    for letter in ["a", "b", "c", "d"] {
        picture(folder.path(), &format!("images/{letter}.jpg"), 8, 6);
    }
    let scene = read("colmap", folder.path())?;
    check_ids(&scene, &["a"])?;
    check_note(&scene, "3 frame(s) left out")
}

fn one_identity(name: &str) -> Outcome {
    let poses = parse_text(&fixture(name), trajectory::parse_log)?.poses;
    check(poses.len() == 1 && poses[0].frame == 0, || {
        format!("{poses:?}")
    })?;
    let pose = poses[0].world_from_camera.clone()?;
    equal(&pose, &sharp::camera::RigidTransform::IDENTITY)
}

/// Reads the fixture as a scene's `transforms.json`, next to black pictures.
fn transforms(name: &str, pictures: &[(&str, u32, u32)]) -> Result<(TempDir, Scene), DatasetError> {
    let folder = TempDir::new().unwrap();
    std::fs::copy(fixture(name), folder.path().join("transforms.json")).unwrap();
    for (file, width, height) in pictures {
        picture(folder.path(), file, *width, *height);
    }
    let scene = read("nerfstudio", folder.path())?;
    Ok((folder, scene))
}

fn picture(folder: &Path, name: &str, width: u32, height: u32) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    RgbImage::new(width, height).save(path).unwrap();
}

fn read(format: &str, folder: &Path) -> Result<Scene, DatasetError> {
    let spec = DatasetSpec::parse(&format!("{format}={}", folder.display()))?;
    Ok(open(&spec)?.remove(0))
}

fn check_ids(scene: &Scene, expected: &[&str]) -> Outcome {
    let ids: Vec<_> = scene.views.iter().map(|v| v.id.as_str()).collect();
    equal(&ids, expected)
}

fn check_note(scene: &Scene, part: &str) -> Outcome {
    let found = scene.notes.iter().any(|note| note.contains(part));
    check(found, || format!("{:?}", scene.notes))
}

fn left_out(name: &str, ids: &[&str], note: &str) -> Outcome {
    let (_folder, scene) = transforms(name, &[("a.png", 640, 480), ("b.png", 640, 480)])?;
    check_ids(&scene, ids)?;
    check_note(&scene, note)
}

fn blender(name: &str) -> Outcome {
    let (_folder, scene) = transforms(name, &[("train/r_0.png", 800, 600)])?;
    check_ids(&scene, &["r_0"])?;
    let k = scene.views[0].intrinsics;
    let expected = 400.0 / (0.69_f64 / 2.0).tan();
    check((k.fx - expected).abs() < 1e-9 && k.fy == k.fx, || {
        format!("{k:?}")
    })?;
    equal(&(k.cx, k.cy, k.width), &(400.0, 300.0, 800))
}

fn per_frame(name: &str) -> Outcome {
    let (_folder, scene) = transforms(name, &[("a.png", 20, 20)])?;
    let k = scene.views[0].intrinsics;
    equal(&(k.fx, k.cx, k.width, k.height), &(600.0, 10.0, 20, 20))?;
    check(scene.views[0].content.image().is_ok(), || "size".into())?;
    check_note(&scene, "1 frame(s) have intrinsics that differ")
}
