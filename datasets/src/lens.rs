//! Camera models with lens distortion: the models of COLMAP and OpenCV that real datasets use.
//!
//! With u = X/Z, v = Y/Z and r² = u² + v², each model maps (u, v) to distorted coordinates, which
//! fx, fy, cx, cy turn into pixels. The formulas are those of OpenCV (`calib3d`) and COLMAP
//! (`sensor/models.h`), which agree with each other.

use glam::{DMat2, DVec2, DVec3};
use sharp::camera::{CameraError, Intrinsics};

/// What a lens does to normalised coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// Nothing: a pinhole camera.
    None,
    /// COLMAP's SIMPLE_RADIAL (k2 = 0) and RADIAL: `(u, v)(1 + k1 r² + k2 r⁴)`.
    Radial {
        /// k1, k2.
        k: [f64; 2],
    },
    /// OPENCV: radial k1, k2 and tangential p1, p2.
    OpenCv {
        /// k1, k2.
        k: [f64; 2],
        /// p1, p2.
        p: [f64; 2],
    },
    /// FULL_OPENCV: rational radial `(1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)`.
    FullOpenCv {
        /// k1 … k6.
        k: [f64; 6],
        /// p1, p2.
        p: [f64; 2],
    },
    /// OPENCV_FISHEYE: with θ = atan r, `(u, v) θ/r (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`.
    OpenCvFisheye {
        /// k1 … k4.
        k: [f64; 4],
    },
    /// THIN_PRISM_FISHEYE: `(a, b) = (u, v) θ/r`, then radial k1 … k4, tangential and thin-prism
    /// terms in r² = a² + b².
    ThinPrismFisheye {
        /// k1 … k4; the file's order is k1, k2, p1, p2, k3, k4, sx1, sy1.
        k: [f64; 4],
        /// p1, p2.
        p: [f64; 2],
        /// sx1, sy1.
        s: [f64; 2],
    },
}

