//! The forward definition in f64 by textbook formulas, one pixel at a time, and its central
//! differences.

use crate::gaussians::Gaussians;
use crate::render::RenderView;
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};

pub(super) const ATTRIBUTES: usize = 14;

/// Mean, quaternion (w first), scales, opacity, colour.
pub(super) type Attributes = [f64; ATTRIBUTES];

pub(super) fn attributes(scene: &Gaussians, k: usize) -> Attributes {
    let mut out = [0.0; ATTRIBUTES];
    let values = scene.means[k].iter().chain(&scene.quaternions[k]);
    let values = values.chain(&scene.scales[k]).chain([&scene.opacities[k]]);
    for (out, v) in out.iter_mut().zip(values.chain(&scene.colors[k])) {
        *out = f64::from(*v);
    }
    out
}

#[derive(Debug, Clone, Copy)]
pub(super) struct OracleSplat {
    pub(super) mean: DVec2,
    pub(super) covariance: DMat2,
    /// Rows of the projected half covariance, whose products are `covariance`.
    half: [DVec3; 2],
    eps: f64,
    /// Determinant of the covariance with eps, computed without the cancellation that affects
    /// needles.
    determinant: f64,
    pub(super) opacity: f64,
    pub(super) color: DVec3,
    pub(super) z: f64,
}

pub(super) fn splat(view: &RenderView, a: &Attributes) -> OracleSplat {
    let k = view.intrinsics;
    let linear = view.camera_from_scene.matrix3;
    let p = view
        .camera_from_scene
        .transform_point3(DVec3::new(a[0], a[1], a[2]));
    let rotation = DMat3::from_quat(DQuat::from_xyzw(a[4], a[5], a[6], a[3]).normalize());
    let scales = DMat3::from_diagonal(DVec3::new(a[7], a[8], a[9]));
    let half = linear * rotation * scales;
    let clamped = |slope: f64, focal: f64, center: f64, size: u32| {
        let margin = 0.3 * 0.5 * f64::from(size) / focal;
        slope.clamp(
            -center / focal - margin,
            (f64::from(size) - center) / focal + margin,
        )
    };
    let tx = clamped(p.x / p.z, k.fx, k.cx, k.width);
    let ty = clamped(p.y / p.z, k.fy, k.cy, k.height);
    let rows = [
        DVec3::new(k.fx / p.z, 0.0, -k.fx * tx / p.z),
        DVec3::new(0.0, k.fy / p.z, -k.fy * ty / p.z),
    ];
    let [u, v] = rows.map(|row| half.transpose() * row);
    let eps = f64::from(view.rule.low_pass);
    let covariance = DMat2::from_cols_array(&[u.dot(u), u.dot(v), u.dot(v), v.dot(v)]);
    OracleSplat {
        mean: DVec2::new(k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy),
        covariance,
        half: [u, v],
        eps,
        determinant: u.cross(v).length_squared()
            + eps * (u.length_squared() + v.length_squared())
            + eps * eps,
        opacity: a[10],
        color: DVec3::new(a[11], a[12], a[13]),
        z: p.z,
    }
}

impl OracleSplat {
    /// α before the clamp.
    pub(super) fn alpha(&self, at: DVec2) -> f64 {
        let ([u, v], d, eps) = (self.half, self.mean - at, self.eps);
        // dᵀ Σ⁻¹ d by adjugate and determinant.
        let square = (v * d.x - u * d.y).length_squared() + eps * d.length_squared();
        self.opacity * (-0.5 * square / self.determinant).exp()
    }

    /// The smaller standard deviation on the screen, pixels.
    pub(super) fn thickness(&self, eps2d: f32) -> f64 {
        let [a, b, _, c] = self.covariance.to_cols_array();
        let middle = 0.5 * (a + c);
        let lower = middle - (0.25 * (a - c) * (a - c) + b * b).sqrt();
        (lower.max(0.0) + f64::from(eps2d)).sqrt()
    }
}

/// The loss of a pixel, `g · (colour, alpha, depth)`, and a number that encodes all threshold
/// decisions, so that it differs if a single decision does. Splats are given front to back, with
/// their α before the clamp.
pub(super) fn pixel<'a>(
    splats: impl Iterator<Item = (f64, &'a OracleSplat)>,
    g: &[f64; 5],
) -> (f64, u64) {
    let (alpha_min, alpha_max) = (1.0 / 255.0, f64::from(0.999_f32));
    let (mut loss, mut left, mut decisions) = (0.0, 1.0, 0);
    let decide = |so_far: u64, what: u64| so_far.wrapping_mul(5).wrapping_add(what);
    for (alpha, s) in splats {
        if alpha < alpha_min {
            decisions = decide(decisions, 1);
            continue;
        }
        decisions = decide(decisions, if alpha > alpha_max { 3 } else { 2 });
        let alpha = alpha.min(alpha_max);
        let behind = left * (1.0 - alpha);
        if behind <= 1e-4 {
            decisions = decide(decisions, 4);
            break;
        }
        let c = s.color;
        loss += left * alpha * (g[0] * c.x + g[1] * c.y + g[2] * c.z + g[4] * s.z);
        left = behind;
    }
    (loss + g[3] * (1.0 - left), decisions)
}
