//! The SHARP network: one photograph to refined Gaussians.
//!
//! Modules and their parameters are named as in the official checkpoint, so that it loads without
//! renaming. Images are f32 tensors `[1, height, width, channels]`, those that are taken and given
//! are planes `[channels, height, width]`.
//!
//! # Contents, in the order of computation
//! * [`config`]: sizes of a network, the release's preset, configurations in files.
//! * [`bundled`]: the small network that comes with these sources.
//! * [`params`], [`synth`]: where weights come from; [`inventory`]: which there have to be.
//! * [`preprocess`]: a photograph, its orientation and focal length.
//! * [`Compute`]: where the network runs; `ops`: its operations, by candle on any device or, on the CPU, by our
//!   kernels as candle's custom operations; [`FrozenConvolution`], [`max_pool`]: those of networks that judge pictures;
//!   [`pull`]: gradients; `layers`: operations with parameters.
//! * `pyramid`, `vit`: patches at three scales through two transformers, merged to five maps.
//! * `decoder`, `monodepth`: the maps to two layers of disparity.
//! * `alignment`: a scale map towards known depth.
//! * `gaussian_decoder`: maps, image and depth to deltas.
//! * `network`: the modules; [`NetworkSpec`]: which one to open; [`predictor`]: all of it, with [`initializer`](crate::initializer) and
//!   [`composer`](crate::composer).
//! * [`training`]: passes that gradients can go back through.
//! * [`recording`]: every stage written down, or compared with what another implementation wrote.

mod alignment;
pub mod bundled;
mod compute;
pub mod config;
mod decoder;
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