impl Distortion {
    /// Distorts normalised coordinates `(X/Z, Y/Z)` by the plain formula, however far out.
    pub fn distort(&self, uv: DVec2) -> DVec2 {
        match *self {
            Self::None => uv,
            Self::Radial { k } => {
                let r2 = uv.length_squared();
                uv * (1.0 + r2 * (k[0] + r2 * k[1]))
            }
            Self::OpenCv { k, p } => {
                let r2 = uv.length_squared();
                uv * (1.0 + r2 * (k[0] + r2 * k[1])) + tangential(uv, p)
            }
            Self::FullOpenCv { k, p } => {
                let r2 = uv.length_squared();
                let above = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]));
                let below = 1.0 + r2 * (k[3] + r2 * (k[4] + r2 * k[5]));
                uv * (above / below) + tangential(uv, p)
            }
            Self::OpenCvFisheye { k } => {
                let ab = equidistant(uv);
                ab * (1.0 + radial4(ab.length_squared(), k))
            }
            Self::ThinPrismFisheye { .. } => self.bend(equidistant(uv)),
        }
    }

    /// The part of a fisheye model that acts on equidistant coordinates.
    fn bend(&self, ab: DVec2) -> DVec2 {
        match *self {
            Self::ThinPrismFisheye { k, p, s } => {
                let r2 = ab.length_squared();
                ab * (1.0 + radial4(r2, k)) + tangential(ab, p) + DVec2::from(s) * r2
            }
            Self::OpenCvFisheye { k } => ab * (1.0 + radial4(ab.length_squared(), k)),
            _ => self.distort(ab),
        }
    }

    fn is_fisheye(&self) -> bool {
        matches!(
            self,
            Self::OpenCvFisheye { .. } | Self::ThinPrismFisheye { .. }
        )
    }

    /// Undoes [`Self::distort`]; `None` where no undistorted point is found, or where the
    /// polynomial has folded back, so that a point further in maps to the same place.
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        let bent = self.invert(distorted)?;
        self.unfolded_up_to(bent).then(|| self.straightened(bent))?
    }

    /// From the coordinates that [`Self::bend`] acts on to normalised ones; `None` for a fisheye's
    /// rays at 90° and beyond.
    fn straightened(&self, bent: DVec2) -> Option<DVec2> {
        if !self.is_fisheye() {
            return Some(bent);
        }
        let theta = bent.length();
        if theta >= std::f64::consts::FRAC_PI_2 {
            return None;
        }
        let scale = if theta < 1e-9 {
            1.0
        } else {
            theta.tan() / theta
        };
        Some(bent * scale)
    }

    /// Newton's iteration on [`Self::bend`], with halved steps where a full one does not help.
    fn invert(&self, distorted: DVec2) -> Option<DVec2> {
        if !distorted.is_finite() {
            return None;
        }
        if *self == Self::None {
            return Some(distorted);
        }
        let mut x = distorted;
        // Far outside, the polynomial may explode: begin where it is close to the identity.
        if (self.bend(x) - distorted).length() > x.length() {
            x = DVec2::ZERO;
        }
        let mut error = self.bend(x) - distorted;
        for _ in 0..100 {
            if error.length() <= 1e-15 * (1.0 + distorted.length()) {
                break;
            }
            let step = self.slope(x).inverse() * error;
            if !step.is_finite() {
                return None;
            }
            let mut fraction = 1.0;
            let next = loop {
                let candidate = x - step * fraction;
                let next_error = self.bend(candidate) - distorted;
                if next_error.length() < error.length() {
                    break Some((candidate, next_error));
                }
                fraction *= 0.5;
                if fraction < 1e-3 {
                    break None;
                }
            };
            // At the limit of rounding no step helps any more.
            let Some((candidate, next_error)) = next else {
                break;
            };
            (x, error) = (candidate, next_error);
        }
        let converged = error.length() <= 1e-12 * (1.0 + distorted.length());
        converged.then_some(x)
    }

    /// True where the map has kept its orientation all the way from the axis to `x`.
    fn unfolded_up_to(&self, x: DVec2) -> bool {
        (1..=16).all(|i| self.is_unfolded_at(x * (f64::from(i) / 16.0)))
    }

    fn is_unfolded_at(&self, x: DVec2) -> bool {
        let slope = self.slope(x);
        slope.determinant() > 0.0 && (slope * x).dot(x) > 0.0 || x == DVec2::ZERO
    }

    /// The radius (of normalised coordinates, for fisheyes the angle in radians) within which the
    /// map does not fold back, to 1/128; infinite for a pinhole, at most 10 (84°) for perspective
    /// lenses.
    fn fold_radius(&self) -> f64 {
        if *self == Self::None {
            return f64::INFINITY;
        }
        let limit = if self.is_fisheye() {
            std::f64::consts::FRAC_PI_2
        } else {
            10.0
        };
        let unfolded = |radius: f64| {
            (0..8).all(|i| {
                let (sine, cosine) = (f64::from(i) * std::f64::consts::FRAC_PI_4).sin_cos();
                self.is_unfolded_at(DVec2::new(cosine, sine) * radius)
            })
        };
        (1..)
            .map(|i| f64::from(i) / 128.0)
            .find(|radius| *radius >= limit || !unfolded(*radius))
            .map_or(limit, |radius| radius.min(limit))
    }

    /// Derivative of [`Self::bend`] by central differences.
    fn slope(&self, x: DVec2) -> DMat2 {
        let h = 1e-6 * (1.0 + x.length());
        let along = |step: DVec2| (self.bend(x + step) - self.bend(x - step)) / (2.0 * h);
        DMat2::from_cols(along(DVec2::new(h, 0.0)), along(DVec2::new(0.0, h)))
    }
}

/// `(2 p1 uv + p2 (r² + 2u²), 2 p2 uv + p1 (r² + 2v²))`.
fn tangential(uv: DVec2, p: [f64; 2]) -> DVec2 {
    let r2 = uv.length_squared();
    DVec2::new(
        2.0 * p[0] * uv.x * uv.y + p[1] * (r2 + 2.0 * uv.x * uv.x),
        2.0 * p[1] * uv.x * uv.y + p[0] * (r2 + 2.0 * uv.y * uv.y),
    )
}

