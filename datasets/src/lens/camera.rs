//! A camera with its lens: intrinsics and a distortion model with COLMAP's name and parameters.

use glam::{DVec2, DVec3};
use sharp::camera::{CameraError, Intrinsics};

use super::{Distortion, LensError};

/// A camera with its lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    intrinsics: Intrinsics,
    distortion: Distortion,
    /// Radius within which the model does not fold back; see [`Distortion::fold_radius`].
    fold_radius: f64,
}

impl Lens {
    /// Creates a camera from COLMAP's model name and parameters in COLMAP's order.
    ///
    /// # Errors
    /// If the model is not supported, or its parameters have the wrong number, are not finite or are out of range, or
    /// the intrinsics are invalid.
    pub fn from_colmap(model: &str, size: (u32, u32), params: &[f64]) -> Result<Self, LensError> {
        let name = || model.to_owned();
        let mut known = COLMAP_MODELS
            .iter()
            .filter(|(known, _)| *known != EQUIRECTANGULAR);
        let known = known.find(|(known, _)| *known == model);
        let count = known.map(|(_, count)| *count);
        let count = count.ok_or_else(|| LensError::UnsupportedModel { model: name() })?;
        if params.len() != count {
            return Err(LensError::ParameterCount {
                model: name(),
                expected: count,
                found: params.len(),
            });
        }
        if !params.iter().all(|p| p.is_finite()) {
            return Err(LensError::NotFinite { model: name() });
        }
        // Models with a single focal length have `SIMPLE_` in their names, except these two.
        let single = model.starts_with("SIMPLE_") || matches!(model, "RADIAL" | "RADIAL_FISHEYE");
        let (focal, center, rest) = if single {
            ((params[0], params[0]), (params[1], params[2]), &params[3..])
        } else {
            ((params[0], params[1]), (params[2], params[3]), &params[4..])
        };
        let k = |i: usize| rest.get(i).copied().unwrap_or(0.0);
        let distortion = match model {
            "SIMPLE_RADIAL" | "RADIAL" => Distortion::perspective("RADIAL", rest, [0.0; 2]),
            "OPENCV" => Distortion::perspective("OPENCV", &rest[..2], [k(2), k(3)]),
            "FULL_OPENCV" => {
                let radial = [k(0), k(1), k(4), k(5), k(6), k(7)];
                Distortion::perspective("FULL_OPENCV", &radial, [k(2), k(3)])
            }
            "OPENCV_FISHEYE"
            | "RADIAL_FISHEYE"
            | "SIMPLE_RADIAL_FISHEYE"
            | "FISHEYE"
            | "SIMPLE_FISHEYE" => Distortion::OpenCvFisheye {
                k: [k(0), k(1), k(2), k(3)],
            },
            "RAD_TAN_THIN_PRISM_FISHEYE" => Distortion::RadTanThinPrismFisheye {
                k: std::array::from_fn(k),
                p: [k(6), k(7)],
                s: [k(8), k(9), k(10), k(11)],
            },
            "FOV" => Distortion::Fov { omega: k(0) },
            "SIMPLE_DIVISION" | "DIVISION" => Distortion::Division { k: k(0) },
            "EUCM" if (0.0..=1.0).contains(&k(0)) && k(1) > 0.0 => Distortion::Eucm {
                alpha: k(0),
                beta: k(1),
            },
            "EUCM" => return Err(LensError::OutOfRange { model: name() }),
            "THIN_PRISM_FISHEYE" => Distortion::ThinPrismFisheye {
                k: [k(0), k(1), k(4), k(5)],
                p: [k(2), k(3)],
                s: [k(6), k(7)],
            },
            _ => Distortion::None,
        };
        Ok(Self::new(focal, center, size, distortion)?)
    }

    /// Creates a camera from its parts. Perspective distortion without coefficients becomes a pinhole.
    ///
    /// # Errors
    /// [`CameraError`] for invalid intrinsics.
    pub fn new(
        focal: (f64, f64),
        center: (f64, f64),
        size: (u32, u32),
        distortion: Distortion,
    ) -> Result<Self, CameraError> {
        // Fisheye models without coefficients are still fisheye, so only perspective models become pinholes.
        let distortion = match distortion {
            Distortion::Perspective { k, p, .. } if k == [0.0; 6] && p == [0.0; 2] => {
                Distortion::None
            }
            Distortion::Fov { omega: 0.0 }
            | Distortion::Division { k: 0.0 }
            | Distortion::Eucm { alpha: 0.0, .. } => Distortion::None,
            other => other,
        };
        Ok(Self {
            intrinsics: Intrinsics::new(focal, center, size)?,
            distortion,
            fold_radius: distortion.fold_radius(),
        })
    }

    /// Creates a pinhole camera; `None` for invalid intrinsics.
    pub fn of_pinhole(k: Intrinsics) -> Option<Self> {
        Self::new(
            (k.fx, k.fy),
            (k.cx, k.cy),
            (k.width, k.height),
            Distortion::None,
        )
        .ok()
    }

    /// Focal lengths, principal point and size of the picture as stored.
    pub fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    pub fn distortion(&self) -> Distortion {
        self.distortion
    }

    /// True if straight lines stay straight.
    pub fn is_pinhole(&self) -> bool {
        self.distortion == Distortion::None
    }

