//! Lens distortion models.
//!
//! With u = X/Z, v = Y/Z and r² = u² + v², each model maps (u, v) to distorted coordinates, which fx, fy, cx, cy
//! convert to pixels. The formulas are those of OpenCV (`calib3d`) and COLMAP (`sensor/models.h`), which agree with
//! each other.

use glam::{DMat2, DVec2};

/// Distortion of normalised coordinates by a lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// No distortion: a pinhole camera.
    None,
    /// Rational radial `(1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)` and tangential
    /// p1, p2 (FULL_OPENCV). OPENCV has k1, k2 and p, RADIAL k1 and k2, SIMPLE_RADIAL k1.
    Perspective {
        model: &'static str,
        k: [f64; 6],
        p: [f64; 2],
    },
    /// OPENCV_FISHEYE: with θ = atan r, `(u, v) θ/r (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`.
    OpenCvFisheye { k: [f64; 4] },
    /// THIN_PRISM_FISHEYE: `(a, b) = (u, v) θ/r`, then radial k1 … k4, tangential and thin-prism
    /// terms in r² = a² + b².
    ThinPrismFisheye {
        /// k1 … k4; the file's order is k1, k2, p1, p2, k3, k4, sx1, sy1.
        k: [f64; 4],
        p: [f64; 2],
        s: [f64; 2],
    },
    /// RAD_TAN_THIN_PRISM_FISHEYE: `(a, b) = (u, v) θ/r (1 + k0 θ² + … + k5 θ¹²)`, then tangential and thin-prism terms
    /// in r² = a² + b².
    RadTanThinPrismFisheye {
        k: [f64; 6],
        p: [f64; 2],
        /// Coefficients of r² and r⁴ for the first coordinate, then for the second.
        s: [f64; 4],
    },
    /// FOV: the radius becomes `atan(2 r tan(ω/2)) / ω`. (COLMAP's series for ω below 0.01 has
    /// swapped signs; the formula is therefore used for every ω.)
    Fov { omega: f64 },
    /// DIVISION: `(u, v) · 2 / (1 + √(1 − 4 k r²))`, the inverse of a division by `1 + k r²`.
    Division { k: f64 },
    /// EUCM: `(u, v) / (α √(β r² + 1) + 1 − α)`.
    Eucm { alpha: f64, beta: f64 },
}

impl Distortion {
    /// Creates a perspective model with the given radial coefficients; the other coefficients are
    /// 0.
    pub fn perspective(model: &'static str, radial: &[f64], p: [f64; 2]) -> Self {
        let mut k = [0.0; 6];
        k[..radial.len()].copy_from_slice(radial);
        Self::Perspective { model, k, p }
    }

