//! Image metrics of view synthesis: PSNR, SSIM, LPIPS and DISTS.
//!
//! A number means nothing without its identity: every variant that public code computes under the
//! same name has a [`MetricKey`] of its own, and a variant that cannot be computed is
//! [`Unavailable`] with the reason, never zero and never replaced by another one. Knows no dataset
//! and no camera.
//!
//! # Contents
//! * [`identity`]: the keys, what they mean, which public code computes the same.
//! * [`facts`]: what decides a number besides its key: ranges, resizing, precision, weights.
//! * [`selection`]: lists of keys as typed on a command line.
//! * [`picture`]: pictures and masks as the metrics take them.
//! * [`mod@resize`]: the resizing functions of torch, PIL and OpenCV, by name.
//! * [`scorer`]: all selected metrics of a pair; `options`: how they are computed; `score_map`: their local values;
//!   `unavailable`: why there is none.
//! * `psnr`, `ssim`, `lpips`, `dists`: the metrics themselves.
//! * [`device`]: where the networks of the last two are computed.
//! * `engines`: the learned metrics that a scorer needs, each pass of a network made once.
//! * `backbone`: the networks behind the last two, streamed in row strips.
//! * [`weights`]: which network weights a metric needs and where they come from.

mod backbone;
pub mod device;
mod dists;
mod engines;
mod explain;
pub mod facts;
pub mod identity;
mod lpips;
mod options;
pub mod picture;
mod psnr;
pub mod resize;
mod score_map;
pub mod scorer;
pub mod selection;
mod simd;
mod spatial;
mod ssim;
mod unavailable;
pub mod weights;

pub use device::Device;
pub use facts::{Facts, OwnWeights, term_names};
pub use identity::{
    Family, IdentityError, LpipsNet, LpipsVariant, Metric, MetricKey, Region, SsimVariant,
};
pub use options::ScorerOptions;
pub use picture::{Mask, Picture, PictureError};
pub use resize::{ResizeKernel, resize};
pub use score_map::ScoreMap;
pub use scorer::{AllTerms, Examined, Maps, Scorer, Scores, Terms};
pub use selection::{Selected, Selection, SelectionError};
pub use sharp_kernels::{Algorithm, Level, Simd};
pub use unavailable::{ScoreError, Unavailable};
pub use weights::{Backbone, Weights, WeightsError, WeightsUsed};
