//! Splats the dataset's own depth: shows the quality of SHARP's representation with perfect depth
//! and no learning.

use std::collections::BTreeMap;

use image::RgbImage;
use sharp::composer::compose;
use sharp::initializer::{BaseGaussians, Grid, InvalidDepth};
use sharp::resize::{bilinear_align_corners, nearest};
use sharp_datasets::DepthMap;

use super::method::{
    Approach, GaussianPrediction, GaussianSpace, Method, MethodError, MethodIdentity,
    PredictGaussians, SourceView, TargetCamera,
};
use super::privilege::{Privilege, TrueDepth};
use super::spec::{MethodSpec, SpecError};
use crate::io::fingerprints;
use crate::io::pictures::planes;

/// SHARP's initializer and composer on ground-truth depth, rendered by our renderer.
///
/// The source's depth, resized by nearest neighbour, fills both layers. The photograph is resized bilinearly with
/// aligned corners. Both become squares with sides of [`Self::resolution`] pixels, as the release resizes all inputs.
/// Pooling and the global minimum use valid pixels only; blocks without a valid pixel are dropped. All deltas, which
/// the network would predict, are zero.
///
/// Gaussians are placed by the affine map E_t E_s⁻¹ K_s⁻¹ with the dataset's own intrinsics, composited over black in
/// linear light, encoded to sRGB and rounded to 8 bit.
///
/// Extras: `dropped_blocks`, the number of blocks in both layers without valid depth.
#[derive(Debug, Clone)]
pub struct DepthSplat {
    label: String,
    /// Side of the square that image and depth are resized to, pixels; the release's is 1536.
    pub resolution: usize,
}

impl DepthSplat {
    /// Parses `resolution=N`.
    ///
    /// # Errors
    /// If it is not an even number from 2 to 8192.
    pub fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        let resolution = match spec.option("resolution") {
            None => Grid::RELEASE.width,
            Some(text) => text
                .parse()
                .ok()
                .filter(|side: &usize| (2..=8192).contains(side) && side.is_multiple_of(2))
                .ok_or_else(|| {
                    spec.error(format!(
                        "resolution={text}: expected an even number from 2 to 8192"
                    ))
                })?,
        };
        Ok(Self {
            label: spec.label.clone(),
            resolution,
        })
    }

    fn base_gaussians(
        &self,
        image: &RgbImage,
        depth: &DepthMap,
        view: &str,
    ) -> Result<BaseGaussians, MethodError> {
        let grid = Grid {
            width: self.resolution,
            height: self.resolution,
            ..Grid::RELEASE
        };
        let size = (image.width() as usize, image.height() as usize);
        let square = (self.resolution, self.resolution);
        let colors = bilinear_align_corners(&planes(image), size, square);
        let layer = nearest(depth.as_raw(), size, square);
        let layers = [layer.as_slice(), layer.as_slice()].concat();
        let base = BaseGaussians::new(&colors, &layers, grid, InvalidDepth::Skip);
        base.map_err(|error| MethodError::unsuitable(view, error))
    }
}

impl Method for DepthSplat {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        let resolution = self.resolution.to_string();
        MethodIdentity::new("depth-splat", [("resolution", resolution)])
    }

    fn sources(&self) -> &'static str {
        fingerprints::DEPTH_SPLAT
    }

    fn privilege(&self) -> Privilege {
        Privilege::of_depth(TrueDepth::SourceDepth)
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Gaussians(self)
    }
}

impl PredictGaussians for DepthSplat {
    fn predict(
        &self,
        source: &SourceView,
        _: Option<&TargetCamera>,
    ) -> Result<GaussianPrediction, MethodError> {
        let (view, image) = (&source.camera().id, source.image());
        let depth = source.depth().ok_or_else(|| {
            MethodError::unsuitable(
                view,
                "the source view has no depth, which depth-splat needs",
            )
        })?;
        if depth.dimensions() != image.dimensions() {
            let (depth, image) = (depth.dimensions(), image.dimensions());
            let reason = format!(
                "the depth map is {depth:?} pixels, but the photograph is \
                                  {image:?}"
            );
            return Err(MethodError::unsuitable(view, reason));
        }
        let base = self.base_gaussians(image, depth, view)?;
        let gaussians =
            compose(&base, None).map_err(|error| MethodError::unsuitable(view, error))?;
        Ok(GaussianPrediction {
            gaussians,
            space: GaussianSpace::Normalized,
            extras: BTreeMap::from([("dropped_blocks".to_owned(), base.dropped() as f64)]),
            ..GaussianPrediction::default()
        })
    }
}