fn radial4(r2: f64, k: [f64; 4]) -> f64 {
    r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])))
}

/// `(u, v) θ/r` with θ = atan r: the angle from the axis becomes the radius.
fn equidistant(uv: DVec2) -> DVec2 {
    let r = uv.length();
    // θ/r = 1 − r²/3 + …: below this the difference is rounding.
    if r < 1e-9 { uv } else { uv * (r.atan() / r) }
}

/// A camera with its lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    intrinsics: Intrinsics,
    distortion: Distortion,
    /// See [`Distortion::fold_radius`].
    fold_radius: f64,
}

impl Lens {
    /// A camera by COLMAP's model name and parameters in COLMAP's order.
    ///
    /// # Errors
    /// The reason, in words: an unknown or unsupported model, the wrong number of parameters,
    /// degenerate intrinsics, a parameter that is not finite.
    pub fn from_colmap(model: &str, size: (u32, u32), params: &[f64]) -> Result<Self, String> {
        let count = colmap_parameters(model)
            .ok_or_else(|| format!("camera model '{model}' is not supported"))?;
        if params.len() != count {
            return Err(format!(
                "camera model {model} takes {count} parameters, not {}",
                params.len()
            ));
        }
        if !params.iter().all(|p| p.is_finite()) {
            return Err(format!(
                "camera model {model} has a parameter that is not finite"
            ));
        }
        // Models with a single focal length are named after their simplicity.
        let single = count <= 5 && model != "PINHOLE";
        let (focal, center, rest) = if single {
            ((params[0], params[0]), (params[1], params[2]), &params[3..])
        } else {
            ((params[0], params[1]), (params[2], params[3]), &params[4..])
        };
        let k = |i: usize| rest.get(i).copied().unwrap_or(0.0);
        let distortion = match model {
            "SIMPLE_RADIAL" | "RADIAL" => Distortion::Radial { k: [k(0), k(1)] },
            "OPENCV" => Distortion::OpenCv {
                k: [k(0), k(1)],
                p: [k(2), k(3)],
            },
            "FULL_OPENCV" => Distortion::FullOpenCv {
                k: [k(0), k(1), k(4), k(5), k(6), k(7)],
                p: [k(2), k(3)],
            },
            "OPENCV_FISHEYE" | "RADIAL_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" => {
                Distortion::OpenCvFisheye {
                    k: [k(0), k(1), k(2), k(3)],
                }
            }
            "THIN_PRISM_FISHEYE" => Distortion::ThinPrismFisheye {
                k: [k(0), k(1), k(4), k(5)],
                p: [k(2), k(3)],
                s: [k(6), k(7)],
            },
            _ => Distortion::None,
        };
        Self::new(focal, center, size, distortion).map_err(|e| e.to_string())
    }

    /// A camera from its parts. Perspective distortion without a coefficient becomes a pinhole.
    ///
    /// # Errors
    /// [`CameraError`] for intrinsics that are not a camera's.
    pub fn new(
        focal: (f64, f64),
        center: (f64, f64),
        size: (u32, u32),
        distortion: Distortion,
    ) -> Result<Self, CameraError> {
        let zero = |values: &[f64]| values.iter().all(|v| *v == 0.0);
        let without_effect = match distortion {
            Distortion::None => true,
            Distortion::Radial { k } => zero(&k),
            Distortion::OpenCv { k, p } => zero(&k) && zero(&p),
            Distortion::FullOpenCv { k, p } => zero(&k) && zero(&p),
            // Without coefficients these are still fisheye cameras.
            Distortion::OpenCvFisheye { .. } | Distortion::ThinPrismFisheye { .. } => false,
        };
        let distortion = if without_effect {
            Distortion::None
        } else {
            distortion
        };
        Ok(Self {
            intrinsics: Intrinsics::new(focal, center, size)?,
            distortion,
            fold_radius: distortion.fold_radius(),
        })
    }

