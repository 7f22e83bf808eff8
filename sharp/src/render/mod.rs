//! Gaussians to pictures: one definition with the choices of a [`Rule`], computed alike by every
//! backend. [`Rule::SHARP`] is the SHARP release, gsplat 1.5.3's classic mode.
//!
//! # The definition
//! Per Gaussian: `p = L μ + t`, dropped unless `near ≤ z ≤ far`; the covariance goes through the
//! view's linear part and the Jacobian of the projection at a clamped point; the low-pass is added
//! to the diagonal, and the opacity may make up for it. Colours depend on the direction from the
//! camera through [harmonics](crate::gaussians::Harmonics). Per pixel, centre (i + 0.5, j + 0.5),
//! front to back by the z of the centres (f32, ties by index): `α = min(alpha_max, o·exp(−σ))`,
//! skipped below 1/255, stopped before `T` would fall to 1e-4. Colours are premultiplied, without a
//! background; depth is `Σ w z`. Non-finite Gaussians are dropped and counted.
//!
//! # Contents
//! * [`RenderView`]: where the camera stands, and by which [`Rule`] it is rendered.
//! * [`Backend`]: a choice among them; [`Renderer`]: what every backend does, [`LoadedScene`] for
//!   many views of one scene; [`CpuRenderer`]: the one without a GPU; `GpuRenderer` and
//!   `GpuAdapter` (feature `gpu`): the one on wgpu.
//! * [`CpuRenderer::backward`]: the derivative by SHARP's rule, for training;
//!   [`covariances`] with theirs.
//! * [`RenderOutput`]: colour, alpha, depth, [`Dropped`] by reason; its methods are the
//!   post step: [`Background`], sRGB, 8 bit, expected depth.
//! * [`trajectory`]: the release's camera paths; [`release_screen`]: its half-pixel shift and sizes;
//!   [`turbo`]: colours for inverse depth.
//!
//! # Passes
//! `project` (→ `harmonics`) → `scan` → `radix` (front to back) → `emit` → `radix` (by tile) → `ranges` →
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
pub use rule::{Compensation, JacobianClamp, NearPlane, PrincipalPoint, Rule, RuleError, Support};
pub use screen::release_screen;
pub use sharp_kernels::Simd;
pub use view::{RenderView, ShaderConstants};
