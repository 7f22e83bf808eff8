//! The scenes of `golden/render`, and random gradients of their pictures.

use super::super::PictureGradient;
use crate::camera::Intrinsics;
use crate::gaussians::Gaussians;
use crate::random::SplitMix64;
use crate::render::RenderView;
use glam::{DAffine3, DMat3, DMat4};
use safetensors::SafeTensors;

/// A scene of `golden/render` with its view.
pub(super) fn golden(name: &str, eps2d: f32) -> (Gaussians, RenderView) {
    let (scene, view, _) = golden_with_mask(name, eps2d);
    (scene, view)
}

/// Like [`golden`], with the mask of pixels where rounding to f32 may change a decision: skipped,
/// clamped, stopped.
pub(super) fn golden_with_mask(name: &str, eps2d: f32) -> (Gaussians, RenderView, Vec<bool>) {
    let path = format!(
        "{}/../tests/golden/render/{name}.safetensors",
        env!("CARGO_MANIFEST_DIR")
    );
    let bytes = std::fs::read(path).unwrap();
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let meta = header.metadata().clone().unwrap();
    let size = |key: &str| meta[key].parse::<u32>().unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let floats = |key: &str| -> Vec<f32> {
        let (values, _) = file.tensor(key).unwrap().data().as_chunks::<4>();
        values.iter().map(|v| f32::from_le_bytes(*v)).collect()
    };
    fn rows<const D: usize>(values: &[f32]) -> Vec<[f32; D]> {
        values.as_chunks::<D>().0.to_vec()
    }
    let scene = Gaussians::new(
        rows(&floats("means")),
        rows(&floats("quats_wxyz")),
        rows(&floats("scales")),
        floats("opacities"),
        rows(&floats("colors_linear")),
    )
    .unwrap();
    let matrix = |key: &str| {
        let m: Vec<f64> = floats(key).iter().map(|v| f64::from(*v)).collect();
        DMat4::from_cols_slice(&m).transpose()
    };
    let (k, camera_from_scene) = if file.tensor("K_tgt").is_ok() {
        let placed = matrix("E_tgt") * matrix("E_src").inverse() * matrix("K_src").inverse();
        (DMat3::from_mat4(matrix("K_tgt")), placed)
    } else {
        let k: Vec<f64> = floats("K").iter().map(|v| f64::from(*v)).collect();
        (DMat3::from_cols_slice(&k).transpose(), matrix("viewmat"))
    };
    let focal = (k.x_axis.x, k.y_axis.y);
    let center = (k.z_axis.x, k.z_axis.y);
    let intrinsics = Intrinsics::new(focal, center, (size("width"), size("height"))).unwrap();
    let view = RenderView::new(DAffine3::from_mat4(camera_from_scene), intrinsics);
    let mask = [format!("fragile.eps{eps2d}"), "fragile".to_owned()];
    let fragile = mask.iter().find_map(|key| file.tensor(key).ok()).unwrap();
    let fragile = fragile.data().iter().map(|v| *v != 0).collect();
    (scene, view.with_low_pass(eps2d), fragile)
}

/// A random gradient of a picture.
pub(super) struct Gradient {
    pub(super) width: usize,
    pub(super) rgb: Vec<[f32; 3]>,
    pub(super) alpha: Vec<f32>,
    depth: Vec<f32>,
}

impl Gradient {
    pub(super) fn random(view: &RenderView, seed: u64) -> Self {
        let (width, height) = (
            view.intrinsics.width as usize,
            view.intrinsics.height as usize,
        );
        let mut random = SplitMix64::new(seed);
        let mut value = |_: usize| random.between(-1.0, 1.0) as f32;
        let pixels = 0..width * height;
        Self {
            width,
            rgb: pixels.clone().map(|_| [0, 1, 2].map(&mut value)).collect(),
            alpha: pixels.clone().map(&mut value).collect(),
            depth: pixels.map(&mut value).collect(),
        }
    }

    pub(super) fn without(mut self, pixels: &[bool]) -> Self {
        for at in (0..pixels.len()).filter(|at| pixels[*at]) {
            (self.rgb[at], self.alpha[at], self.depth[at]) = ([0.0; 3], 0.0, 0.0);
        }
        self
    }

    pub(super) fn view(&self) -> PictureGradient<'_> {
        PictureGradient {
            width: self.width,
            rgb_linear: &self.rgb,
            alpha: &self.alpha,
            depth_acc: &self.depth,
        }
    }

    pub(super) fn pixel(&self, at: usize) -> [f64; 5] {
        let [r, g, b] = self.rgb[at];
        [r, g, b, self.alpha[at], self.depth[at]].map(f64::from)
    }
}
