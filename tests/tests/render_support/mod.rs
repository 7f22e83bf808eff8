//! The scenes of `golden/render`, the two criteria for judging a backend, an f64 reference, and
//! seeded scenes.

#![allow(dead_code, reason = "each test binary uses its part")]

pub(crate) mod drops;
pub(crate) mod random;
pub(crate) mod reference;

use glam::{DAffine3, DMat3, DMat4};
use safetensors::{Dtype, SafeTensors};
use sharp::camera::Intrinsics;
use sharp::gaussians::Gaussians;
use sharp::render::{RenderOutput, RenderView};
use std::path::Path;

/// A scene with an `eps2d`, and its picture by the f64 oracle.
pub(crate) struct Golden {
    pub(crate) scene: Gaussians,
    pub(crate) view: RenderView,
    pub(crate) rgb: Vec<[f32; 3]>,
    pub(crate) alpha: Vec<f32>,
    pub(crate) depth_acc: Vec<f32>,
    /// Pixels that change by more than 2e-5 under a perturbation of the size of f32's rounding.
    pub(crate) fragile: Vec<bool>,
}

/// Every scene and `eps2d` of the folder: (file, suffix of its tensors, eps2d).
pub(crate) const CASES: [(&str, &str, f32); 12] = [
    ("s1_one", ".eps0", 0.0),
    ("s1_one", ".eps0.01", 0.01),
    ("s1_one", ".eps0.3", 0.3),
    ("s2_two", ".eps0", 0.0),
    ("s2_two", ".eps0.3", 0.3),
    ("s3_five", "", 0.0),
    ("s4_rand2k", ".eps0", 0.0),
    ("s4_rand2k", ".eps0.01", 0.01),
    ("s4_rand2k", ".eps0.3", 0.3),
    ("s5_degenerate20k", "", 0.0),
    ("s6_sharp_P", ".eps0", 0.0),
    ("s6_sharp_P", ".eps0.01", 0.01),
];

impl Golden {
    pub(crate) fn load(name: &str, suffix: &str, eps2d: f32) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("golden/render")
            .join(name)
            .with_extension("safetensors");
        let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let meta = header.metadata().clone().unwrap();
        let size = |key: &str| meta[key].parse::<u32>().unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let floats = |key: &str| floats(&file, key);
        let image = |key: &str| floats(&format!("{key}{suffix}"));
        let scene = Gaussians::new(
            rows(&floats("means")),
            rows(&floats("quats_wxyz")),
            rows(&floats("scales")),
            floats("opacities"),
            rows(&floats("colors_linear")),
        )
        .unwrap();
        let matrix4 = |key: &str| {
            let m: Vec<f64> = floats(key).iter().map(|v| f64::from(*v)).collect();
            DMat4::from_cols_slice(&m).transpose()
        };
        // s6 is in the normalised space of its source photograph.
        let (k, camera_from_scene) = if file.tensor("K_tgt").is_ok() {
            let placed = matrix4("E_tgt") * matrix4("E_src").inverse() * matrix4("K_src").inverse();
            (DMat3::from_mat4(matrix4("K_tgt")), placed)
        } else {
            let k: Vec<f64> = floats("K").iter().map(|v| f64::from(*v)).collect();
            (DMat3::from_cols_slice(&k).transpose(), matrix4("viewmat"))
        };
        let intrinsics = Intrinsics::new(
            (k.x_axis.x, k.y_axis.y),
            (k.z_axis.x, k.z_axis.y),
            (size("width"), size("height")),
        )
        .unwrap();
        let fragile = file.tensor(&format!("fragile{suffix}")).unwrap();
        Self {
            scene,
            view: RenderView::new(DAffine3::from_mat4(camera_from_scene), intrinsics)
                .with_low_pass(eps2d),
            rgb: rows(&image("rgb_linear")),
            alpha: image("alpha"),
            depth_acc: image("depth_acc"),
            fragile: fragile.data().iter().map(|v| *v != 0).collect(),
        }
    }

    /// Deviation of a picture from the oracle's.
    pub(crate) fn deviation(&self, found: &RenderOutput) -> Deviation {
        assert_eq!(found.alpha.len(), self.alpha.len());
        let mut worst = Deviation::default();
        for i in 0..self.alpha.len() {
            let mut value = (found.alpha[i] - self.alpha[i]).abs();
            for channel in 0..3 {
                let error = (found.rgb[i][channel] - self.rgb[i][channel]).abs();
                value = larger(value, error);
            }
            worst.any = larger(worst.any, value);
            if !self.fragile[i] {
                worst.firm = larger(worst.firm, value);
                let error = (found.depth_acc[i] - self.depth_acc[i]).abs();
                if error != 0.0 {
                    worst.depth = larger(worst.depth, error / self.depth_acc[i].abs());
                }
            }
        }
        worst
    }
}

/// Only the first of the Gaussians that have the same depth in this view.
pub(crate) fn without_ties(scene: &Gaussians, view: &RenderView) -> Gaussians {
    let m = view.camera_from_scene;
    let mut seen = std::collections::HashSet::new();
    scene.filtered(|k| {
        let mean = glam::DVec3::from_array(scene.means[k].map(f64::from));
        seen.insert((m.transform_point3(mean).z as f32).to_bits())
    })
}

/// The same Gaussians in another order.
pub(crate) fn shuffled(scene: &Gaussians) -> Gaussians {
    let n = scene.len();
    // A step that shares no factor with n visits every index once.
    let step = (n / 3..).find(|s| gcd(*s, n) == 1).unwrap();
    let order: Vec<usize> = (0..n).map(|k| (k * step + 7) % n).collect();
    scene.subset(&order)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Like `f32::max`, but NaN is not ignored.
fn larger(a: f32, b: f32) -> f32 {
    if a >= b { a } else { b }
}

/// Largest deviations of a picture from the oracle's.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Deviation {
    /// Colour and alpha of pixels that are not fragile.
    pub(crate) firm: f32,
    /// Colour and alpha of all pixels.
    pub(crate) any: f32,
    /// Relative accumulated depth of pixels that are not fragile.
    pub(crate) depth: f32,
}

impl Deviation {
    /// 2e-5 for all pixels that are not fragile, 1/255 for all pixels, 1e-4 for depth.
    pub(crate) fn is_within_bars(self) -> bool {
        self.firm <= 2e-5 && self.any <= 1.0 / 255.0 && self.depth <= 1e-4
    }
}

fn floats(file: &SafeTensors<'_>, key: &str) -> Vec<f32> {
    let tensor = file.tensor(key).unwrap_or_else(|e| panic!("{key}: {e}"));
    assert_eq!(tensor.dtype(), Dtype::F32, "{key}");
    tensor
        .data()
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect()
}

fn rows<const D: usize>(values: &[f32]) -> Vec<[f32; D]> {
    values.as_chunks::<D>().0.to_vec()
}
