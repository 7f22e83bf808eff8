//! Gaussians to pictures: one definition, parameterised by a [`Rule`] and implemented identically by every backend.
//! [`Rule::SHARP`] is the SHARP release's, i.e. gsplat 1.5.3's classic mode.
//!
//! # The definition
//! Per Gaussian: `p = L μ + t`, dropped unless `near ≤ z ≤ far`. The covariance is transformed by the view's linear
//! part and by the Jacobian of the projection at a clamped point. The low-pass is added to the covariance's diagonal,
//! and the opacity may be scaled to compensate. Colours depend on the direction from the camera through
//! [harmonics](crate::gaussians::Harmonics).
//!
//! Per pixel, with centre (i + 0.5, j + 0.5), Gaussians are blended front to back by the z of their centres (f32, ties
//! by index): `α = min(alpha_max, o·exp(−σ))`, skipped below 1/255, stopped before `T` would fall to 1e-4. Colours are
//! premultiplied, without a background; depth is `Σ w z`. Non-finite Gaussians are dropped and counted.
//!
//! # Contents
//! * [`RenderView`]: the camera and the [`Rule`] of a picture.
//! * [`Backend`]: choice of a backend; [`Renderer`]: the interface of every backend; [`LoadedScene`]: many views of one
//!   scene; [`CpuRenderer`]: the CPU backend; `GpuRenderer` and `GpuAdapter` (feature `gpu`): the wgpu backend.
//! * [`CpuRenderer::backward`]: derivative with SHARP's rule, for training; [`covariances`] and their derivative.
//! * [`RenderOutput`]: colour, alpha, depth, [`Dropped`] by reason; its methods are the post step: [`Background`],
//!   sRGB, 8 bit, expected depth.
//! * [`release_screen`]: the release's half-pixel shift and sizes; [`turbo`]: colours for inverse depth.
//!
//! # Passes
//! `project` (→ `harmonics`) → `scan` → `radix` (front to back) → `emit` → `radix` (by tile) → `ranges` → `raster`.
//! Each pass is a file here and a WGSL file of the same name under `shaders/`; tests compare the two. The CPU first
//! emits into bins of 64×64 pixels and sorts within each. `post` exists only on the host: every backend must encode and
//! quantise to the same levels, which WGSL's `pow` does not guarantee, and scoring needs the f32 picture anyway.

mod backend;
mod backward;
mod colormap;
mod cpu;
mod emit;
mod error;
#[cfg(feature = "gpu")]
mod gpu;
mod harmonics;
mod output;
mod post;
mod project;
mod radix;
mod ranges;
mod raster;
mod renderer;
mod rule;
mod scan;
mod screen;
mod simd;
mod view;

#[cfg(feature = "gpu")]
pub use gpu::{AdapterKind, GpuAdapter, GpuRenderer};

pub use backend::{Backend, UnknownBackend};
pub(crate) use backward::narrow;
pub use backward::{GaussianGradient, PictureGradient, backward_covariances, covariances};
pub use colormap::turbo;
pub use cpu::CpuRenderer;
pub use error::RenderError;
pub use output::{Dropped, RenderOutput};
pub use post::Background;
pub use renderer::{LoadedScene, Renderer, TileSize};
pub use rule::{Compensation, JacobianClamp, NearPlane, PrincipalPoint, Rule, RuleError, Support};
pub use screen::release_screen;
pub use sharp_kernels::Simd;
pub use view::{RenderView, ShaderConstants};