    /// COLMAP's name of the model. For a family of models, the name of the member with the most
    /// parameters.
    pub fn name(&self) -> &'static str {
        match self {
            Self::None => "PINHOLE",
            Self::Perspective { model, .. } => model,
            Self::OpenCvFisheye { .. } => "OPENCV_FISHEYE",
            Self::ThinPrismFisheye { .. } => "THIN_PRISM_FISHEYE",
            Self::RadTanThinPrismFisheye { .. } => "RAD_TAN_THIN_PRISM_FISHEYE",
            Self::Fov { .. } => "FOV",
            Self::Division { .. } => "DIVISION",
            Self::Eucm { .. } => "EUCM",
        }
    }

    /// Distorts normalised coordinates `(X/Z, Y/Z)` by the plain formula, even far outside the picture.
    pub fn distort(&self, uv: DVec2) -> DVec2 {
        match *self {
            Self::None => uv,
            Self::Perspective { k, p, .. } => {
                let r2 = uv.length_squared();
                let above = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]));
                let below = 1.0 + r2 * (k[3] + r2 * (k[4] + r2 * k[5]));
                uv * (above / below) + tangential(uv, p)
            }
            _ => match self.scale_at(uv.length_squared()) {
                Some((scale, _)) => uv * scale,
                None => self.bend(equidistant(uv)),
            },
        }
    }

    /// For the models without a polynomial (FOV, DIVISION, EUCM): the radial factor at r² and its derivative with respect
    /// to r². `None` for other models.
    fn scale_at(&self, r2: f64) -> Option<(f64, f64)> {
        match *self {
            Self::Fov { omega } => {
                let t = 2.0 * (omega / 2.0).tan();
                let x2 = r2 * t * t;
                // atan(x)/x and its derivative with respect to x². For smaller x², the series is
                // exact up to rounding.
                let (ratio, slope) = if x2 < 1e-8 {
                    (1.0 - x2 / 3.0, -1.0 / 3.0 + 0.4 * x2)
                } else {
                    let ratio = x2.sqrt().atan() / x2.sqrt();
                    (ratio, (1.0 / (1.0 + x2) - ratio) / (2.0 * x2))
                };
                let factor = if omega == 0.0 { 1.0 } else { t / omega };
                Some((factor * ratio, factor * slope * t * t))
            }
            Self::Division { k } => {
                let root = (1.0 - 4.0 * k * r2).sqrt();
                let scale = 2.0 / (1.0 + root);
                Some((scale, k * scale * scale / root))
            }
            Self::Eucm { alpha, beta } => {
                let root = (beta * r2 + 1.0).sqrt();
                let scale = 1.0 / (alpha * root + 1.0 - alpha);
                Some((scale, -scale * scale * alpha * beta / (2.0 * root)))
            }
            _ => None,
        }
    }

    /// The part of a fisheye model that acts on equidistant coordinates; for other models, the whole distortion.
    pub(super) fn bend(&self, ab: DVec2) -> DVec2 {
        match *self {
            Self::ThinPrismFisheye { k, p, s } => {
                let r2 = ab.length_squared();
                ab * (1.0 + radial4(r2, k)) + tangential(ab, p) + DVec2::from(s) * r2
            }
            Self::OpenCvFisheye { k } => ab * (1.0 + radial4(ab.length_squared(), k)),
            Self::RadTanThinPrismFisheye { k, p, s } => {
                let ab = ab * (1.0 + radial(ab.length_squared(), &k));
                let r2 = ab.length_squared();
                let prism = DVec2::new(s[0] + s[1] * r2, s[2] + s[3] * r2) * r2;
                ab + tangential(ab, [p[1], p[0]]) + prism
            }
            _ => self.distort(ab),
        }
    }

    /// Jacobian of [`Self::bend`] at a point; its columns are the derivatives with respect to the two coordinates.
    pub(super) fn bend_slope(&self, x: DVec2) -> DMat2 {
        let r2 = x.length_squared();
        match *self {
            Self::None => DMat2::IDENTITY,
            Self::Perspective { k, p, .. } => {
                let [a1, a2, a3, b1, b2, b3] = k;
                let above = 1.0 + r2 * (a1 + r2 * (a2 + r2 * a3));
                let below = 1.0 + r2 * (b1 + r2 * (b2 + r2 * b3));
                let derived = |k1: f64, k2: f64, k3: f64| k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3);
                let factor = above / below;
                let slope = (derived(a1, a2, a3) - factor * derived(b1, b2, b3)) / below;
                radial_slope(x, (factor, slope)) + tangential_slope(x, p)
            }
            Self::OpenCvFisheye { k } => radial_slope(x, (1.0 + radial4(r2, k), by_r2(r2, k))),
            Self::ThinPrismFisheye { k, p, s } => {
                let prism = outer(DVec2::from(s), 2.0 * x);
                radial_slope(x, (1.0 + radial4(r2, k), by_r2(r2, k)))
                    + tangential_slope(x, p)
                    + prism
            }
            Self::RadTanThinPrismFisheye { k, p, s } => {
                let factor = 1.0 + radial(r2, &k);
                let by_r2 = (0..6)
                    .rev()
                    .fold(0.0, |sum, i| sum * r2 + (i + 1) as f64 * k[i]);
                let ab = x * factor;
                let r2 = ab.length_squared();
                let prism = DVec2::new(s[0] + 2.0 * s[1] * r2, s[2] + 2.0 * s[3] * r2);
                let outer_slope =
                    DMat2::IDENTITY + tangential_slope(ab, [p[1], p[0]]) + outer(prism, 2.0 * ab);
                outer_slope * radial_slope(x, (factor, by_r2))
            }
            Self::Fov { .. } | Self::Division { .. } | Self::Eucm { .. } => {
                radial_slope(x, self.scale_at(r2).unwrap_or((1.0, 0.0)))
            }
        }
    }

    pub(super) fn is_fisheye(&self) -> bool {
        matches!(
            self,
            Self::OpenCvFisheye { .. }
                | Self::ThinPrismFisheye { .. }
                | Self::RadTanThinPrismFisheye { .. }
        )
    }
}

