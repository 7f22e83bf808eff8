//! The definition in f64: every pixel is compared with every Gaussian, without tiles or
//! optimisations.
//!
//! It follows the textbook (3×3 covariance, its projection, the inverse of the 2×2 matrix), so it
//! shares no formula with the renderer beyond the definition itself.

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use sharp::gaussians::Gaussians;
use sharp::render::{RenderOutput, RenderView};

/// A picture, and the pixels where a threshold is so close that f32 may decide differently.
pub(crate) struct Reference {
    pub(crate) rgb: Vec<[f64; 3]>,
    pub(crate) alpha: Vec<f64>,
    pub(crate) depth_acc: Vec<f64>,
    pub(crate) fragile: Vec<bool>,
}

struct Projected {
    mean: DVec2,
    conic: DMat2,
    opacity: f64,
    z: f32,
    color: DVec3,
}

/// Renders a small scene.
pub(crate) fn render(scene: &Gaussians, view: &RenderView) -> Reference {
    let mut splats: Vec<(usize, Projected)> = (0..scene.len())
        .filter(|k| scene.is_finite(*k))
        .filter_map(|k| Some((k, project(scene, k, view)?)))
        .collect();
    splats.sort_by(|(i, a), (j, b)| a.z.total_cmp(&b.z).then(i.cmp(j)));
    let (width, height) = (view.intrinsics.width, view.intrinsics.height);
    let mut out = Reference {
        rgb: Vec::new(),
        alpha: Vec::new(),
        depth_acc: Vec::new(),
        fragile: Vec::new(),
    };
    for y in 0..height {
        for x in 0..width {
            let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            pixel(&splats, center, &mut out);
        }
    }
    out
}

fn pixel(splats: &[(usize, Projected)], center: DVec2, out: &mut Reference) {
    let (mut rgb, mut depth, mut t, mut fragile) = (DVec3::ZERO, 0.0, 1.0, false);
    let mut moved = 0.0;
    for (_, s) in splats {
        let d = s.mean - center;
        let sigma = 0.5 * d.dot(s.conic * d);
        let alpha = (s.opacity * (-sigma).exp()).min(0.999);
        fragile |= (alpha * 255.0 - 1.0).abs() < 1e-4;
        if sigma < 0.0 || alpha < 1.0 / 255.0 {
            continue;
        }
        // The change caused by rounding the mean within a bin, and the terms of sigma, to f32.
        let gradient = (s.conic * d).abs();
        let terms = 0.5 * (s.conic.x_axis.x * d.x * d.x + s.conic.y_axis.y * d.y * d.y)
            + (s.conic.y_axis.x * d.x * d.y).abs();
        moved += alpha * t * (4e-6 * (gradient.x + gradient.y) + terms * f64::from(f32::EPSILON));
        let left = t * (1.0 - alpha);
        fragile |= (left * 1e4 - 1.0).abs() < 1e-3;
        if left <= 1e-4 {
            break;
        }
        rgb += alpha * t * s.color;
        depth += alpha * t * f64::from(s.z);
        t = left;
    }
    out.rgb.push(rgb.to_array());
    out.alpha.push(1.0 - t);
    out.depth_acc.push(depth);
    out.fragile.push(fragile || moved > 2e-5);
}

fn project(scene: &Gaussians, k: usize, view: &RenderView) -> Option<Projected> {
    let vec3 = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let [w, x, y, z] = scene.quaternions[k].map(f64::from);
    let q = DQuat::from_xyzw(x, y, z, w);
    if q.length() == 0.0 {
        return None;
    }
    let m = DMat3::from_quat(q.normalize()) * DMat3::from_diagonal(vec3(scene.scales[k]));
    let linear = view.camera_from_scene.matrix3;
    let covariance = linear * (m * m.transpose()) * linear.transpose();
    let p = view
        .camera_from_scene
        .transform_point3(vec3(scene.means[k]));
    let depth = p.z as f32;
    if !(depth >= view.rule.near && depth <= view.rule.far) {
        return None;
    }
    let i = view.intrinsics;
    let clamped = |slope: f64, focal: f64, center: f64, size: u32| {
        let size = f64::from(size);
        let margin = 0.3 * 0.5 * size / focal;
        slope.clamp(-(center / focal + margin), (size - center) / focal + margin)
    };
    let sx = clamped(p.x / p.z, i.fx, i.cx, i.width);
    let sy = clamped(p.y / p.z, i.fy, i.cy, i.height);
    // The 2×3 Jacobian, with a third row of zeros.
    let jacobian = DMat3::from_cols(
        DVec3::new(i.fx / p.z, 0.0, 0.0),
        DVec3::new(0.0, i.fy / p.z, 0.0),
        DVec3::new(-i.fx * sx / p.z, -i.fy * sy / p.z, 0.0),
    );
    let c = jacobian * covariance * jacobian.transpose();
    let eps = f64::from(view.rule.low_pass);
    let c = DMat2::from_cols(
        DVec2::new(c.x_axis.x + eps, c.x_axis.y),
        DVec2::new(c.y_axis.x, c.y_axis.y + eps),
    );
    let opacity = f64::from(scene.opacities[k]);
    if c.determinant() <= 0.0 || opacity < f64::from(1.0_f32 / 255.0) {
        return None;
    }
    Some(Projected {
        mean: DVec2::new(i.fx * p.x / p.z + i.cx, i.fy * p.y / p.z + i.cy),
        conic: c.inverse(),
        opacity,
        z: depth,
        color: vec3(scene.colors[k]),
    })
}

impl Reference {
    /// Asserts that pixels that are not fragile differ by at most 2e-5, and the others by at most the effect of one
    /// threshold.
    pub(crate) fn assert_close(&self, found: &RenderOutput, story: &str) {
        assert_eq!(found.alpha.len(), self.alpha.len());
        for i in 0..self.alpha.len() {
            let mut error = (f64::from(found.alpha[i]) - self.alpha[i]).abs();
            for channel in 0..3 {
                let found = f64::from(found.rgb[i][channel]);
                error = error.max((found - self.rgb[i][channel]).abs());
            }
            let bar = if self.fragile[i] { 1.0 / 255.0 } else { 2e-5 };
            assert!(error <= bar, "{story}: pixel {i} is off by {error:e}");
            let depth = (f64::from(found.depth_acc[i]) - self.depth_acc[i]).abs();
            assert!(
                self.fragile[i] || depth <= 1e-4 * self.depth_acc[i],
                "{story}: depth of pixel {i} is off by {depth:e} of {}",
                self.depth_acc[i]
            );
        }
    }

    /// Share of the pixels for which only the wide limit applies; each test states how many it
    /// allows.
    pub(crate) fn fragile_share(&self) -> f64 {
        self.fragile.iter().filter(|f| **f).count() as f64 / self.fragile.len() as f64
    }
}
