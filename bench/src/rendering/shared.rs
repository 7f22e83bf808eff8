//! The single renderer of a run.

use std::sync::{Mutex, PoisonError};

use glam::DAffine3;
use image::RgbImage;
use sharp::camera::Intrinsics;
use sharp::color::Quantization;
use sharp::gaussians::Gaussians;
use sharp::render::{
    Backend, Background, CpuRenderer, LoadedScene, RenderError, RenderOutput, RenderView, Renderer,
    Rule,
};
use sharp_datasets::DepthMap;

/// Alpha below which a pixel counts as a hole, because it shows more background than surface.
pub const HOLE_ALPHA: f32 = 0.5;

/// Settings other than the backend that determine a rendering's pixels. The paper does not state
/// these settings. The defaults are the release's, except that the release truncates when
/// converting to 8 bit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderSettings {
    /// Variance in px² that is added to both diagonal entries of projected covariances, for
    /// Gaussians without their own rendering rule.
    pub eps2d: f32,
    /// Background in the rule's blending space.
    pub background: Background,
    /// Rounding from 0..1 to 8 bit.
    pub quantization: Quantization,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            eps2d: RenderView::EPS2D_RELEASE,
            background: Background::Black,
            quantization: Quantization::Round,
        }
    }
}

/// The renderer shared by all methods. If its device fails, the run ends and can be resumed.
pub struct SharedRenderer {
    name: String,
    settings: RenderSettings,
    renderer: Mutex<Box<dyn Renderer>>,
}

impl SharedRenderer {
    pub fn new(renderer: Box<dyn Renderer>, settings: RenderSettings) -> Self {
        Self {
            name: renderer.name(),
            settings,
            renderer: Mutex::new(renderer),
        }
    }

    pub fn cpu() -> Self {
        Self::new(Box::new(CpuRenderer::new()), RenderSettings::default())
    }

    pub fn open(backend: &Backend, settings: RenderSettings) -> Result<Self, RenderError> {
        Ok(Self::new(backend.open()?, settings))
    }

    pub fn settings(&self) -> RenderSettings {
        self.settings
    }

    /// Exact name of the backend for records and keys: `cpu-avx512`, `wgpu:<adapter, driver>`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Renders a scene from a camera; `camera_from_scene` may be any affine map. Without a `rule`, uses SHARP's rule
    /// with this renderer's low-pass.
    pub fn render(
        &self,
        scene: &Gaussians,
        camera_from_scene: DAffine3,
        intrinsics: Intrinsics,
        rule: Option<Rule>,
    ) -> Result<RenderOutput, RenderError> {
        let view = self.view(camera_from_scene, intrinsics, rule);
        self.with_loaded(scene, |loaded| loaded.render(&view))
    }

    /// A view with this renderer's settings.
    pub fn view(
        &self,
        camera_from_scene: DAffine3,
        intrinsics: Intrinsics,
        rule: Option<Rule>,
    ) -> RenderView {
        let view = RenderView::new(camera_from_scene, intrinsics);
        match rule {
            Some(rule) => RenderView { rule, ..view },
            None => view.with_low_pass(self.settings.eps2d),
        }
    }

    /// Loads the scene and calls `work` with it.
    pub fn with_loaded<T>(
        &self,
        scene: &Gaussians,
        work: impl FnOnce(&mut dyn LoadedScene) -> Result<T, RenderError>,
    ) -> Result<T, RenderError> {
        let mut renderer = self.renderer.lock().unwrap_or_else(PoisonError::into_inner);
        work(renderer.load(scene)?.as_mut())
    }

    /// The scored picture of a rendering: composited, sRGB-encoded, 8 bit.
    pub fn picture(&self, rendering: &RenderOutput) -> RgbImage {
        rendering.srgb8(self.settings.background, self.settings.quantization)
    }
}

/// Expected z-depth of a rendering, metres; 0 in holes.
pub fn surface_depth(output: &RenderOutput) -> DepthMap {
    let mut depth = output.expected_depth();
    for (depth, &alpha) in depth.iter_mut().zip(&output.alpha) {
        if alpha < HOLE_ALPHA {
            *depth = 0.0;
        }
    }
    depth
}

impl std::fmt::Debug for SharedRenderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SharedRenderer")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}