/// Tangential distortion, to be added: `(2 p1 uv + p2 (r² + 2u²), 2 p2 uv + p1 (r² + 2v²))`.
fn tangential(uv: DVec2, p: [f64; 2]) -> DVec2 {
    let r2 = uv.length_squared();
    DVec2::new(
        2.0 * p[0] * uv.x * uv.y + p[1] * (r2 + 2.0 * uv.x * uv.x),
        2.0 * p[1] * uv.x * uv.y + p[0] * (r2 + 2.0 * uv.y * uv.y),
    )
}

/// Jacobian of [`tangential`].
fn tangential_slope(uv: DVec2, p: [f64; 2]) -> DMat2 {
    let crossed = 2.0 * (p[0] * uv.x + p[1] * uv.y);
    DMat2::from_cols(
        DVec2::new(2.0 * p[0] * uv.y + 6.0 * p[1] * uv.x, crossed),
        DVec2::new(crossed, 2.0 * p[1] * uv.x + 6.0 * p[0] * uv.y),
    )
}

/// Jacobian of x · f(|x|²), given the factor f and its derivative with respect to |x|².
fn radial_slope(x: DVec2, (factor, by_r2): (f64, f64)) -> DMat2 {
    DMat2::from_diagonal(DVec2::splat(factor)) + outer(x, 2.0 * by_r2 * x)
}

fn outer(a: DVec2, b: DVec2) -> DMat2 {
    DMat2::from_cols(a * b.x, a * b.y)
}

fn radial4(r2: f64, k: [f64; 4]) -> f64 {
    r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])))
}

/// Evaluates k0 r² + k1 r⁴ + …
fn radial(r2: f64, k: &[f64]) -> f64 {
    k.iter().rev().fold(0.0, |sum, k| (sum + k) * r2)
}

/// Derivative of [`radial4`] with respect to r².
fn by_r2(r2: f64, k: [f64; 4]) -> f64 {
    k[0] + r2 * (2.0 * k[1] + r2 * (3.0 * k[2] + r2 * 4.0 * k[3]))
}

/// `(u, v) θ/r` with θ = atan r: makes the radius equal to the angle from the axis.
fn equidistant(uv: DVec2) -> DVec2 {
    let r = uv.length();
    // θ/r = 1 − r²/3 + …: for smaller r, the difference from 1 is below rounding.
    if r < 1e-9 { uv } else { uv * (r.atan() / r) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences of step 1e-5: their error is 1e-10 times the third derivative, plus
    /// 1e-11 from rounding.
    #[test]
    fn slopes_are_those_of_small_differences() {
        let p = [5e-3, -3e-3];
        let k = [0.21047, 0.21102, -0.158023, 0.406856];
        for model in [
            Distortion::None,
            Distortion::perspective("RADIAL", &[-0.09, 0.02], [0.0; 2]),
            Distortion::perspective("OPENCV", &[-0.1, 0.04], p),
            Distortion::perspective("FULL_OPENCV", &[0.3, -0.15, 0.02, 0.31, -0.12, 0.01], p),
            Distortion::OpenCvFisheye { k },
            Distortion::ThinPrismFisheye {
                k,
                p,
                s: [-8e-3, 6e-3],
            },
            Distortion::RadTanThinPrismFisheye {
                k: [0.1, -0.02, 0.01, -0.003, 0.001, -2e-4],
                p,
                s: [-8e-3, 2e-3, 6e-3, -1e-3],
            },
            Distortion::Fov { omega: 0.9 },
            Distortion::Fov { omega: 0.0 },
            Distortion::Division { k: -0.2 },
            Distortion::Division { k: 0.1 },
            Distortion::Eucm {
                alpha: 0.6,
                beta: 1.1,
            },
        ] {
            for i in 0..100 {
                let x = DVec2::new(f64::from(i % 10) / 6.0 - 0.7, f64::from(i / 10) / 7.0 - 0.6);
                let along = |step| (model.bend(x + step) - model.bend(x - step)) / 2e-5;
                let expected = DMat2::from_cols(along(DVec2::X * 1e-5), along(DVec2::Y * 1e-5));
                let difference = model.bend_slope(x) - expected;
                let largest = difference.to_cols_array().map(f64::abs);
                let largest = largest.into_iter().fold(0.0, f64::max);
                assert!(largest < 2e-8, "{} {x}: {largest}", model.name());
            }
        }
    }
}
