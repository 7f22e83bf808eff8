//! The loss weights that the paper publishes, and options for what it leaves open.

use super::perceptual::PerceptualOptions;
use serde::{Deserialize, Serialize};

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

/// λ of each loss; the default is the published (paper, implementation details).
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
    /// Of ∇scale.
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
    /// In the order of [`TERMS`].
    fn values(&self) -> [f64; TERMS.len()] {
        let Self {
            color,
            alpha,
            percep,
            depth,
            tv,
            grad,
            delta,
            splat,
            scale,
            scale_gradient,
        } = *self;
        [
            color,
            alpha,
            percep,
            depth,
            tv,
            grad,
            delta,
            splat,
            scale,
            scale_gradient,
        ]
    }

    /// The first weight that cannot be, by its key in a configuration.
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

/// Choices that the paper leaves open. Those of a view are made by whoever adds the losses up; all
/// others are read by the losses themselves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LossOptions {
    /// Over the channels of a pixel, in `color`.
    pub color_channels: Channels,
    /// Of `alpha`: the equation sums both views, the prose has the input view.
    pub alpha_views: AlphaViews,
    /// Smallest alpha whose logarithm is taken; without gradient below.
    pub alpha_floor: f64,
    /// Of `depth`.
    pub depth_units: InverseDepthUnits,
    /// What the mask of the novel view ([`sharp::frustum_mask`]) does with sky.
    pub mask_sky: MaskSky,
    /// What `color` and `alpha` of masked pictures are divided by.
    pub mask_normalization: MaskNormalization,
    /// Of `grad`: whether only the opacity gets a gradient, not the depth.
    pub grad_stops_at_depth: bool,
    /// Of `grad`, on the grid of the Gaussians.
    pub grad_difference: Difference,
    /// Of `grad`, whose thresholds are meant for values in 0.01..1.
    pub grad_units: InverseDepthUnits,
    /// What of a 2D covariance `splat` bounds.
    pub splat_variance: SplatVariance,
    /// In which view `splat` projects.
    pub splat_view: SplatView,
    /// Width of the picture, pixels, in whose px² `splat` counts, whatever width is rendered.
    pub splat_width: f64,
    /// How ∇scale halves its map.
    pub scale_pooling: ScalePooling,
    /// |∇| of ∇scale.
    pub scale_norm: GradientNorm,
    /// Whether ∇scale counts differences per pixel of the full map: level k divided by 2^k.
    pub scale_per_full_pixel: bool,
    /// Of the perceptual loss.
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
            grad_difference: Difference::Forward,
            grad_units: InverseDepthUnits::Normalized,
            splat_variance: SplatVariance::Eigenvalues,
            splat_view: SplatView::Input,
            splat_width: 1536.0,
            scale_pooling: ScalePooling::Average,
            scale_norm: GradientNorm::Absolute,
            scale_per_full_pixel: false,
            percep: PerceptualOptions::default(),
        }
    }
}

impl LossOptions {
    /// The first invalid option, by its key in a configuration.
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
                "is less than 8 pixels, which leave no features",
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

/// The unit of inverse depths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InverseDepthUnits {
    /// 1/m.
    Metric,
    /// The network's own: 1 at the nearest point.
    Normalized,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskSky {
    /// A point infinitely far: only the rotation between the views acts on its ray.
    Direction,
    LeftOut,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskNormalization {
    AllPixels,
    /// Those that the mask keeps; a mask that keeps none gives zero.
    MaskedPixels,
}

/// Differentiation of a map; zero across its edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Difference {
    /// To the next pixel.
    Forward,
    /// Half of that between both neighbours; an edge pixel stands for its missing neighbour.
    Central,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplatVariance {
    /// Both, added.
    Eigenvalues,
    /// Their mean.
    Mean,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScalePooling {
    /// Of 2×2 pixels; a last odd row or column is left out.
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