    /// Focal lengths, principal point and size of the picture as stored.
    pub fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    /// What the lens does.
    pub fn distortion(&self) -> Distortion {
        self.distortion
    }

    /// True when straight lines stay straight.
    pub fn is_pinhole(&self) -> bool {
        self.distortion == Distortion::None
    }

    /// Projects a camera-space point to pixels; `None` unless it lies in front (z > 0). Far
    /// outside the picture the polynomials fold back: see [`Self::project_unfolded`].
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        (point.z > 0.0).then(|| {
            let k = &self.intrinsics;
            let distorted = self.distortion.distort(point.truncate() / point.z);
            DVec2::new(k.fx * distorted.x + k.cx, k.fy * distorted.y + k.cy)
        })
    }

    /// As [`Self::project`], and `None` beyond the radius where the model folds back, so that no
    /// point outside the field of view lands inside the picture.
    pub fn project_unfolded(&self, point: DVec3) -> Option<DVec2> {
        let pixel = self.project(point)?;
        let mut radius = (point.truncate() / point.z).length();
        if self.distortion.is_fisheye() {
            radius = radius.atan();
        }
        (radius < self.fold_radius).then_some(pixel)
    }

    /// The ray through a pixel, as the camera-space point at z = 1; `None` where the lens sees
    /// nothing (a fisheye beyond 90°, a polynomial that has folded back).
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let k = &self.intrinsics;
        let distorted = DVec2::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy);
        let bent = self.distortion.invert(distorted)?;
        if bent.length() >= self.fold_radius {
            return None;
        }
        Some(self.distortion.straightened(bent)?.extend(1.0))
    }
}

