//! The interface of all backends, and their errors.

use super::{RenderOutput, RenderView};
use crate::gaussians::{Gaussians, LengthMismatch};

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// The view contains a NaN, an infinity or an impossible parameter.
    #[error("cannot render this view: {0}")]
    View(String),
    /// The image is empty or a side exceeds [`RenderView::MAX_SIDE`].
    #[error(
        "cannot render an image of {width}x{height} pixels (1 to {} a side)",
        RenderView::MAX_SIDE
    )]
    Size { width: u32, height: u32 },
    /// The scene has more Gaussians than a 32-bit index allows.
    #[error("cannot render {0} Gaussians, at most {max} fit", max = u32::MAX)]
    TooMany(usize),
    #[error(transparent)]
    Scene(#[from] LengthMismatch),
    #[error("{0}")]
    NoAdapter(String),
    /// A GPU could not be opened or failed to do its work. The CPU can be used instead.
    #[error("{adapter}: {what}")]
    Device { adapter: String, what: String },
    /// A GPU was lost: driver reset, timeout, or unplugged. The renderer is unusable; the CPU can be used instead.
    #[error("{adapter} was lost: {what}")]
    DeviceLost { adapter: String, what: String },
    /// A GPU has insufficient memory for the scene or the picture. The CPU can be used instead.
    #[error("{adapter} is out of memory: {what}")]
    OutOfMemory { adapter: String, what: String },
}

impl RenderError {
    /// True if the GPU failed rather than the request: the same scene and view may be rendered on the CPU, or again
    /// later.
    pub fn is_device_fault(&self) -> bool {
        matches!(
            self,
            Self::Device { .. } | Self::DeviceLost { .. } | Self::OutOfMemory { .. }
        )
    }
}

/// A rendering backend; all backends implement the same definition.
pub trait Renderer: Send {
    /// Backend and variant, for records: `cpu-avx512`, `wgpu:<adapter>`.
    fn name(&self) -> String;

    /// Prepares a scene for rendering from many views: checks it and, on a GPU, uploads it.
    ///
    /// # Errors
    /// [`RenderError::Scene`], [`RenderError::TooMany`], and those of the device.
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
    /// [`RenderError::View`], [`RenderError::Size`], and those of the device.
    fn render(&mut self, view: &RenderView) -> Result<RenderOutput, RenderError>;
}

/// Side of the tiles that have their own list of Gaussians. Affects speed only: the picture's bytes do not depend on
/// it.
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

/// Checks a scene's size and the consistency of its lengths, which a struct literal can get wrong.
pub(super) fn check_scene(scene: &Gaussians) -> Result<(), RenderError> {
    scene.check_lengths()?;
    match u32::try_from(scene.len()) {
        Ok(_) => Ok(()),
        Err(_) => Err(RenderError::TooMany(scene.len())),
    }
}