    /// Projects a camera-space point to pixels; `None` if the point is not in front of the camera
    /// (z ≤ 0). Far outside the picture, the polynomials fold back; see [`Self::project_unfolded`].
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        (point.z > 0.0).then(|| {
            let k = &self.intrinsics;
            let distorted = self.distortion.distort(point.truncate() / point.z);
            DVec2::new(k.fx * distorted.x + k.cx, k.fy * distorted.y + k.cy)
        })
    }

    /// Like [`Self::project`], but `None` beyond the radius at which the model folds back, so that no point outside the
    /// field of view is projected into the picture.
    pub fn project_unfolded(&self, point: DVec3) -> Option<DVec2> {
        let pixel = self.project(point)?;
        let mut radius = (point.truncate() / point.z).length();
        if self.distortion.is_fisheye() {
            radius = radius.atan();
        }
        (radius < self.fold_radius).then_some(pixel)
    }

    /// The ray through a pixel, as the camera-space point at z = 1; `None` if the lens sees nothing there (a fisheye
    /// beyond 90°, or a polynomial beyond its fold).
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

/// COLMAP's models, indexed by their ids, with the number of parameters stored.
pub const COLMAP_MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    (EQUIRECTANGULAR, 2),
];

/// The model of panoramas, which is refused: no pinhole camera can show the whole picture.
const EQUIRECTANGULAR: &str = "EQUIRECTANGULAR";

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
        .chain(
            OF_COLMAP_4
                .iter()
                .map(|(model, params, _)| Lens::from_colmap(model, SIZE, params).unwrap()),
        )
        .collect()
    }

    type Projected = (&'static str, &'static [f64], [[f64; 2]; 2]);

    /// Models, each with the pixels to which pycolmap 4.2.1 projects (0.3, -0.2, 1) and (-0.7, 0.5,
    /// 1).
    const OF_COLMAP_4: [Projected; 7] = [
        (
            "FOV",
            &[400.0, 410.0, 330.0, 250.0, 0.9],
            [
                [453.95390172323, 165.298167155793],
                [79.223045040167, 433.604556309878],
            ],
        ),
        (
            "SIMPLE_DIVISION",
            &[500.0, 330.0, 250.0, -0.2],
            [
                [476.290508437776, 152.472994374816],
                [20.504431498479, 471.068263215372],
            ],
        ),
        (
            "DIVISION",
            &[500.0, 510.0, 330.0, 250.0, -0.15],
            [
                [477.183800743819, 149.915015494203],
                [12.058879268493, 481.642816532955],
            ],
        ),
        (
            "SIMPLE_FISHEYE",
            &[400.0, 330.0, 250.0],
            [
                [445.171380280437, 173.219079813042],
                [98.767980384936, 415.165728296474],
            ],
        ),
        (
            "FISHEYE",
            &[400.0, 410.0, 330.0, 250.0],
            [
                [445.171380280437, 171.299556808368],
                [98.767980384936, 419.294871503886],
            ],
        ),
        (
            "EUCM",
            &[400.0, 410.0, 330.0, 250.0, 0.6, 1.1],
            [
                [445.222078188355, 171.264913237957],
                [98.232814792801, 419.686689169556],
            ],
        ),
        (
            "RAD_TAN_THIN_PRISM_FISHEYE",
            &[
                400.0, 410.0, 330.0, 250.0, 0.1, -0.02, 0.01, -0.003, 0.001, -2e-4, 5e-3, -3e-3,
                -8e-3, 2e-3, 6e-3, -1e-3,
            ],
            [
                [446.859542721181, 170.1982851992],
                [89.689553788378, 426.189484806533],
            ],
        ),
    ];

    #[test]
    fn models_of_colmap_4_project_as_colmap_does() {
        for (model, params, expected) in OF_COLMAP_4 {
            let lens = Lens::from_colmap(model, SIZE, params).unwrap();
            for ((x, y), expected) in [(0.3, -0.2), (-0.7, 0.5)].into_iter().zip(expected) {
                let pixel = lens.project(DVec3::new(x, y, 1.0)).unwrap();
                let error = (pixel - DVec2::from(expected)).length();
                assert!(error < 1e-9, "{model} {pixel}");
            }
        }
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
        for lens in all()
            .into_iter()
            .filter(|lens| lens.distortion.name() != "FOV")
        {
            let k = lens.intrinsics;
            for r in [0.0, 1e-12, 1e-9, 2e-9, 1e-7] {
                let pixel = lens.project(DVec3::new(r, -r, 1.0)).unwrap();
                assert!((pixel.x - k.cx - k.fx * r).abs() < 1e-10, "{r}");
                assert!((pixel.y - k.cy + k.fy * r).abs() < 1e-10, "{r}");
            }
        }
    }

    #[test]
    fn wrong_parameters_are_refused_by_name() {
        let refused = |model: &str, params: &[f64]| Lens::from_colmap(model, SIZE, params);
        let model = |name: &str| name.to_owned();
        assert_eq!(
            refused("EQUIRECTANGULAR", &[640.0, 480.0]),
            Err(LensError::UnsupportedModel {
                model: model("EQUIRECTANGULAR")
            })
        );
        assert_eq!(
            refused("OPENCV", &[1.0; 7]),
            Err(LensError::ParameterCount {
                model: model("OPENCV"),
                expected: 8,
                found: 7
            })
        );
        assert_eq!(
            refused("PINHOLE", &[1.0, f64::NAN, 1.0, 1.0]),
            Err(LensError::NotFinite {
                model: model("PINHOLE")
            })
        );
        let degenerate = refused("PINHOLE", &[0.0, 1.0, 1.0, 1.0]);
        assert!(matches!(degenerate, Err(LensError::Camera(_))));
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
