//! The render stage: Gaussians of a source, seen from a target camera.

use std::collections::BTreeMap;

use sharp::camera::target_camera_from_source_ndc;
use sharp::color::Quantization;
use sharp::gaussians::Gaussians;
use sharp::render::{Background, RenderError, RenderOutput, RenderView};
use sharp_datasets::DepthMap;
use sharp_metrics::Picture;

use crate::methods::{GaussianPrediction, GaussianSpace, PicturePrediction};
use crate::pairs::PosedCamera;
use crate::pairs::alignment::median_scale;
use crate::rendering::SharedRenderer;

/// Below this alpha a pixel counts as a hole: more background than surface.
const HOLE_ALPHA: f32 = 0.5;

/// The factor that brings predicted to true depth: the median of their ratios over the first layer (the paper's eq.
/// global_scale). The error is the bare reason.
pub(super) fn depth_scale(
    prediction: &GaussianPrediction,
    truth: Option<&DepthMap>,
) -> Result<f64, String> {
    let truth = truth.ok_or("the source view has no depth, which depth=privileged needs")?;
    let first_layer = prediction.first_layer.as_ref();
    let first_layer = first_layer.ok_or("the method predicts no depth layer to align")?;
    let found = median_scale(truth, first_layer).map_err(|error| error.to_string())?;
    Ok(found.scale)
}

/// Renders a prediction into the target: placed by the dataset's own cameras, composited over black in linear light,
/// encoded to sRGB, rounded to 8 bit.
///
/// Extras: those of the prediction, `mean_alpha` (mean coverage, 0..1), `hole_share` (share of pixels with alpha below
/// [`HOLE_ALPHA`]) and, with a scale, `median_scale`.
///
/// # Errors
/// See [`RenderError`].
pub(super) fn render(
    prediction: &GaussianPrediction,
    scale: Option<f64>,
    source: &PosedCamera,
    target: &PosedCamera,
    renderer: &SharedRenderer,
) -> Result<(PicturePrediction, RenderOutput), RenderError> {
    let target_from_source = source.to(target);
    let target_camera_from_gaussians = match prediction.space {
        GaussianSpace::Normalized => {
            target_camera_from_source_ndc(&source.intrinsics, &target_from_source)
        }
        GaussianSpace::Camera => target_from_source.to_affine(),
    };
    let view = RenderView::new(target_camera_from_gaussians, target.intrinsics);
    let output = match scale {
        None => renderer.render(&prediction.gaussians, &view)?,
        Some(scale) => renderer.render(&scaled(&prediction.gaussians, scale), &view)?,
    };
    let n = output.alpha.len() as f64;
    let covered: f64 = output.alpha.iter().map(|&a| f64::from(a)).sum();
    let holes = output.alpha.iter().filter(|&&a| a < HOLE_ALPHA).count();
    let mut extras: BTreeMap<String, f64> = prediction.extras.clone();
    extras.insert("mean_alpha".to_owned(), covered / n);
    extras.insert("hole_share".to_owned(), holes as f64 / n);
    if let Some(scale) = scale {
        extras.insert("median_scale".to_owned(), scale);
    }
    let picture = PicturePrediction {
        picture: Picture::Rgb8(output.srgb8(Background::Black, Quantization::Round)),
        region: None,
        resized_from: None,
        extras,
    };
    Ok((picture, output))
}

/// Gaussians scaled about the source camera. Normalised x and y are ratios, so that one factor on the whole space is a
/// factor on depth.
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
