//! The wgpu backend: the same passes as WGSL compute shaders, one file each under `shaders/`.
//!
//! The depth order is computed once per frame; binning and rasterising run per sub-frame, a rectangle of tiles whose
//! buffers fit both the adapter's binding limit and 128 MiB. A sub-frame with too many pairs is split in half, so
//! nothing is ever truncated. No pass depends on timing: the same adapter and driver give the same bytes, whatever the
//! limits.
//!
//! No pass uses subgroup operations: ranking by masks in workgroup memory does not need them, and a single variant
//! means only one result to verify.

mod adapter;
mod buffers;
mod device;
mod frame;
mod layout;
mod memory;
mod passes;
mod readback;
mod scene;
mod sort;
mod subframe;
#[cfg(test)]
mod tests;

pub use adapter::{AdapterKind, GpuAdapter};

use super::renderer::{LoadedScene, TileSize, check_scene};
use super::{RenderError, RenderOutput, RenderView, Renderer, Support};
use crate::gaussians::Gaussians;
use device::Gpu;
use frame::{Frame, Work, tile_side};
use passes::Passes;
use scene::GpuScene;

/// Renders on a GPU. Reuses its buffers between frames.
///
/// Differs from the CPU only by rounding: for the same depth order, colour and alpha agree to about
/// 1e-5. Where rounding changes the outcome of a threshold, a pixel changes by at most 1/255.
pub struct GpuRenderer {
    gpu: Gpu,
    passes: Passes,
    work: Work,
    tile: u32,
}

impl GpuRenderer {
    /// Opens a device on an adapter, with the largest limits that it supports.
    ///
    /// # Errors
    /// [`RenderError::Device`] if the device cannot be opened.
    pub fn new(adapter: &GpuAdapter) -> Result<Self, RenderError> {
        let gpu = Gpu::open(adapter)?;
        let passes = Passes::new(&gpu.device);
        gpu.check()?;
        Ok(Self {
            work: Work::new(&gpu),
            gpu,
            passes,
            tile: tile_side(TileSize::Px8.pixels()),
        })
    }

    /// Limits buffer bindings to `bytes`: smaller sub-frames, less memory, the same picture. A scene needs 16 bytes per
    /// Gaussian in one binding.
    #[must_use]
    pub fn with_binding_limit(mut self, bytes: u64) -> Self {
        self.gpu.binding_limit = self.gpu.binding_limit.min(bytes);
        self
    }

    /// Sets the tile size; the default is 8×8 pixels, the minimum on a GPU.
    #[must_use]
    pub fn with_tile_size(self, tile: TileSize) -> Self {
        Self {
            tile: tile_side(tile.pixels()),
            ..self
        }
    }

    /// Peak total size of this renderer's device buffers in bytes, including buffers mapped by the host.
    pub fn peak_bytes(&self) -> u64 {
        self.gpu.memory.peak()
    }
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        format!("wgpu:{}", self.gpu.adapter)
    }

    /// # Errors
    /// As for [`Renderer::load`]. After a device fault, the renderer is unusable; open a new one.
    fn load<'a>(
        &'a mut self,
        scene: &'a Gaussians,
    ) -> Result<Box<dyn LoadedScene + 'a>, RenderError> {
        check_scene(scene)?;
        Ok(Box::new(Uploaded {
            on_device: GpuScene::upload(&self.gpu, scene)?,
            renderer: self,
        }))
    }
}

/// A scene uploaded to the device.
struct Uploaded<'a> {
    on_device: GpuScene,
    renderer: &'a mut GpuRenderer,
}

impl LoadedScene for Uploaded<'_> {
    fn render(&mut self, view: &RenderView) -> Result<RenderOutput, RenderError> {
        self.frame(view, true)
    }

    fn draw_on_device(&mut self, view: &RenderView) -> Result<bool, RenderError> {
        self.frame(view, false).map(|_| true)
    }
}

impl Uploaded<'_> {
    /// Draws a view. If `copied` is false, the pixels stay on the device and the returned picture is black.
    fn frame(&mut self, view: &RenderView, copied: bool) -> Result<RenderOutput, RenderError> {
        view.check()?;
        let renderer = &mut *self.renderer;
        let frame = Frame {
            gpu: &renderer.gpu,
            passes: &renderer.passes,
            scene: &self.on_device,
            view,
            copied,
            tile: match view.rule.support {
                Support::Exact => renderer.tile,
                Support::Tiles => renderer.tile.min(tile_side(TileSize::Px16.pixels())),
            },
        };
        frame.render(&mut renderer.work)
    }
}
