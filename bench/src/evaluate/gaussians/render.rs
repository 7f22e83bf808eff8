//! The render stage: renders a source's Gaussians into a target camera.

use std::collections::BTreeMap;

use glam::{DAffine3, DVec3};
use sharp::camera::target_camera_from_source_ndc;
use sharp::gaussians::Gaussians;
use sharp::render::{RenderError, RenderOutput};
use sharp_datasets::DepthMap;

use crate::methods::{GaussianPrediction, GaussianSpace, PicturePrediction};
use crate::pairs::PosedCamera;
use crate::pairs::alignment::median_scale;
use crate::pairs::depth::median_depth_m;
use crate::rendering::SharedRenderer;
use crate::rendering::pose_alignment::fit_camera;
use crate::rendering::shared::{HOLE_ALPHA, surface_depth};
use crate::scoring::GroundTruth;

/// Fitted cameras that are rotated by more than this cause a warning, in degrees.
const FAR_TURNED: f64 = 15.0;
/// Fitted cameras that are moved by more than this share of the median depth cause a warning.
const FAR_MOVED: f64 = 0.25;

/// The factor from predicted to true depth: the median of their ratios (the paper's eq. global_scale). The inner error
/// is the reason why there is no factor; it names neither file nor pair.
///
/// # Errors
/// If rendering into the source fails, which is needed for Gaussians without a depth layer.
pub(in crate::evaluate) fn depth_scale(
    prediction: &GaussianPrediction,
    truth: Option<&DepthMap>,
    source: &PosedCamera,
    renderer: &SharedRenderer,
) -> Result<Result<f64, String>, RenderError> {
    let Some(truth) = truth else {
        let reason = "the source view has no depth, which depth=privileged needs";
        return Ok(Err(reason.to_owned()));
    };
    let seen;
    let predicted = match &prediction.first_layer {
        Some(layer) => layer,
        None => {
            seen = seen_depth(prediction, source, renderer)?;
            &seen
        }
    };
    let found = median_scale(truth, predicted);
    Ok(found.map(|found| found.scale).map_err(|e| e.to_string()))
}

/// Expected z-depth of the Gaussians in their source camera, metres; 0 in holes.
fn seen_depth(
    prediction: &GaussianPrediction,
    source: &PosedCamera,
    renderer: &SharedRenderer,
) -> Result<DepthMap, RenderError> {
    let placed = placed(prediction.space, source, source);
    let output = renderer.render(
        &prediction.gaussians,
        placed,
        source.intrinsics,
        prediction.rule,
    )?;
    Ok(surface_depth(&output))
}

/// Transform from the Gaussians' space to the target's camera.
pub(in crate::evaluate) fn placed(
    space: GaussianSpace,
    source: &PosedCamera,
    target: &PosedCamera,
) -> DAffine3 {
    let target_from_source = source.to(target);
    match space {
        GaussianSpace::Normalized => {
            target_camera_from_source_ndc(&source.intrinsics, &target_from_source)
        }
        GaussianSpace::Camera(camera_from_file) => {
            target_from_source.to_affine() * camera_from_file
        }
    }
}

/// Renders a prediction into the target, using the dataset's own cameras.
///
/// If `fit` is given, first moves the target's camera to fit its photograph.
///
/// Extras: those of the prediction; `mean_alpha` (mean coverage, 0..1); `hole_share` (share of
/// pixels with alpha below [`HOLE_ALPHA`]); `median_scale` if scaled; for a fitted camera also
/// `pose_rotation_deg`, `pose_translation_m` and `pose_steps`.
///
/// # Errors
/// If rendering fails.
pub(in crate::evaluate) fn render(
    prediction: &GaussianPrediction,
    scale: Option<f64>,
    source: &PosedCamera,
    target: &PosedCamera,
    renderer: &SharedRenderer,
    fit: Option<&GroundTruth>,
) -> Result<(PicturePrediction, RenderOutput), RenderError> {
    let median_scale = scale;
    // Scaling within the transform avoids rounding the Gaussians once more.
    let (space, scale) = match (prediction.space, scale) {
        (GaussianSpace::Camera(map), Some(scale)) if map != DAffine3::IDENTITY => {
            let about_camera = DAffine3::from_scale(DVec3::splat(scale));
            (GaussianSpace::Camera(about_camera * map), None)
        }
        (space, scale) => (space, scale),
    };
    let mut placed = placed(space, source, target);
    let resized;
    let gaussians = match scale {
        None => &prediction.gaussians,
        Some(scale) => {
            resized = scaled(&prediction.gaussians, scale);
            &resized
        }
    };
    let (intrinsics, rule) = (target.intrinsics, prediction.rule);
    let moved = fit
        .map(|truth| {
            let seen = (truth.image(), truth.valid());
            fit_camera(renderer, gaussians, placed, intrinsics, rule, seen)
        })
        .transpose()?;
    if let Some(moved) = &moved {
        placed = moved.map * placed;
    }
    let output = renderer.render(gaussians, placed, intrinsics, rule)?;
    let n = output.alpha.len() as f64;
    let covered: f64 = output.alpha.iter().map(|&a| f64::from(a)).sum();
    let holes = output.alpha.iter().filter(|&&a| a < HOLE_ALPHA).count();
    let mut extras: BTreeMap<String, f64> = prediction.extras.clone();
    extras.insert("mean_alpha".to_owned(), covered / n);
    extras.insert("hole_share".to_owned(), holes as f64 / n);
    if let Some(moved) = moved {
        extras.extend([
            ("pose_rotation_deg".to_owned(), moved.rotation_deg),
            ("pose_translation_m".to_owned(), moved.translation),
            ("pose_steps".to_owned(), moved.steps as f64),
        ]);
    }
    if let Some(scale) = median_scale {
        extras.insert("median_scale".to_owned(), scale);
    }
    let picture = PicturePrediction {
        extras,
        ..renderer.picture(&output).into()
    };
    Ok((picture, output))
}

