//! A scene to bytes.

use super::{GaussianScene, SH_CONSTANT, VERTEX};
use crate::color::srgb_from_linear;

/// Elements of a written file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PlyForm {
    /// As the release writes: camera, size, quantiles of disparity, colour space and version
    /// follow the Gaussians. Some third-party viewers stumble over these.
    #[default]
    Release,
    /// The Gaussians only, with the colour space in a comment.
    Plain,
}

/// Marks files of [`PlyForm::Plain`], whose colours the reader would take for linear otherwise.
pub(super) const SRGB_COMMENT: &str = "color_space srgb";

/// The release's version of the format.
const VERSION: [u8; 3] = [1, 5, 0];

const IDENTITY: [f32; 16] = [
    1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
];

/// The scene as a binary little-endian PLY file.
///
/// Nothing is clamped: an opacity of exactly 1 becomes +∞, of 0 −∞. The disparity quantiles are
/// those of 1/z over all Gaussians where that is a number.
pub fn to_bytes(scene: &GaussianScene, form: PlyForm) -> Vec<u8> {
    let n = scene.gaussians.len();
    let mut out = header(n, form).into_bytes();
    out.reserve(n * 14 * 4 + 256);
    vertices(scene, &mut out);
    if form == PlyForm::Release {
        let camera = scene.intrinsics_or_default();
        put(&mut out, scene.extrinsics.unwrap_or(IDENTITY));
        let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32);
        put(&mut out, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
        for integer in [camera.width, camera.height, 1, n as u32] {
            out.extend(integer.to_le_bytes());
        }
        put(&mut out, disparity_quantiles(scene));
        out.push(0);
        out.extend(VERSION);
    }
    out
}

fn header(n: usize, form: PlyForm) -> String {
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    if form == PlyForm::Plain {
        text += &format!("comment {SRGB_COMMENT}\n");
    }
    text += &format!("element vertex {n}\n");
    for name in VERTEX {
        text += &format!("property float {name}\n");
    }
    if form == PlyForm::Release {
        for (count, scalar, name) in [
            (16, "float", "extrinsic"),
            (9, "float", "intrinsic"),
            (2, "uint", "image_size"),
            (2, "int", "frame"),
            (2, "float", "disparity"),
            (1, "uchar", "color_space"),
            (3, "uchar", "version"),
        ] {
            text += &format!("element {name} {count}\nproperty {scalar} {name}\n");
        }
    }
    text + "end_header\n"
}

fn vertices(scene: &GaussianScene, out: &mut Vec<u8>) {
    let g = &scene.gaussians;
    for k in 0..g.len() {
        put(out, g.means[k]);
        put(
            out,
            g.colors[k].map(|c| (srgb_from_linear(c) - 0.5) / SH_CONSTANT),
        );
        let opacity = g.opacities[k];
        put(out, [(opacity / (1.0 - opacity)).ln()]);
        put(out, g.scales[k].map(f32::ln));
        put(out, g.quaternions[k]);
    }
}

fn put<const N: usize>(out: &mut Vec<u8>, values: [f32; N]) {
    for value in values {
        out.extend(value.to_le_bytes());
    }
}

/// Quantiles 0.1 and 0.9 of 1/z, interpolated between neighbours; 0 for an empty scene.
fn disparity_quantiles(scene: &GaussianScene) -> [f32; 2] {
    let mut disparity: Vec<f32> = scene
        .gaussians
        .means
        .iter()
        .map(|mean| 1.0 / mean[2])
        .filter(|d| !d.is_nan())
        .collect();
    if disparity.is_empty() {
        return [0.0; 2];
    }
    disparity.sort_unstable_by(f32::total_cmp);
    [0.1_f32, 0.9].map(|q| {
        let rank = q * (disparity.len() - 1) as f32;
        let below = rank.floor();
        let low = disparity[below as usize];
        let high = disparity[rank.ceil() as usize];
        low + (high - low) * (rank - below)
    })
}
