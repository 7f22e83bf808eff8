//! The SHARP network: one photograph to refined Gaussians.
//!
//! Modules and their parameters are named as in the official checkpoint, which therefore loads
//! without renaming. Internally, images are f32 tensors `[1, height, width, channels]`; public
//! inputs and outputs are planes `[channels, height, width]`.
//!
//! # Contents, in the order of computation
//! * [`config`]: sizes of a network, the release's preset, configurations in files.
//! * [`bundled`]: the small network bundled with the source code.
//! * [`params`], [`synth`]: sources of weights; [`inventory`]: the parameters that a source must provide.
//! * [`preprocess`]: a photograph, its orientation and focal length.
//! * [`Compute`]: the device; `ops`: operations, by candle on any device or by this project's kernels (as candle custom
//!   ops) on the CPU; [`FrozenConvolution`], [`max_pool`]: operations of networks that evaluate pictures; [`pull`]:
//!   gradients; `layers`: operations with parameters.
//! * `pyramid`, `vit`: patches at three scales through two transformers, merged into five maps.
//! * `decoder`, `monodepth`: from the maps to two layers of disparity.
//! * `alignment`: a scale map from predicted to known depth.
//! * `gaussian_decoder`: from maps, image and depth to deltas.
//! * `network`: all modules; [`NetworkSpec`]: which network to open; [`predictor`]: the complete prediction, with
//!   [`initializer`](crate::initializer) and [`composer`](crate::composer).
//! * [`training`]: forward passes with gradients.
//! * [`depth_pro`]: Depth Pro, whose encoder and decoder the depth network shares.
//! * [`recording`]: recordings of all stages of a prediction, and comparison with those of another implementation.

mod alignment;
pub mod bundled;
mod compute;
pub mod config;
mod decoder;
pub mod depth_pro;
mod error;
mod gaussian_decoder;
pub mod inventory;
mod layers;
mod monodepth;
mod network;
mod network_spec;
mod observer;
mod ops;
pub mod params;
pub mod predictor;
pub mod preprocess;
mod pyramid;
pub mod recording;
pub mod synth;
pub mod training;
mod vit;

pub use compute::{Compute, DeviceChoice};
pub use config::ModelConfig;
pub use error::ModelError;
pub use network_spec::{NetworkIdentity, NetworkSpec};
pub use observer::{Silent, StageObserver, StageProgress, StageValue};
pub use ops::{FrozenConvolution, max_pool, pull};
pub use predictor::{NetworkOutput, Predictor};
pub use sharp_kernels::Algorithm;
