//! Writes views in the formats of datasets.

use std::fmt::Write as _;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use sharp::camera::RigidTransform;
use sharp_datasets::format::FloatMap;
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::{DepthMap, View};

pub(crate) fn text(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

pub(crate) fn bytes(folder: &Path, name: &str, bytes: &[u8]) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// Writes a photograph as PNG, whatever its name.
pub(crate) fn picture(folder: &Path, name: &str, view: &View) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let image = view.content.image().unwrap();
    image
        .save_with_format(path, image::ImageFormat::Png)
        .unwrap();
}

pub(crate) fn depth_of(view: &View) -> DepthMap {
    view.content.depth().unwrap().unwrap()
}

pub(crate) fn millimetres(depth: &DepthMap) -> FloatMap {
    FloatMap::from_fn(depth.width(), depth.height(), |x, y| {
        image::Luma([depth.get_pixel(x, y).0[0] * 1000.0])
    })
}

/// `x y z …` with all digits.
pub(crate) fn row(values: impl IntoIterator<Item = f64>) -> String {
    let words: Vec<_> = values.into_iter().map(|v| format!("{v:?}")).collect();
    words.join(" ")
}

/// COLMAP's quaternion w, x, y, z.
pub(crate) fn quaternion(rotation: DMat3) -> [f64; 4] {
    let q = DQuat::from_mat3(&rotation).normalize();
    [q.w, q.x, q.y, q.z]
}

/// COLMAP's model name and parameters.
pub(crate) fn colmap_camera(lens: &Lens) -> (&'static str, Vec<f64>) {
    let k = lens.intrinsics();
    let mut params = vec![k.fx, k.fy, k.cx, k.cy];
    let model = match lens.distortion() {
        Distortion::None => "PINHOLE",
        Distortion::OpenCvFisheye { k } => {
            params.extend(k);
            "OPENCV_FISHEYE"
        }
        Distortion::ThinPrismFisheye { k, p, s } => {
            params.extend([k[0], k[1], p[0], p[1], k[2], k[3], s[0], s[1]]);
            "THIN_PRISM_FISHEYE"
        }
        other => panic!("{other:?} is not written"),
    };
    (model, params)
}

pub(crate) fn lens_of(view: &View) -> Lens {
    let k = view.intrinsics;
    Lens::new(
        (k.fx, k.fy),
        (k.cx, k.cy),
        (k.width, k.height),
        Distortion::None,
    )
    .unwrap()
}

/// `cameras.txt` with one camera (id 0) and `images.txt` in reverse order with ids 10, 20, ….
pub(crate) fn colmap_text(folder: &Path, lens: &Lens, images: &[(String, RigidTransform)]) {
    let (model, params) = colmap_camera(lens);
    let k = lens.intrinsics();
    text(
        folder,
        "cameras.txt",
        &format!(
            "# cameras\n0 {model} {} {} {}\n",
            k.width,
            k.height,
            row(params)
        ),
    );
    let mut list = String::from("# images\n");
    for (i, (name, pose)) in images.iter().enumerate().rev() {
        let id = 10 * (i + 1);
        let numbers = quaternion(pose.rotation)
            .into_iter()
            .chain(pose.translation.to_array());
        writeln!(list, "{id} {} 0 {name}\n", row(numbers)).unwrap();
    }
    text(folder, "images.txt", &list);
}

/// Like [`colmap_text`], in COLMAP's binary form.
pub(crate) fn colmap_binary(folder: &Path, lens: &Lens, images: &[(String, RigidTransform)]) {
    let (model, params) = colmap_camera(lens);
    let id = match model {
        "PINHOLE" => 1_i32,
        "OPENCV_FISHEYE" => 5,
        _ => 10,
    };
    let k = lens.intrinsics();
    let mut b = 1_u64.to_le_bytes().to_vec();
    b.extend(0_u32.to_le_bytes());
    b.extend(id.to_le_bytes());
    b.extend(u64::from(k.width).to_le_bytes());
    b.extend(u64::from(k.height).to_le_bytes());
    b.extend(params.iter().flat_map(|p| p.to_le_bytes()));
    bytes(folder, "cameras.bin", &b);
    let mut b = (images.len() as u64).to_le_bytes().to_vec();
    for (i, (name, pose)) in images.iter().enumerate() {
        b.extend((10 * (i as u32 + 1)).to_le_bytes());
        let numbers = quaternion(pose.rotation)
            .into_iter()
            .chain(pose.translation.to_array());
        b.extend(numbers.flat_map(f64::to_le_bytes));
        b.extend(0_u32.to_le_bytes());
        b.extend(name.as_bytes());
        b.push(0);
        b.extend(1_u64.to_le_bytes());
        b.extend([0; 24]);
    }
    bytes(folder, "images.bin", &b);
}

/// Rows of a camera-to-world matrix in OpenGL's axes, as nested JSON lists.
pub(crate) fn opengl_rows(camera_from_world: &RigidTransform) -> String {
    let pose = camera_from_world.inverse();
    let flipped = RigidTransform {
        rotation: pose.rotation * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
        translation: pose.translation,
    };
    let rows: Vec<_> = flipped
        .to_row_major()
        .chunks(4)
        .map(|r| format!("[{:?}, {:?}, {:?}, {:?}]", r[0], r[1], r[2], r[3]))
        .collect();
    format!("[{}]", rows.join(", "))
}

/// World points of every pixel with depth.
pub(crate) fn points(view: &View) -> Vec<DVec3> {
    let world_from_camera = view.camera_from_world.inverse();
    depth_of(view)
        .enumerate_pixels()
        .filter(|(_, _, z)| z.0[0] > 0.0)
        .map(|(x, y, z)| {
            let center = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let point = view.intrinsics.unproject(center, f64::from(z.0[0]));
            world_from_camera.apply(point)
        })
        .collect()
}

/// A binary PLY of points.
pub(crate) fn ply(folder: &Path, name: &str, points: &[DVec3]) {
    let mut b = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\n\
         property double y\nproperty double z\nproperty uchar red\nend_header\n",
        points.len()
    )
    .into_bytes();
    for p in points {
        b.extend(p.to_array().iter().flat_map(|v| v.to_le_bytes()));
        b.push(128);
    }
    bytes(folder, name, &b);
}
