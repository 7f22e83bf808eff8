//! Camera models compared with OpenCV's own numbers (`tests/golden/geometry`). In the golden data,
//! the centre of pixel (i, j) is at (i, j), so its principal points are used unchanged.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

use std::path::Path;

use glam::{DVec2, DVec3};
use safetensors::SafeTensors;
use serde_json::Value;
use sharp_datasets::lens::Lens;

struct Golden {
    json: Value,
    tensors: Vec<u8>,
}

impl Golden {
    fn load() -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/geometry");
        let text = std::fs::read_to_string(folder.join("geometry.json")).unwrap();
        Self {
            json: serde_json::from_str(&text).unwrap(),
            tensors: std::fs::read(folder.join("geometry.safetensors")).unwrap(),
        }
    }

    fn numbers(&self, key: &str) -> Vec<f64> {
        let list = self.json["distortion"][key].as_array().unwrap();
        list.iter().map(|v| v.as_f64().unwrap()).collect()
    }

    fn rows<const N: usize>(&self, name: &str) -> Vec<[f64; N]> {
        let file = SafeTensors::deserialize(&self.tensors).unwrap();
        let bytes = file.tensor(name).unwrap().data().to_vec();
        let values: Vec<f64> = bytes
            .chunks_exact(8)
            .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
            .collect();
        values
            .chunks_exact(N)
            .map(|row| row.try_into().unwrap())
            .collect()
    }

    fn lens(&self, model: &str, coefficients: &[f64]) -> Lens {
        let k = &self.json["distortion"]["K"];
        let at = |i: usize, j: usize| k[i][j].as_f64().unwrap();
        let mut params = vec![at(0, 0), at(1, 1), at(0, 2), at(1, 2)];
        params.extend(coefficients);
        Lens::from_colmap(model, (1752, 1168), &params).unwrap()
    }

    /// Checks that every point is projected to within 1e-9 px of OpenCV's result.
    fn check_forward(&self, lens: &Lens, expected: &str) {
        let points = self.rows::<3>("dist_points_cam_f64");
        let places = self.rows::<2>(expected);
        assert_eq!(points.len(), 40);
        for (i, (point, place)) in points.iter().zip(&places).enumerate() {
            let found = lens.project(DVec3::from(*point)).unwrap();
            let error = (found - DVec2::from(*place)).length();
            assert!(error <= 1e-9, "row {i}: {error:e}");
        }
    }

    /// Checks that pixels return to their normalised coordinates, and to OpenCV's if it recorded
    /// them.
    fn check_inverse(&self, lens: &Lens, name: &str, skipped: &[usize], tolerance: f64) {
        let points = self.rows::<3>("dist_points_cam_f64");
        let places = self.rows::<2>(&format!("dist_uv_{name}"));
        let opencv = self.rows::<2>(&format!("undist_norm_{name}"));
        for i in (0..points.len()).filter(|i| !skipped.contains(i)) {
            let ray = lens.unproject(DVec2::from(places[i])).unwrap();
            let truth = DVec3::from(points[i]) / points[i][2];
            let error = (ray - truth).length();
            assert!(error <= tolerance, "row {i}: {error:e} from the truth");
            let error = (ray.truncate() - DVec2::from(opencv[i])).length();
            assert!(error <= tolerance, "row {i}: {error:e} from OpenCV");
        }
    }
}

#[test]
fn pinhole_forward() {
    let golden = Golden::load();
    golden.check_forward(&golden.lens("PINHOLE", &[]), "dist_uv_pinhole");
}

#[test]
fn opencv_forward() {
    let golden = Golden::load();
    let lens = golden.lens("OPENCV", &golden.numbers("opencv_k1k2p1p2"));
    golden.check_forward(&lens, "dist_uv_opencv");
}

#[test]
fn full_opencv_forward() {
    let golden = Golden::load();
    let coefficients = golden.numbers("full_opencv_k1k2p1p2k3k4k5k6");
    golden.check_forward(
        &golden.lens("FULL_OPENCV", &coefficients),
        "dist_uv_full_opencv",
    );
}

#[test]
fn fisheye_forward() {
    let golden = Golden::load();
    let lens = golden.lens("OPENCV_FISHEYE", &golden.numbers("fisheye_k1..k4"));
    golden.check_forward(&lens, "dist_uv_fisheye");
}

#[test]
fn thin_prism_without_its_other_terms_is_the_fisheye() {
    let golden = Golden::load();
    let k = golden.numbers("fisheye_k1..k4");
    let params = [k[0], k[1], 0.0, 0.0, k[2], k[3], 0.0, 0.0];
    golden.check_forward(
        &golden.lens("THIN_PRISM_FISHEYE", &params),
        "dist_uv_fisheye",
    );
}

#[test]
fn fisheye_inverse() {
    let golden = Golden::load();
    let lens = golden.lens("OPENCV_FISHEYE", &golden.numbers("fisheye_k1..k4"));
    golden.check_inverse(&lens, "fisheye", &[], 1e-9);
}

/// In rows 2, 12, 33 and 37 (r ≥ 1.44), the polynomial cannot be inverted reliably.
#[test]
fn opencv_inverse() {
    let golden = Golden::load();
    let lens = golden.lens("OPENCV", &golden.numbers("opencv_k1k2p1p2"));
    golden.check_inverse(&lens, "opencv", &[2, 12, 33, 37], 1e-7);
}
