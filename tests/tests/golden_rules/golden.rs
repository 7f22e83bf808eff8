//! Scenes with their cameras and pictures.

use glam::{DAffine3, DMat4};
use safetensors::SafeTensors;
use sharp::camera::Intrinsics;
use sharp::gaussians::{Gaussians, Harmonics};
use sharp::render::{Background, RenderOutput, RenderView, Rule};
use std::path::{Path, PathBuf};

/// Scenes with the tolerances for pixels that are not fragile, on the CPU and on a GPU. The CPU's
/// are those of the golden data's README; a GPU's are four times those, or twice for
/// `g6_degenerate`.
pub(crate) const SCENES: [(&str, f32, f32); 7] = [
    ("g1_sh0", 5e-6, 2e-5),
    ("g2_sh1_world", 5e-6, 2e-5),
    ("g3_sh2_pp", 5e-6, 2e-5),
    ("g4_sh3_rules", 5e-6, 2e-5),
    ("g5_sh4", 5e-6, 2e-5),
    ("g6_degenerate", 5e-5, 1e-4),
    ("g7_opaque", 5e-6, 2e-5),
];

/// The constant harmonic.
pub(crate) const SH_CONSTANT: f32 = 0.282_094_8;

pub(crate) struct Picture {
    /// `{rule}.cam{i}`.
    pub(crate) title: String,
    pub(crate) view: RenderView,
    rgb: Vec<f32>,
    alpha: Vec<f32>,
    depth_acc: Option<Vec<f32>>,
    fragile: Vec<u8>,
}

pub(crate) struct Golden {
    pub(crate) scene: Gaussians,
    pub(crate) background: Background,
    pub(crate) pictures: Vec<Picture>,
}

/// Largest deviations from a picture.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Deviation {
    /// Colour and alpha of pixels that are not fragile.
    pub(crate) firm: f32,
    /// Colour and alpha of fragile pixels.
    pub(crate) fragile: f32,
    /// Accumulated depth of pixels that are not fragile; relative above a metre.
    pub(crate) depth: f32,
    /// Colour of pixels that are not fragile.
    pub(crate) color: f32,
}

pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/render3dgs")
}

impl Golden {
    pub(crate) fn load(name: &str) -> Self {
        let path = folder().join(name).with_extension("safetensors");
        let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let meta = header.metadata().clone().unwrap();
        let json = |key: &str| serde_json::from_str::<serde_json::Value>(&meta[key]).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let find = |key: &str| Some(file.tensor(key).ok()?.data().to_vec());
        let floats = |key: &str| -> Option<Vec<f32>> {
            let data = find(key)?;
            let words = data.as_chunks::<4>().0.iter();
            Some(words.map(|b| f32::from_le_bytes(*b)).collect())
        };
        let rows = |key: &str| floats(key).unwrap();
        let sh = rows("sh").as_chunks::<3>().0.to_vec();
        let each = file.tensor("sh").unwrap().shape()[1];
        let scene = Gaussians {
            means: rows("means").as_chunks().0.to_vec(),
            quaternions: rows("quats_wxyz").as_chunks().0.to_vec(),
            scales: rows("scales").as_chunks().0.to_vec(),
            opacities: rows("opacities"),
            colors: sh
                .chunks(each)
                .map(|c| c[0].map(|v| 0.5 + SH_CONSTANT * v))
                .collect(),
            harmonics: Harmonics {
                degree: each.isqrt() - 1,
                coefficients: sh.chunks(each).flat_map(|c| c[1..].to_vec()).collect(),
            },
        };
        let mut pictures = Vec::new();
        for (i, size) in json("cameras").as_array().unwrap().iter().enumerate() {
            let k = rows(&format!("cam{i}.K"));
            let m: Vec<f64> = rows(&format!("cam{i}.viewmat"))
                .iter()
                .map(|v| f64::from(*v))
                .collect();
            let camera = DAffine3::from_mat4(DMat4::from_cols_slice(&m).transpose());
            let pair = |x: usize, y: usize| (f64::from(k[x]), f64::from(k[y]));
            let side = |key: &str| size[key].as_u64().unwrap() as u32;
            let size = (side("width"), side("height"));
            let intrinsics = Intrinsics::new(pair(0, 4), pair(2, 5), size).unwrap();
            for (name, rule) in Rule::NAMED {
                let title = format!("{name}.cam{i}");
                let Some(rgb) = floats(&format!("rgb.{title}")) else {
                    continue;
                };
                pictures.push(Picture {
                    view: RenderView {
                        rule,
                        ..RenderView::new(camera, intrinsics)
                    },
                    rgb,
                    alpha: rows(&format!("alpha.{title}")),
                    depth_acc: floats(&format!("depth_acc.{title}")),
                    fragile: find(&format!("fragile.{title}")).unwrap(),
                    title,
                });
            }
        }
        let of_file = file
            .names()
            .iter()
            .filter(|n| n.starts_with("rgb."))
            .count();
        assert_eq!(pictures.len(), of_file, "{name} has a rule without a name");
        Self {
            scene,
            background: meta["background"].parse().unwrap(),
            pictures,
        }
    }

    /// Compares blended values over the background.
    pub(crate) fn deviation(&self, title: &str, found: &RenderOutput) -> Deviation {
        let blended = found.composited(self.background);
        self.deviation_of(title, found, blended.as_raw())
    }

    /// Compares any colours.
    pub(crate) fn deviation_of(&self, title: &str, found: &RenderOutput, rgb: &[f32]) -> Deviation {
        let golden = self.pictures.iter().find(|p| p.title == title).unwrap();
        assert_eq!(golden.rgb.len(), rgb.len());
        let mut worst = Deviation::default();
        for i in 0..golden.alpha.len() {
            let mut color = 0.0;
            for at in 3 * i..3 * i + 3 {
                color = larger(color, (rgb[at] - golden.rgb[at]).abs());
            }
            let value = larger(color, (found.alpha[i] - golden.alpha[i]).abs());
            if golden.fragile[i] != 0 {
                worst.fragile = larger(worst.fragile, value);
                continue;
            }
            worst.firm = larger(worst.firm, value);
            worst.color = larger(worst.color, color);
            if let Some(depth) = &golden.depth_acc {
                let off = (found.depth_acc[i] - depth[i]).abs() / depth[i].max(1.0);
                worst.depth = larger(worst.depth, off);
            }
        }
        worst
    }
}

/// Like `f32::max`, but NaN is not ignored.
fn larger(a: f32, b: f32) -> f32 {
    if a >= b { a } else { b }
}
