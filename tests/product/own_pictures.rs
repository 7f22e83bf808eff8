//! A user's own pictures: a small dataset with `transforms.json`.

use std::path::Path;

use glam::{DMat3, DVec3};
use serde_json::json;
use sharp::camera::RigidTransform;
use sharp_datasets::format::npy;
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::synthetic::{SyntheticOptions, SyntheticScene};

use crate::support::{holds, read, sharp_bench};

/// Views of the procedural world on a wide arc, as one's own pictures with `transforms.json`;
/// `axes` are the signs of the camera axes that the poses are written with.
pub(crate) fn own_pictures(folder: &Path, axes: [f64; 3]) {
    let scene = SyntheticScene::new(SyntheticOptions {
        width: 64,
        height: 48,
        views: 2,
        ..SyntheticOptions::default()
    })
    .unwrap();
    let k = scene.views()[0].intrinsics;
    let size = (k.width, k.height);
    let lens = Lens::new((k.fx, k.fy), (k.cx, k.cy), size, Distortion::None).unwrap();
    std::fs::create_dir_all(folder).unwrap();
    let mut frames = Vec::new();
    for i in 0..4 {
        let angle = 0.25 * f64::from(i) - 0.4;
        let center = DVec3::new(-1.5 * angle, -0.2, 0.1 * f64::from(i));
        let rotation = DMat3::from_rotation_y(-angle) * DMat3::from_rotation_x(0.15);
        let pose = RigidTransform {
            rotation,
            translation: -(rotation * center),
        };
        let view = scene.view_through("v", lens, pose);
        view.content
            .image()
            .unwrap()
            .save(folder.join(format!("{i}.png")))
            .unwrap();
        let depth = view.content.depth().unwrap().unwrap();
        npy::write(&folder.join(format!("{i}.npy")), &depth).unwrap();
        let world_from_camera = pose.inverse();
        let written = RigidTransform {
            rotation: world_from_camera.rotation * DMat3::from_diagonal(DVec3::from(axes)),
            translation: world_from_camera.translation,
        };
        let rows: Vec<_> = written
            .to_row_major()
            .chunks(4)
            .map(<[f64]>::to_vec)
            .collect();
        frames.push(json!({
            "file_path": format!("{i}.png"),
            "depth_file_path": format!("{i}.npy"),
            "transform_matrix": rows,
        }));
    }
    let file = json!({
        "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy, "w": k.width, "h": k.height,
        "frames": frames,
    });
    std::fs::write(folder.join("transforms.json"), file.to_string()).unwrap();
}

#[test]
fn virtual_views_are_predicted_and_not_scored() {
    let dir = tempfile::tempdir().unwrap();
    let scene = SyntheticScene::new(SyntheticOptions {
        width: 64,
        height: 48,
        views: 2,
        ..SyntheticOptions::default()
    });
    let view = scene.unwrap().views()[0].clone();
    let photograph = dir.path().join("photo.png");
    view.content.image().unwrap().save(&photograph).unwrap();
    let in_folder = |args: &[&str]| sharp_bench(dir.path(), args);
    let dataset = "virtual=photo.png,views=3,step=0.1,focal-px=50";
    let run = ["run", "--dataset", dataset, "--method", "copy"];
    let more = ["--method", "target", "--metrics", "psnr", "--out", "r"];
    // The truth itself does not exist here.
    let said = in_folder(&[&run[..], &more].concat()).ends_with(4);
    holds(&said.out, &["without a photograph to compare with"]);
    let scores = read(dir.path().join("r/scores.csv"));
    let copies: Vec<&str> = scores
        .lines()
        .filter(|line| line.contains(",copy,"))
        .collect();
    assert_eq!(copies.len(), 3, "{scores}");
    assert!(copies.iter().all(|line| line.contains(",ok,,")), "{scores}");
    let figure = ["figure", "extended-motion", "r", "--out", "f"];
    in_folder(&figure).ends_with(0);
    let sheet = read(dir.path().join("f/extended-motion.svg"));
    assert!(
        sheet.contains("0.300") && !sheet.contains("truth"),
        "{sheet:.2000}"
    );
    let check = in_folder(&["datasets", "check", dataset]).ends_with(0);
    assert!(check.out.contains("problems: 0"), "{}", check.out);
    assert!(!check.out.contains("poses"), "{}", check.out);
    let report = ["report", "r", "--out", "page"];
    in_folder(&report).ends_with(0);
}
