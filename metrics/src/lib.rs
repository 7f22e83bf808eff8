//! Image metrics of view synthesis: PSNR, SSIM, LPIPS and DISTS.
//!
//! Public code computes different numbers under the same name. Here, each variant of a metric has its own
//! [`MetricKey`]. A variant that cannot be computed is [`Unavailable`] with the reason, never zero and never replaced
//! by another one. The crate is independent of datasets and cameras.
//!
//! # Contents
//! * [`identity`]: keys of metrics.
//! * [`info`]: description of a key, with everything else that affects a number.
//! * [`selection`]: lists of keys as typed on a command line.
//! * [`picture`]: pictures and masks, the inputs of metrics.
//! * [`mod@resize`]: the resizing functions of torch, PIL and OpenCV, by name.
//! * [`scorer`]: all selected metrics of predictions and their target; `unavailable`: reasons for missing values.
//! * [`options`]: device and kernels of the networks.
//! * [`mod@psnr`], `ssim`, `lpips`, `dists`: the metrics themselves; `maps`: their local values.
//! * `engines`: the learned metrics of a scorer, with a single pass of each network.
//! * `backbone`: the networks, streamed in strips of rows.
//! * [`weights`]: the network weights that a metric needs, and their sources.

/// Implements `Display` by a type's `name`, and `FromStr` by the names of `ALL`.
macro_rules! by_name {
    ($type:ident, $unknown:ident) => {
        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.name())
            }
        }

        impl std::str::FromStr for $type {
            type Err = $unknown;

            fn from_str(name: &str) -> Result<Self, $unknown> {
                let known = Self::ALL.into_iter().find(|value| value.name() == name);
                known.ok_or_else(|| $unknown(name.to_owned()))
            }
        }
    };
}

mod backbone;
mod dists;
mod engines;
pub mod identity;
pub mod info;
mod lpips;
mod maps;
pub mod options;
pub mod picture;
pub mod psnr;
pub mod resize;
pub mod scorer;
pub mod selection;
mod simd;
mod ssim;
mod unavailable;
pub mod weights;

pub use identity::{
    Family, IdentityError, LpipsNet, LpipsVariant, Metric, MetricKey, MetricRegion,
};
pub use info::{BackboneInfo, Direction, MetricInfo, OwnWeights, term_names};
pub use maps::ScoreMap;
pub use options::{Arithmetic, Device, ScorerOptions};
pub use picture::{Mask, Picture, PictureError};
pub use psnr::psnr;
pub use resize::{ResizeKernel, resize};
pub use scorer::{AllTerms, Examined, Maps, Scorer, Scores, Terms};
pub use selection::{Selected, Selection, SelectionError};
pub use sharp_kernels::{Algorithm, InstructionSet, Simd};
pub use ssim::{
    SsimBorder, SsimCovariance, SsimForm, SsimVariant, SsimWindow, ssim, ssim_contrast,
};
pub use unavailable::{ScoreError, Unavailable};
pub use weights::{Backbone, Weights, WeightsError, WeightsSource, WeightsUsed};
