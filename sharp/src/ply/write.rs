//! Encoding of a scene as PLY.

use super::marks::{Generator, SplatRenderMode};
use super::{ColorSpace, GaussianScene, SH_CONSTANT, VERTEX};
use crate::color::srgb_from_linear;

/// Layout of a written file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PlyForm {
    /// As in the SHARP release: the Gaussians are followed by camera, size, quantiles of disparity,
    /// colour space and version. Some third-party viewers fail on these additions. View-dependent
    /// colour cannot be stored.
    #[default]
    Release,
    /// Only the Gaussians, in the layout of 3D Gaussian Splatting. The colour space of SHARP's scenes is stored in a
    /// comment, as are any marks of other programs.
    Plain,
}

/// Marks files of [`PlyForm::Plain`], whose colours the reader would otherwise assume to be linear.
pub(super) const SRGB_COMMENT: &str = "color_space srgb";

/// The SHARP release's version of the format.
const VERSION: [u8; 3] = [1, 5, 0];

const IDENTITY: [f32; 16] = [
    1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
];

/// Encodes the scene as a binary little-endian PLY file.
///
/// Nothing is clamped: an opacity of exactly 1 becomes +∞, an opacity of 0 becomes −∞. The disparity quantiles are
/// computed over all Gaussians for which 1/z is a number.
pub fn to_bytes(scene: &GaussianScene, form: PlyForm) -> Vec<u8> {
    let n = scene.gaussians.len();
    let mut out = header(scene, form).into_bytes();
    out.reserve(n * (17 + coefficients(scene, form)) * 4 + 256);
    vertices(scene, form, &mut out);
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

fn header(scene: &GaussianScene, form: PlyForm) -> String {
    let n = scene.gaussians.len();
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    if form == PlyForm::Plain {
        for comment in comments(scene) {
            text += &format!("comment {comment}\n");
        }
    }
    text += &format!("element vertex {n}\n");
    let has_normals = has_normals(scene, form);
    let rest = (0..coefficients(scene, form)).map(|k| format!("f_rest_{k}"));
    let rest: Vec<String> = rest.collect();
    let [position, colors, others] = [&VERTEX[..3], &VERTEX[3..6], &VERTEX[6..]];
    let normals: &[&str] = if has_normals {
        &["nx", "ny", "nz"]
    } else {
        &[]
    };
    let names = position.iter().chain(normals).chain(colors).copied();
    let names = names.chain(rest.iter().map(String::as_str));
    for name in names.chain(others.iter().copied()) {
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

/// Comments that preserve a file's marks, so that the written file is rendered like the original.
pub(super) fn comments(scene: &GaussianScene) -> Vec<&'static str> {
    let marks = &scene.marks;
    let generator = match marks.generator {
        Some(Generator::Sharp) => Some(SRGB_COMMENT),
        Some(Generator::Brush) => Some("Exported from Brush"),
        _ => None,
    };
    let mode = match (marks.mode, marks.antialiased) {
        (Some(SplatRenderMode::Flat), _) => Some("SplatRenderMode: 2dgs"),
        (_, Some(true)) => Some("SplatRenderMode: mip"),
        (_, Some(false)) => Some("SplatRenderMode: default"),
        (_, None) => None,
    };
    generator.into_iter().chain(mode).collect()
}

/// True if normals are written: files of Inria's program have normals, files of gsplat do not.
fn has_normals(scene: &GaussianScene, form: PlyForm) -> bool {
    form == PlyForm::Plain && scene.marks.generator == Some(Generator::InriaLike)
}

/// Number of `f_rest_*` properties in the written file.
fn coefficients(scene: &GaussianScene, form: PlyForm) -> usize {
    match form {
        PlyForm::Plain => 3 * scene.gaussians.harmonics.per_gaussian(),
        PlyForm::Release => 0,
    }
}

/// sRGB-encoded value of a colour channel in the `blending` colour space.
pub(crate) fn srgb(color: f32, blending: ColorSpace) -> f32 {
    match blending {
        ColorSpace::Linear => srgb_from_linear(color),
        ColorSpace::Srgb => color,
    }
}

fn vertices(scene: &GaussianScene, form: PlyForm, out: &mut Vec<u8>) {
    let g = &scene.gaussians;
    let has_normals = has_normals(scene, form);
    let has_rest = coefficients(scene, form) > 0;
    for k in 0..g.len() {
        put(out, g.means[k]);
        if has_normals {
            put(out, [0.0; 3]);
        }
        let stored = |c| (srgb(c, scene.reading.blending) - 0.5) / SH_CONSTANT;
        put(out, g.colors[k].map(stored));
        for channel in (0..3).filter(|_| has_rest) {
            for coefficient in g.harmonics.of(k) {
                put(out, [coefficient[channel]]);
            }
        }
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
