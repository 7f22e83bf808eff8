//! What every backend does, and how it can fail.

use super::{RenderOutput, RenderView};
use crate::gaussians::{Gaussians, LengthMismatch};

/// Why nothing could be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// The view holds a NaN, an infinity or an impossible parameter.
    #[error("cannot render this view: {0}")]
    View(String),
    /// The image is empty or a side exceeds [`RenderView::MAX_SIDE`].
    #[error(
        "cannot render an image of {width}x{height} pixels (1 to {} a side)",
        RenderView::MAX_SIDE
    )]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// More Gaussians than an index of 32 bits can name.
    #[error("cannot render {0} Gaussians, at most {max} fit", max = u32::MAX)]
    TooMany(usize),
    /// The scene's arrays differ in length.
    #[error(transparent)]
    Scene(#[from] LengthMismatch),
    /// A GPU could not be opened, ran out of memory, or was lost. The CPU can take over.
    #[error("{adapter}: {what}")]
    Device {
        /// Which GPU.
        adapter: String,
        /// What it or its driver said.
        what: String,
    },
}

/// A backend of the one definition.
pub trait Renderer {
    /// Which backend and which variant of it, for records: `cpu-avx512`, `wgpu:<adapter>`.
    fn name(&self) -> String;

    /// Renders one view.
    ///
    /// # Errors
    /// See [`RenderError`].
    fn render(&mut self, scene: &Gaussians, view: &RenderView)
    -> Result<RenderOutput, RenderError>;

    /// Renders several views of one scene, handing each picture over as it is done: what a
    /// backend does once per scene (an upload) is paid once.
    ///
    /// # Errors
    /// The first view that fails ends the batch.
    fn render_views(
        &mut self,
        scene: &Gaussians,
        views: &[RenderView],
        done: &mut dyn FnMut(usize, RenderOutput),
    ) -> Result<(), RenderError> {
        for (index, view) in views.iter().enumerate() {
            done(index, self.render(scene, view)?);
        }
        Ok(())
    }
}

/// Checks the scene's lengths, which a struct literal can get wrong, and its size.
pub(super) fn check_scene(scene: &Gaussians) -> Result<(), RenderError> {
    let n = scene.means.len();
    if [
        scene.quaternions.len(),
        scene.scales.len(),
        scene.opacities.len(),
        scene.colors.len(),
    ] != [n; 4]
    {
        return Err(LengthMismatch {
            means: n,
            quaternions: scene.quaternions.len(),
            scales: scene.scales.len(),
            opacities: scene.opacities.len(),
            colors: scene.colors.len(),
        }
        .into());
    }
    if u32::try_from(n).is_err() {
        return Err(RenderError::TooMany(n));
    }
    Ok(())
}