/// Topic and text of a warning if `align=pose` moved or rotated the camera too far to be credible.
pub(in crate::evaluate) fn far_moved(
    picture: &PicturePrediction,
    output: &RenderOutput,
    pair_id: &str,
) -> Option<(String, String)> {
    let turned = *picture.extras.get("pose_rotation_deg")?;
    let moved = *picture.extras.get("pose_translation_m")?;
    let depth = median_depth_m(&surface_depth(output))?;
    (turned > FAR_TURNED || moved > FAR_MOVED * depth).then(|| {
        let text = format!(
            "align=pose moved a target's camera by {moved:.3} m and {turned:.1}° ({pair_id}), which is too large for \
             a correction; the scene may have another origin or unit"
        );
        ("pose".to_owned(), text)
    })
}

/// Scales Gaussians about the source camera. In normalised space, x and y are ratios, so a common
/// factor for all coordinates scales the depth.
fn scaled(gaussians: &Gaussians, scale: f64) -> Gaussians {
    let scale = scale as f32;
    let times = |v: &[f32; 3]| v.map(|x| x * scale);
    Gaussians {
        means: gaussians.means.iter().map(times).collect(),
        scales: gaussians.scales.iter().map(times).collect(),
        ..gaussians.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall rendered 2 m in front of the camera, whose true distance is 4 m.
    #[test]
    fn gaussians_without_a_depth_layer_are_scaled_by_the_depth_that_is_seen() {
        let source = PosedCamera {
            id: "s".to_owned(),
            intrinsics: sharp::camera::Intrinsics {
                fx: 20.0,
                fy: 20.0,
                cx: 10.0,
                cy: 8.0,
                width: 20,
                height: 16,
            },
            camera_from_world: sharp::camera::RigidTransform::IDENTITY,
        };
        let means: Vec<[f32; 3]> = (0..20 * 16)
            .map(|i| {
                [
                    (i % 20) as f32 * 0.1 - 0.95,
                    (i / 20) as f32 * 0.1 - 0.75,
                    2.0,
                ]
            })
            .collect();
        let n = means.len();
        let prediction = GaussianPrediction {
            rule: None,
            rule_note: None,
            gaussians: Gaussians::new(
                means,
                vec![[1.0, 0.0, 0.0, 0.0]; n],
                vec![[0.1, 0.1, 1e-4]; n],
                vec![0.9; n],
                vec![[0.5; 3]; n],
            )
            .unwrap(),
            space: GaussianSpace::CAMERA,
            first_layer: None,
            extras: BTreeMap::new(),
            reading: None,
            warnings: BTreeMap::new(),
        };
        let truth = DepthMap::from_pixel(20, 16, image::Luma([4.0]));
        let renderer = SharedRenderer::cpu();
        let scale = |truth| depth_scale(&prediction, truth, &source, &renderer).unwrap();
        assert!((scale(Some(&truth)).unwrap() - 2.0).abs() < 1e-5);
        assert!(scale(None).unwrap_err().contains("depth=privileged"));
    }

    #[test]
    fn scaling_keeps_directions_and_multiplies_depth() {
        let gaussians = Gaussians::new(
            vec![[1.0, 2.0, 4.0]],
            vec![[1.0, 0.0, 0.0, 0.0]],
            vec![[0.1, 0.2, 0.3]],
            vec![0.5],
            vec![[0.1; 3]],
        )
        .unwrap();
        let twice = scaled(&gaussians, 2.0);
        assert_eq!(twice.means, [[2.0, 4.0, 8.0]]);
        assert_eq!(twice.scales, [[0.2, 0.4, 0.6]]);
        assert_eq!(twice.opacities, gaussians.opacities);
    }
}
