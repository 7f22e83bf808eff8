//! Gaussians to pictures: the forward pass of the SHARP release, gsplat 1.5.3's classic mode,
//! restated so that every backend computes one definition.
//!
//! # The definition
//! Per Gaussian: `p = L μ + t`, dropped unless `near ≤ z ≤ far`; the covariance goes through the
//! view's linear part and the Jacobian of the projection at a point clamped to 1.3 half fields of
//! view; `eps2d` is added to the diagonal. Per pixel, centre (i + 0.5, j + 0.5), front to back by
//! the z of the centres (f32, ties by index): `α = min(0.999, o·exp(−σ))`, skipped below 1/255,
//! stopped before `T` would fall to 1e-4. Colours are linear light, premultiplied, without a
//! background; depth is `Σ w z`. Non-finite Gaussians are dropped and counted.
//!
//! # Contents
//! * [`RenderView`]: where the camera stands and which knobs of the definition are turned.
//! * [`Renderer`]: what every backend does; [`CpuRenderer`]: the one without a GPU;
//!   `GpuRenderer` (feature `gpu`): the one on wgpu.
//! * [`RenderOutput`]: linear colour, alpha, depth, [`Dropped`] by reason; its methods are the
//!   post step: [`Background`], sRGB, 8 bit, expected depth.
//! * [`trajectory`]: the release's camera paths; [`turbo`]: colours for inverse depth.
//!
//! The passes carry the same names in every backend: `project`, `emit`, `order`, `tiles`,
//! `raster`, `post`.

mod colormap;
mod cpu;
mod emit;
#[cfg(feature = "gpu")]
mod gpu;
mod order;
mod output;
mod post;
mod project;
mod raster;
mod renderer;
mod simd;
mod tiles;
pub mod trajectory;
mod view;

#[cfg(feature = "gpu")]
pub use gpu::{GpuAdapter, GpuRenderer, GpuScene};

pub use colormap::turbo;
pub use cpu::{CpuRenderer, TileSize, render_cpu};
pub use output::{Dropped, RenderOutput};
pub use post::Background;
pub use renderer::{RenderError, Renderer};
pub use simd::SimdLevel;
pub use view::RenderView;
