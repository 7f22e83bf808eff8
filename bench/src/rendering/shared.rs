//! The one renderer of a run.

use std::sync::{Mutex, PoisonError};

use sharp::gaussians::Gaussians;
use sharp::render::{Backend, CpuRenderer, RenderError, RenderOutput, RenderView, Renderer};

/// A renderer that methods share. Nothing takes over from it: a device that fails ends the run, which can be resumed.
pub struct SharedRenderer {
    name: String,
    renderer: Mutex<Box<dyn Renderer>>,
}

impl SharedRenderer {
    pub fn new(renderer: Box<dyn Renderer>) -> Self {
        Self {
            name: renderer.name(),
            renderer: Mutex::new(renderer),
        }
    }

    pub fn cpu() -> Self {
        Self::new(Box::new(CpuRenderer::new()))
    }

    pub fn open(backend: &Backend) -> Result<Self, RenderError> {
        backend.open().map(Self::new)
    }

    /// The exact backend, for records and keys: `cpu-avx512`, `wgpu:<adapter, driver>`.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn render(
        &self,
        scene: &Gaussians,
        view: &RenderView,
    ) -> Result<RenderOutput, RenderError> {
        let mut renderer = self.renderer.lock().unwrap_or_else(PoisonError::into_inner);
        renderer.render(scene, view)
    }
}

impl std::fmt::Debug for SharedRenderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SharedRenderer")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}
