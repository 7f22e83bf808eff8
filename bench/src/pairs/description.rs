//! Description of a pair for an external method: `pair.json`.

use std::collections::BTreeMap;

use glam::DMat3;
use serde::Serialize;
use sharp::camera::{Intrinsics, RigidTransform};
use sharp_datasets::View;

use super::pair_id::{PairName, path_of};

/// Format version; increased whenever a program written for an earlier `pair.json` would misinterpret a new one.
pub const FORMAT: u32 = 1;

/// A pair: both cameras, the motion between them, and the expected output. It contains the target's camera, but not its
/// photograph.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairDescription {
    pub format: u32,
    /// `dataset/scene/source__target`, each part percent-encoded.
    pub pair_id: String,
    pub dataset: String,
    pub scene: String,
    pub source: ViewDescription,
    pub target: ViewDescription,
    /// Intrinsics of the source picture, 3×3 row by row, in pixels.
    #[serde(rename = "K_s")]
    pub k_s: [f64; 9],
    #[serde(rename = "K_t")]
    pub k_t: [f64; 9],
    /// 4×4 row by row: X_target = target_from_source · X_source, in metres.
    pub target_from_source: [f64; 16],
    /// Location and size of the expected prediction.
    pub prediction: ExpectedPrediction,
    /// Cameras at several scales, for methods without metric scale. The method predicts a picture at each scale; only
    /// the best is scored.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub scales: Vec<ScaledCamera>,
    pub conventions: BTreeMap<&'static str, &'static str>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ViewDescription {
    pub id: String,
    pub width: u32,
    pub height: u32,
}

/// The camera at one scale of a scale sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScaledCamera {
    /// Name of the scale, as in `imported:scales=`.
    pub scale: String,
    /// [`PairDescription::target_from_source`] with its translation multiplied by the scale, in the method's own units
    /// of length.
    pub target_from_source: [f64; 16],
    /// File of the prediction at this scale.
    pub file: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ExpectedPrediction {
    /// File name relative to the folder in `imported:dir=`; `.jpg`, `.jpeg` and `.exr` are also accepted.
    pub file: String,
    pub width: u32,
    pub height: u32,
}

impl PairDescription {
    /// Describes a pair, given its cameras.
    pub fn new(pair_id: &str, source: &PosedCamera, target: &PosedCamera) -> Self {
        let (dataset, scene) = match PairName::decode(pair_id) {
            Ok(name) => (name.dataset, name.scene),
            Err(_) => (String::new(), String::new()),
        };
        Self {
            format: FORMAT,
            pair_id: pair_id.to_owned(),
            dataset,
            scene,
            source: source.into(),
            target: target.into(),
            k_s: row_major(source.intrinsics.matrix()),
            k_t: row_major(target.intrinsics.matrix()),
            target_from_source: source.to(target).to_row_major(),
            prediction: ExpectedPrediction {
                file: format!("{}.png", path_of(pair_id)),
                width: target.intrinsics.width,
                height: target.intrinsics.height,
            },
            scales: Vec::new(),
            conventions: conventions(),
        }
    }

    /// Adds cameras for a scale sweep; each scale is given as the name of its folder and its value.
    #[must_use]
    pub fn with_scales(mut self, scales: &[(String, f64)]) -> Self {
        let camera = |(name, scale): &(String, f64)| {
            let mut target_from_source = self.target_from_source;
            for row in 0..3 {
                target_from_source[4 * row + 3] *= scale;
            }
            ScaledCamera {
                scale: name.clone(),
                target_from_source,
                file: format!("{name}/{}", self.prediction.file),
            }
        };
        self.scales = scales.iter().map(camera).collect();
        self
    }
}

/// The camera of a view. A method knows nothing else about the target.
#[derive(Debug, Clone, PartialEq)]
pub struct PosedCamera {
    pub id: String,
    pub intrinsics: Intrinsics,
    /// World-to-camera extrinsics, in metres.
    pub camera_from_world: RigidTransform,
}

impl PosedCamera {
    pub fn size(&self) -> (u32, u32) {
        (self.intrinsics.width, self.intrinsics.height)
    }

    /// The transform from this camera's coordinates to those of `other`, in metres.
    pub fn to(&self, other: &Self) -> RigidTransform {
        other
            .camera_from_world
            .after(&self.camera_from_world.inverse())
    }
}

impl From<&View> for PosedCamera {
    fn from(view: &View) -> Self {
        Self {
            id: view.id.clone(),
            intrinsics: view.intrinsics,
            camera_from_world: view.camera_from_world,
        }
    }
}

impl From<&PosedCamera> for ViewDescription {
    fn from(camera: &PosedCamera) -> Self {
        Self {
            id: camera.id.clone(),
            width: camera.intrinsics.width,
            height: camera.intrinsics.height,
        }
    }
}

pub(crate) fn row_major(matrix: DMat3) -> [f64; 9] {
    matrix.transpose().to_cols_array()
}

/// Conventions of all exported cameras and pictures.
pub(crate) fn conventions() -> BTreeMap<&'static str, &'static str> {
    BTreeMap::from([
        (
            "axes",
            "OpenCV camera: x right, y down, z forward (viewing direction)",
        ),
        ("units", "metres for translations and depth, pixels for K"),
        (
            "pixels",
            "pixel (column i, row j) has its centre at (i + 0.5, j + 0.5); K maps to these coordinates (COLMAP's \
             convention; subtract 0.5 from cx and cy for integer centres, OpenCV's)",
        ),
        (
            "matrices",
            "row by row, for column vectors; target_from_source maps points from source-camera to target-camera \
             coordinates",
        ),
        (
            "projection",
            "(u z, v z, z) = K X for X in that camera's coordinates; no skew, no distortion",
        ),
        (
            "pictures",
            "8-bit sRGB, undistorted and resized: exactly the pixels that are scored; pixels that the dataset's \
             masks exclude are black and not scored",
        ),
        (
            "depth",
            "z-depth (not ray length), float32 [height, width], 0 where there is none",
        ),
        (
            "prediction",
            "the target view as sRGB at the target's full size, top row first",
        ),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_of_the_source_lands_where_the_description_says() {
        let spec = sharp_datasets::DatasetSpec::parse("synthetic=size=64x48,views=4").unwrap();
        let scenes = sharp_datasets::open(&spec).unwrap();
        let (s, t) = (&scenes[0].views[0], &scenes[0].views[2]);
        let described = PairDescription::new("synthetic/a/x__y", &s.into(), &t.into());
        assert_eq!(
            (described.dataset.as_str(), described.scene.as_str()),
            ("synthetic", "a")
        );
        assert_eq!(described.prediction.file, "synthetic/a/x__y.png");
        // Transforms a point in front of the source using only the description's numbers.
        let point = [0.1, -0.2, 3.0, 1.0];
        let m = described.target_from_source;
        let moved: Vec<f64> = (0..3)
            .map(|r| (0..4).map(|c| m[4 * r + c] * point[c]).sum())
            .collect();
        let k = described.k_t;
        let homogeneous: Vec<f64> = (0..3)
            .map(|r| (0..3).map(|c| k[3 * r + c] * moved[c]).sum())
            .collect();
        let world = s
            .camera_from_world
            .inverse()
            .apply(glam::DVec3::new(0.1, -0.2, 3.0));
        let expected = t
            .intrinsics
            .project(t.camera_from_world.apply(world))
            .unwrap();
        assert!((homogeneous[0] / homogeneous[2] - expected.x).abs() < 1e-9);
        assert!((homogeneous[1] / homogeneous[2] - expected.y).abs() < 1e-9);
    }
}
