//! Pass `harmonics`: view-dependent colours of the Gaussians.
//!
//! `max(0, c0 + Σ Y_k(d) c_k)`, where d is the direction from the camera's centre to the Gaussian's, in the coordinate
//! system of the means. The basis is real, with Condon–Shortley signs, in the order k = l² + l + m.

use super::RenderView;
use crate::gaussians::Gaussians;
use crate::ply::ColorSpace;

/// Viewpoint and degree for evaluating the harmonics.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewColors {
    /// Camera centre in the coordinate system of the means.
    pub(super) eye: [f64; 3],
    /// Degree to evaluate; at most the degree of the scene.
    pub(super) degree: usize,
}

impl ViewColors {
    /// Prepares the evaluation for a view; `None` if the scene's colours are drawn unchanged.
    pub(super) fn new(scene_degree: usize, view: &RenderView) -> Option<Self> {
        let degree = scene_degree.min(view.rule.degree);
        (degree > 0 || view.rule.blending == ColorSpace::Srgb).then(|| Self {
            eye: view.camera_from_scene.inverse().translation.to_array(),
            degree,
        })
    }

    #[inline(always)]
    pub(super) fn color(&self, scene: &Gaussians, k: usize) -> [f32; 3] {
        let mut color = scene.colors[k];
        if self.degree > 0 {
            let mean = scene.means[k];
            let to = [0, 1, 2].map(|c: usize| f64::from(mean[c]) - self.eye[c]);
            let length = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt();
            let direction = to.map(|v| (v / length) as f32);
            let coefficients = scene.harmonics.of(k);
            add(&mut color, &band_1(direction), &coefficients[..3]);
            if self.degree > 1 {
                add(&mut color, &band_2(direction), &coefficients[3..8]);
            }
            if self.degree > 2 {
                add(&mut color, &band_3(direction), &coefficients[8..15]);
            }
            if self.degree > 3 {
                add(&mut color, &band_4(direction), &coefficients[15..24]);
            }
        }
        color.map(|v| v.max(0.0))
    }
}

#[inline(always)]
fn add<const N: usize>(color: &mut [f32; 3], basis: &[f32; N], coefficients: &[[f32; 3]]) {
    for (y, coefficient) in basis.iter().zip(coefficients) {
        for c in 0..3 {
            color[c] += y * coefficient[c];
        }
    }
}

#[inline(always)]
fn band_1([x, y, z]: [f32; 3]) -> [f32; 3] {
    const C: f32 = 0.488_602_52;
    [-C * y, C * z, -C * x]
}

#[inline(always)]
fn band_2([x, y, z]: [f32; 3]) -> [f32; 5] {
    const C: f32 = 1.092_548_5;
    [
        C * x * y,
        -C * y * z,
        0.315_391_57 * (2.0 * z * z - x * x - y * y),
        -C * x * z,
        0.546_274_24 * (x * x - y * y),
    ]
}

#[inline(always)]
fn band_3([x, y, z]: [f32; 3]) -> [f32; 7] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        -0.590_043_6 * y * (3.0 * xx - yy),
        2.890_611_4 * x * y * z,
        -0.457_045_8 * y * (4.0 * zz - xx - yy),
        0.373_176_34 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_8 * x * (4.0 * zz - xx - yy),
        1.445_305_7 * z * (xx - yy),
        -0.590_043_6 * x * (xx - 3.0 * yy),
    ]
}

#[inline(always)]
fn band_4([x, y, z]: [f32; 3]) -> [f32; 9] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        2.503_342_9 * x * y * (xx - yy),
        -1.770_130_8 * y * z * (3.0 * xx - yy),
        0.946_174_7 * x * y * (7.0 * zz - 1.0),
        -0.669_046_5 * y * z * (7.0 * zz - 3.0),
        0.105_785_55 * (35.0 * zz * zz - 30.0 * zz + 3.0),
        -0.669_046_5 * x * z * (7.0 * zz - 3.0),
        0.473_087_34 * (xx - yy) * (7.0 * zz - 1.0),
        -1.770_130_8 * x * z * (xx - 3.0 * yy),
        0.625_835_7 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The functions, including the constant one, must be orthonormal over the sphere; this detects wrong factors or
    /// signs within a function, and swapped functions.
    #[test]
    fn the_basis_is_orthonormal() {
        let n = 400;
        let mut products = [[0.0_f64; 25]; 25];
        for i in 0..n {
            for j in 0..40 {
                // Equal areas: z by midpoints, the azimuth in equal steps, which is exact there.
                let z = (2.0 * f64::from(i) + 1.0) / f64::from(n) - 1.0;
                let (sin, cos) = (std::f64::consts::TAU * f64::from(j) / 40.0).sin_cos();
                let r = (1.0 - z * z).sqrt();
                let d = [r * cos, r * sin, z].map(|v| v as f32);
                let mut all = vec![0.282_094_8_f32];
                all.extend(band_1(d));
                all.extend(band_2(d));
                all.extend(band_3(d));
                all.extend(band_4(d));
                for (a, row) in products.iter_mut().enumerate() {
                    for (b, product) in row.iter_mut().enumerate() {
                        *product += f64::from(all[a]) * f64::from(all[b]);
                    }
                }
            }
        }
        let area = 4.0 * std::f64::consts::PI / (f64::from(n) * 40.0);
        for (a, row) in products.iter().enumerate() {
            for (b, product) in row.iter().enumerate() {
                let expected = f64::from(u8::from(a == b));
                assert!((product * area - expected).abs() < 1e-3, "{a} {b}");
            }
        }
    }
}
