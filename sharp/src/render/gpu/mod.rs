//! The backend on wgpu: the same passes as WGSL compute shaders, one file each under `shaders/`.
//!
//! Depth order is made once a frame; binning and rasterising run per sub-frame, a rectangle of
//! tiles whose buffers fit the adapter's binding limit. A sub-frame with too many pairs is cut in
//! half, so nothing is ever truncated. No pass depends on timing: the same adapter and driver give
//! the same bytes, whatever the limits.

mod adapter;
mod buffers;
mod device;
mod frame;
mod passes;
mod scene;
mod sort;

pub use adapter::GpuAdapter;
pub use scene::GpuScene;

use super::project::depths;
use super::renderer::check_scene;
use super::{RenderError, RenderOutput, RenderView, Renderer};
use crate::gaussians::Gaussians;
use device::Gpu;
use passes::Passes;

/// Renders on a GPU.
///
/// Differs from the CPU by rounding only: on the same order of depths colour and alpha agree to
/// about 1e-5, and a threshold that falls the other way moves a pixel by at most 1/255.
pub struct GpuRenderer {
    gpu: Gpu,
    passes: Passes,
    host_order: bool,
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
            gpu,
            passes,
            host_order: false,
        })
    }

    /// The same renderer with no buffer binding above `bytes`: smaller sub-frames, less memory,
    /// the same picture. A scene needs 16 bytes a Gaussian in one binding.
    #[must_use]
    pub fn with_binding_limit(mut self, bytes: u64) -> Self {
        self.gpu.binding_limit = self.gpu.binding_limit.min(bytes);
        self
    }

    /// The same renderer with depths computed and sorted on the host in f64, as the CPU backend
    /// does: adapters then agree on the order of near-equal depths.
    #[must_use]
    pub fn with_host_order(self, host_order: bool) -> Self {
        Self { host_order, ..self }
    }

    /// Brings a scene onto the device.
    ///
    /// # Errors
    /// [`RenderError::Scene`]; [`RenderError::Device`] when the device has no room for it.
    pub fn upload(&self, scene: &Gaussians) -> Result<GpuScene, RenderError> {
        check_scene(scene)?;
        GpuScene::upload(&self.gpu, scene)
    }

    /// Renders a view of a scene on the device.
    ///
    /// # Errors
    /// See [`RenderError`]; after [`RenderError::Device`] the renderer is not usable any more.
    pub fn render_uploaded(
        &self,
        scene: &GpuScene,
        view: &RenderView,
    ) -> Result<RenderOutput, RenderError> {
        view.check()?;
        let order = self
            .host_order
            .then(|| super::order::indices(&depths(scene.means(), view)));
        frame::render(&self.gpu, &self.passes, scene, view, order.as_deref())
    }
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        let order = if self.host_order { ", host order" } else { "" };
        format!("wgpu:{}{order}", self.gpu.adapter)
    }

    fn render(
        &mut self,
        scene: &Gaussians,
        view: &RenderView,
    ) -> Result<RenderOutput, RenderError> {
        let scene = self.upload(scene)?;
        self.render_uploaded(&scene, view)
    }

    fn render_views(
        &mut self,
        scene: &Gaussians,
        views: &[RenderView],
        done: &mut dyn FnMut(usize, RenderOutput),
    ) -> Result<(), RenderError> {
        let scene = self.upload(scene)?;
        for (index, view) in views.iter().enumerate() {
            done(index, self.render_uploaded(&scene, view)?);
        }
        Ok(())
    }
}
