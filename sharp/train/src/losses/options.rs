//! The published loss weights, and options for the choices that the paper leaves open.

use super::perceptual::PerceptualOptions;
use serde::{Deserialize, Serialize};
use sharp::render::RenderView;

/// Names of the losses.
pub const TERMS: [&str; 10] = [
    "color",
    "alpha",
    "percep",
    "depth",
    "tv",
    "grad",
    "delta",
    "splat",
    "scale",
    "scale_gradient",
];

/// Weight λ of each loss; the defaults are the published values (paper, implementation details).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LossWeights {
    pub color: f64,
    pub alpha: f64,
    pub percep: f64,
    pub depth: f64,
    pub tv: f64,
    pub grad: f64,
    pub delta: f64,
    pub splat: f64,
    pub scale: f64,
    /// Weight of the loss ∇scale.
    pub scale_gradient: f64,
}

impl Default for LossWeights {
    fn default() -> Self {
        Self {
            color: 1.0,
            alpha: 1.0,
            percep: 3.0,
            depth: 0.2,
            tv: 1.0,
            grad: 0.5,
            delta: 1.0,
            splat: 1.0,
            scale: 0.1,
            scale_gradient: 5.0,
        }
    }
}

impl LossWeights {
    /// The weights, in the order of [`TERMS`].
    fn values(&self) -> [f64; TERMS.len()] {
        [
            self.color,
            self.alpha,
            self.percep,
            self.depth,
            self.tv,
            self.grad,
            self.delta,
            self.splat,
            self.scale,
            self.scale_gradient,
        ]
    }

    /// The first invalid weight: its key in a configuration, and the reason.
    pub(crate) fn first_fault(&self) -> Option<(String, String)> {
        let values = self.values();
        if values == [0.0; TERMS.len()] {
            return Some(("losses".to_owned(), "are all 0".to_owned()));
        }
        let (name, _) = TERMS
            .iter()
            .zip(values)
            .find(|(_, weight)| !is_weight(*weight))?;
        let reason = "is negative or not finite".to_owned();
        Some((format!("losses.{name}"), reason))
    }
}

fn is_weight(value: f64) -> bool {
    value >= 0.0 && value.is_finite()
}

/// Choices that the paper leaves open. The caller that sums the losses applies the options about
/// views; the losses apply all other options.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LossOptions {
    /// Reduction over the channels of a pixel in `color`.
    pub color_channels: Channels,
    /// Views on which `alpha` is computed: the paper's equation sums both views, its text mentions
    /// the input view.
    pub alpha_views: AlphaViews,
    /// Lower limit (0..1) of alpha before its logarithm is taken. The gradient is zero where alpha
    /// is below this limit.
    pub alpha_floor: f64,
    /// Units of inverse depth in `depth`.
    pub depth_units: InverseDepthUnits,
    /// Treatment of sky in the mask of the novel view ([`sharp::frustum_mask`]).
    pub mask_sky: MaskSky,
    /// Divisor of `color` and `alpha` for masked pictures.
    pub mask_normalization: MaskNormalization,
    /// True if the gradient of `grad` flows to the opacity only, not to the depth.
    pub grad_stops_at_depth: bool,
    /// Where `grad` measures edges of depth.
    pub grad_at: GradAt,
    /// Finite differences that `grad` uses.
    pub grad_difference: Difference,
    /// Norm |∇| of `grad`.
    pub grad_norm: GradientNorm,
    /// Units of inverse depth in `grad`. Its thresholds are meant for values in 0.01..1.
    pub grad_units: InverseDepthUnits,
    /// Measure of a 2D covariance that `splat` bounds.
    pub splat_variance: SplatVariance,
    /// View in which `splat` projects.
    pub splat_view: SplatView,
    /// `splat` measures variances in px² of a picture of this width in pixels, whatever width is rendered.
    pub splat_width: f64,
    /// Reduction of the map by two in ∇scale.
    pub scale_pooling: ScalePooling,
    /// Norm |∇| of ∇scale.
    pub scale_norm: GradientNorm,
    /// True if ∇scale measures differences per pixel of the full map, i.e. divides level k by 2^k.
    pub scale_per_full_pixel: bool,
    /// Variance in px² that rendering adds to both diagonal entries of a projected covariance.
    pub low_pass: f32,
    pub percep: PerceptualOptions,
}