/// How many parameters COLMAP stores for a model; `None` for models that are not supported.
pub fn colmap_parameters(model: &str) -> Option<usize> {
    Some(match model {
        "SIMPLE_PINHOLE" => 3,
        "PINHOLE" | "SIMPLE_RADIAL" | "SIMPLE_RADIAL_FISHEYE" => 4,
        "RADIAL" | "RADIAL_FISHEYE" => 5,
        "OPENCV" | "OPENCV_FISHEYE" => 8,
        "FULL_OPENCV" | "THIN_PRISM_FISHEYE" => 12,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (640, 480);

    fn all() -> Vec<Lens> {
        [
            ("PINHOLE", vec![500.0, 510.0, 330.0, 250.0]),
            ("SIMPLE_RADIAL", vec![500.0, 330.0, 250.0, -0.05]),
            ("RADIAL", vec![500.0, 330.0, 250.0, -0.05, 0.01]),
            (
                "OPENCV",
                vec![500.0, 510.0, 330.0, 250.0, -0.1, 0.04, 7e-4, -4e-4],
            ),
            (
                "FULL_OPENCV",
                vec![
                    500.0, 510.0, 330.0, 250.0, 0.3, -0.15, 5e-4, -3e-4, 0.02, 0.31, -0.12, 0.01,
                ],
            ),
            ("SIMPLE_RADIAL_FISHEYE", vec![400.0, 330.0, 250.0, -0.02]),
            ("RADIAL_FISHEYE", vec![400.0, 330.0, 250.0, -0.02, 0.003]),
            (
                "OPENCV_FISHEYE",
                vec![400.0, 410.0, 330.0, 250.0, -0.03, -0.008, -9e-4, 3e-4],
            ),
            (
                "THIN_PRISM_FISHEYE",
                vec![
                    341.142,
                    341.002,
                    304.129,
                    241.407,
                    0.21047,
                    0.21102,
                    -5.36231e-06,
                    5.1541e-4,
                    -0.158023,
                    0.406856,
                    -8.46499e-05,
                    8.61313e-4,
                ],
            ),
        ]
        .into_iter()
        .map(|(model, params)| Lens::from_colmap(model, SIZE, &params).unwrap())
        .collect()
    }

    #[test]
    fn every_model_undoes_itself_all_over_the_picture() {
        for lens in all() {
            for y in (0..=480).step_by(20) {
                for x in (0..=640).step_by(20) {
                    let pixel = DVec2::new(f64::from(x), f64::from(y));
                    let ray = lens.unproject(pixel).unwrap();
                    let back = lens.project_unfolded(ray * 3.0).unwrap();
                    let error = (back - pixel).length();
                    assert!(error < 1e-9, "{:?} {pixel}: {error}", lens.distortion());
                }
            }
        }
    }

    #[test]
    fn a_thin_prism_without_its_other_terms_is_the_fisheye() {
        let k = [0.21, -0.02, 0.003, 0.0004];
        let fisheye = Distortion::OpenCvFisheye { k };
        let prism = Distortion::ThinPrismFisheye {
            k,
            p: [0.0; 2],
            s: [0.0; 2],
        };
        for i in 0..200 {
            let uv = DVec2::new(f64::from(i % 20) / 8.0 - 1.2, f64::from(i / 20) / 5.0 - 1.0);
            assert!((fisheye.distort(uv) - prism.distort(uv)).length() < 1e-15);
        }
    }

    #[test]
    fn the_parameter_order_of_the_thin_prism_is_colmaps() {
        let params: Vec<f64> = (1..=12).map(f64::from).collect();
        let lens = Lens::from_colmap("THIN_PRISM_FISHEYE", SIZE, &params).unwrap();
        let expected = Distortion::ThinPrismFisheye {
            k: [5.0, 6.0, 9.0, 10.0],
            p: [7.0, 8.0],
            s: [11.0, 12.0],
        };
        assert_eq!(lens.distortion, expected);
    }

    #[test]
    fn fisheyes_approach_the_pinhole_on_the_axis() {
        for lens in all() {
            let k = lens.intrinsics;
            for r in [0.0, 1e-12, 1e-9, 2e-9, 1e-7] {
                let pixel = lens.project(DVec3::new(r, -r, 1.0)).unwrap();
                assert!((pixel.x - k.cx - k.fx * r).abs() < 1e-10, "{r}");
                assert!((pixel.y - k.cy + k.fy * r).abs() < 1e-10, "{r}");
            }
        }
    }

    #[test]
    fn folded_polynomials_are_not_inverted_nor_projected() {
        // 1 − r² turns back at r = 1/√3, where the radius is 0.385.
        let fold = Distortion::Radial { k: [-1.0, 0.0] };
        assert!(fold.undistort(DVec2::new(0.38, 0.0)).is_some());
        assert!(fold.undistort(DVec2::new(0.4, 0.0)).is_none());
        let lens = Lens::new((100.0, 100.0), (50.0, 50.0), (100, 100), fold).unwrap();
        let outside = DVec3::new(1.0, 0.0, 1.0);
        assert!(lens.project(outside).is_some());
        assert!(lens.project_unfolded(outside).is_none());
        let fisheye = Distortion::OpenCvFisheye { k: [0.0; 4] };
        assert!(fisheye.undistort(DVec2::new(1.6, 0.0)).is_none());
        assert!(fisheye.undistort(DVec2::new(f64::NAN, 0.0)).is_none());
    }

    #[test]
    fn wrong_parameters_are_refused_by_name() {
        for (model, params, reason) in [
            ("FOV", vec![1.0; 5], "'FOV' is not supported"),
            ("OPENCV", vec![1.0; 7], "takes 8 parameters, not 7"),
            ("PINHOLE", vec![1.0, f64::NAN, 1.0, 1.0], "not finite"),
            ("PINHOLE", vec![0.0, 1.0, 1.0, 1.0], "degenerate"),
        ] {
            let error = Lens::from_colmap(model, SIZE, &params).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
        let opencv = [500.0, 500.0, 320.0, 240.0, 0.0, 0.0, 0.0, 0.0];
        assert!(
            Lens::from_colmap("OPENCV", SIZE, &opencv)
                .unwrap()
                .is_pinhole()
        );
        assert!(
            !Lens::from_colmap("OPENCV_FISHEYE", SIZE, &opencv)
                .unwrap()
                .is_pinhole()
        );
    }
}
