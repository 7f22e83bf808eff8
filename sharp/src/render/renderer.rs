//! The interface of all backends.

use super::{RenderError, RenderOutput, RenderView};
use crate::gaussians::Gaussians;

/// A rendering backend; all backends implement the same definition.
pub trait Renderer: Send {
    /// Backend and variant, for records: `cpu-avx512`, `wgpu:<adapter>`.
    fn name(&self) -> String;

    /// Prepares a scene for rendering from many views: checks it and, on a GPU, uploads it.
    ///
    /// # Errors
    /// [`RenderError::Scene`], [`RenderError::TooMany`], and errors of the device.
    fn load<'a>(
        &'a mut self,
        scene: &'a Gaussians,
    ) -> Result<Box<dyn LoadedScene + 'a>, RenderError>;

    /// Renders one view.
    ///
    /// # Errors
    /// See [`RenderError`].
    fn render(
        &mut self,
        scene: &Gaussians,
        view: &RenderView,
    ) -> Result<RenderOutput, RenderError> {
        self.load(scene)?.render(view)
    }

    /// Renders several views of one scene, loaded once, and passes on each picture as it is finished.
    ///
    /// # Errors
    /// The first error ends the batch.
    fn render_views(
        &mut self,
        scene: &Gaussians,
        views: &[RenderView],
        done: &mut dyn FnMut(usize, RenderOutput),
    ) -> Result<(), RenderError> {
        let mut loaded = self.load(scene)?;
        for (index, view) in views.iter().enumerate() {
            done(index, loaded.render(view)?);
        }
        Ok(())
    }
}

/// A scene prepared by a [`Renderer`].
pub trait LoadedScene {
    /// Renders one view.
    ///
    /// # Errors
    /// [`RenderError::View`], [`RenderError::Size`], and errors of the device.
    fn render(&mut self, view: &RenderView) -> Result<RenderOutput, RenderError>;

    /// Draws one view and waits until the device has finished, without copying the picture to the host; for timing.
    /// Returns false without drawing on backends that draw in the host's memory.
    ///
    /// # Errors
    /// As for [`LoadedScene::render`].
    fn draw_on_device(&mut self, _view: &RenderView) -> Result<bool, RenderError> {
        Ok(false)
    }
}

/// Side of the tiles that have their own list of Gaussians. The size affects only speed, not the
/// picture's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TileSize {
    /// 4×4 pixels, the CPU's default: one set of lanes.
    Px4,
    /// 8×8 pixels, the GPU's default.
    Px8,
    /// 16×16 pixels, as in gsplat.
    Px16,
    /// 32×32 pixels.
    Px32,
}

impl TileSize {
    pub(super) fn pixels(self) -> usize {
        match self {
            Self::Px4 => 4,
            Self::Px8 => 8,
            Self::Px16 => 16,
            Self::Px32 => 32,
        }
    }
}

/// Checks a scene's size, and that all arrays have the same length, which a struct literal can get
/// wrong.
pub(super) fn check_scene(scene: &Gaussians) -> Result<(), RenderError> {
    scene.check_lengths()?;
    match u32::try_from(scene.len()) {
        Ok(_) => Ok(()),
        Err(_) => Err(RenderError::TooMany(scene.len())),
    }
}
