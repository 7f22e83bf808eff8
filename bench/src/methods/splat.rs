//! Gaussians of a source view, rendered into the target view.

use std::collections::BTreeMap;

use glam::DAffine3;
use sharp::camera::target_camera_from_source_ndc;
use sharp::color::Quantization;
use sharp::gaussians::Gaussians;
use sharp::render::{Background, RenderError, RenderView};
use sharp_metrics::Picture;

pub(super) use crate::pictures::planes;

use super::method::{MethodError, PairInput, Prediction};

/// Below this alpha a pixel counts as a hole: more background than surface.
pub(super) const HOLE_ALPHA: f32 = 0.5;

/// Renders Gaussians of the source's normalised space, placed by E_t E_s⁻¹ K_s⁻¹.
pub(super) fn render_from_ndc(
    gaussians: &Gaussians,
    pair: &PairInput,
) -> Result<Prediction, MethodError> {
    let placement =
        target_camera_from_source_ndc(&pair.source.intrinsics, &pair.target_from_source());
    render(gaussians, placement, pair)
}

/// Renders Gaussians into the target: composited over black in linear light, encoded to sRGB, rounded to 8 bit.
///
/// Extras: `mean_alpha` (mean coverage, 0..1), `hole_share` (share of pixels with alpha below [`HOLE_ALPHA`]).
pub(super) fn render(
    gaussians: &Gaussians,
    target_camera_from_gaussians: DAffine3,
    pair: &PairInput,
) -> Result<Prediction, MethodError> {
    let view = RenderView::new(target_camera_from_gaussians, pair.target.intrinsics);
    let output = pair
        .renderer
        .render(gaussians, &view)
        .map_err(method_error)?;
    let n = output.alpha.len() as f64;
    let covered: f64 = output.alpha.iter().map(|&a| f64::from(a)).sum();
    let holes = output.alpha.iter().filter(|&&a| a < HOLE_ALPHA).count();
    Ok(Prediction {
        picture: Picture::Rgb8(output.srgb8(Background::Black, Quantization::Round)),
        region: None,
        extras: BTreeMap::from([
            ("mean_alpha".to_owned(), covered / n),
            ("hole_share".to_owned(), holes as f64 / n),
        ]),
    })
}

fn method_error(error: RenderError) -> MethodError {
    if error.is_device_fault() {
        MethodError::Device(error.to_string())
    } else {
        MethodError::Render(error.to_string())
    }
}
