//! A user's own pictures: a small dataset with `transforms.json`.

use std::path::Path;

use glam::{DMat3, DVec3};
use serde_json::json;
use sharp::camera::RigidTransform;
use sharp_datasets::format::npy;
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::synthetic::{SyntheticOptions, SyntheticScene};

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