impl Default for LossOptions {
    fn default() -> Self {
        Self {
            color_channels: Channels::Mean,
            alpha_views: AlphaViews::Both,
            alpha_floor: 1e-6,
            depth_units: InverseDepthUnits::Metric,
            mask_sky: MaskSky::Direction,
            mask_normalization: MaskNormalization::AllPixels,
            grad_stops_at_depth: true,
            grad_at: GradAt::Projected,
            grad_difference: Difference::Forward,
            grad_norm: GradientNorm::Absolute,
            grad_units: InverseDepthUnits::Normalized,
            splat_variance: SplatVariance::Eigenvalues,
            splat_view: SplatView::Input,
            splat_width: 1536.0,
            scale_pooling: ScalePooling::Average,
            scale_norm: GradientNorm::Absolute,
            scale_per_full_pixel: false,
            low_pass: RenderView::EPS2D_CONFIG,
            percep: PerceptualOptions::default(),
        }
    }
}

impl LossOptions {
    /// The first invalid option: its key in a configuration, and the reason.
    pub(crate) fn first_fault(&self) -> Option<(String, String)> {
        let percep = &self.percep;
        let checks = [
            (
                self.alpha_floor > 0.0 && self.alpha_floor < 1.0,
                "alpha_floor",
                "is not between 0 and 1",
            ),
            (
                self.splat_width > 0.0 && self.splat_width.is_finite(),
                "splat_width",
                "is not positive",
            ),
            (
                is_weight(f64::from(self.low_pass)),
                "low_pass",
                "is negative or not finite",
            ),
            (
                is_weight(percep.features),
                "percep.features",
                "is negative or not finite",
            ),
            (
                is_weight(percep.gram),
                "percep.gram",
                "is negative or not finite",
            ),
            (
                percep.crop.is_none_or(|crop| crop >= 8),
                "percep.crop",
                "is less than 8 pixels, which is too small for features",
            ),
        ];
        let (_, key, reason) = checks.into_iter().find(|(holds, ..)| !holds)?;
        Some((format!("loss_options.{key}"), reason.to_owned()))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channels {
    Mean,
    Sum,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlphaViews {
    Both,
    Input,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplatView {
    Input,
    Novel,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InverseDepthUnits {
    /// 1/m.
    Metric,
    /// The network's normalised unit: 1 at the nearest point.
    Normalized,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GradAt {
    /// In the depth at full resolution, where each base Gaussian is projected, as in the equation.
    Projected,
    /// Between neighbouring Gaussians, in the pooled depth from which they were made.
    Grid,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskSky {
    /// A point at infinity: only the rotation between the views affects its ray.
    Direction,
    LeftOut,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskNormalization {
    AllPixels,
    /// The number of pixels in the mask; an empty mask gives zero.
    MaskedPixels,
}

/// Finite differences of a map; zero across its edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Difference {
    /// Difference to the next pixel.
    Forward,
    /// Half the difference between both neighbours; at an edge, the pixel itself replaces the missing neighbour.
    Central,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplatVariance {
    /// Each of the two eigenvalues is bounded; the two losses are added.
    Eigenvalues,
    /// The mean of the two eigenvalues.
    Mean,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScalePooling {
    /// Mean of 2×2 pixels; a last odd row or column is dropped.
    Average,
    /// The first of 2×2 pixels.
    First,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GradientNorm {
    /// |∂x| + |∂y|.
    Absolute,
    /// √(∂x² + ∂y²).
    Euclidean,
}
