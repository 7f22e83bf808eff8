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
//! * [`Backend`]: a choice among them; [`Renderer`]: what every backend does, [`LoadedScene`] for
//!   many views of one scene; [`CpuRenderer`]: the one without a GPU; `GpuRenderer` and
//!   `GpuAdapter` (feature `gpu`): the one on wgpu.
//! * [`CpuRenderer::backward`]: the derivative of the definition, for training;
//!   [`covariances`] with theirs.
//! * [`RenderOutput`]: linear colour, alpha, depth, [`Dropped`] by reason; its methods are the
//!   post step: [`Background`], sRGB, 8 bit, expected depth.
//! * [`trajectory`]: the release's camera paths; [`release_screen`]: its half-pixel shift and sizes;
//!   [`turbo`]: colours for inverse depth.
//!
//! # Passes
//! `project` → `scan` → `radix` (front to back) → `emit` → `radix` (by tile) → `ranges` →
//! `raster`: each a file here and a file of WGSL under `shaders/`, by the same name, and tests hold
//! one against the other. The CPU emits into bins of 64×64 pixels first and sorts within each.
//! `post` exists once, on the host: encoding and quantisation must give every backend the same
//! levels, which WGSL's `pow` does not promise, and scoring wants the f32 picture anyway.

mod backend;
mod backward;
mod colormap;
mod cpu;
mod emit;
#[cfg(feature = "gpu")]
mod gpu;
mod output;
mod post;
mod project;
mod radix;
mod ranges;
mod raster;
mod renderer;
mod scan;
mod screen;
mod simd;
pub mod trajectory;
mod view;

#[cfg(feature = "gpu")]
pub use gpu::{AdapterKind, GpuAdapter, GpuRenderer};

pub use backend::{Backend, UnknownBackend};
pub(crate) use backward::narrow;
pub use backward::{GaussianGradient, PictureGradient, backward_covariances, covariances};
pub use colormap::turbo;
pub use cpu::CpuRenderer;
pub use output::{Dropped, RenderOutput};
pub use post::Background;
pub use renderer::{LoadedScene, RenderError, Renderer, TileSize};
pub use screen::release_screen;
pub use sharp_kernels::Simd;
pub use view::RenderView;
