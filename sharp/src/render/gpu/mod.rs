//! The backend on wgpu: the same passes as WGSL compute shaders, one file each under `shaders/`.
//!
//! Depth order is made once a frame; binning and rasterising run per sub-frame, a rectangle of
//! tiles whose buffers fit the adapter's binding limit and 128 MiB. A sub-frame with too many pairs
//! is cut in half, so nothing is ever truncated. No pass depends on timing: the same adapter and
//! driver give the same bytes, whatever the limits.
//!
//! No pass uses subgroup operations: ranking by masks in workgroup memory needs none, and one
//! variant is one set of bytes to vouch for.

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

/// Renders on a GPU. Keeps its buffers between frames.
///
/// Differs from the CPU by rounding only: on the same order of depths colour and alpha agree to
/// about 1e-5, and a threshold that falls the other way moves a pixel by at most 1/255.
pub struct GpuRenderer {
    gpu: Gpu,
    passes: Passes,
    work: Work,
    tile: u32,
}

impl GpuRenderer {
    /// Opens a device on an adapter, with the largest limits that it grants.
    ///
    /// # Errors
    /// [`RenderError::Device`] when the device cannot be opened.
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

    /// The same renderer with no buffer binding above `bytes`: smaller sub-frames, less memory,
    /// the same picture. A scene needs 16 bytes a Gaussian in one binding.
    #[must_use]
    pub fn with_binding_limit(mut self, bytes: u64) -> Self {
        self.gpu.binding_limit = self.gpu.binding_limit.min(bytes);
        self
    }

    /// The same renderer with another tile size than 8×8, the least there is on a GPU.
    #[must_use]
    pub fn with_tile_size(self, tile: TileSize) -> Self {
        Self {
            tile: tile_side(tile.pixels()),
            ..self
        }
    }

    /// The most bytes that this renderer's buffers ever took on the device together, those that
    /// the host maps included.
    pub fn peak_bytes(&self) -> u64 {
        self.gpu.memory.peak()
    }
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        format!("wgpu:{}", self.gpu.adapter)
    }

    /// # Errors
    /// After a fault of the device the renderer is not usable any more: open another one.
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

/// A scene on the device.
struct Uploaded<'a> {
    on_device: GpuScene,
    renderer: &'a mut GpuRenderer,
}

impl LoadedScene for Uploaded<'_> {
    fn render(&mut self, view: &RenderView) -> Result<RenderOutput, RenderError> {
        view.check()?;
        let renderer = &mut *self.renderer;
        let frame = Frame {
            gpu: &renderer.gpu,
            passes: &renderer.passes,
            scene: &self.on_device,
            view,
            tile: match view.rule.support {
                Support::Exact => renderer.tile,
                Support::Tiles => renderer.tile.min(tile_side(TileSize::Px16.pixels())),
            },
        };
        frame.render(&mut renderer.work)
    }
}
