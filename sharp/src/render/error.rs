//! Errors of every backend.

use crate::gaussians::LengthMismatch;

/// Maximum width and height in pixels.
pub(super) const MAX_SIDE: u32 = 65_535;

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// The view contains a NaN, an infinity or an impossible parameter.
    #[error("cannot render this view: {0}")]
    View(String),
    /// The image is empty or a side exceeds [`RenderView::MAX_SIDE`](super::RenderView::MAX_SIDE).
    #[error(
        "cannot render an image of {width}x{height} pixels (1 to {} per side)",
        MAX_SIDE
    )]
    Size { width: u32, height: u32 },
    /// The scene has more Gaussians than a 32-bit index allows.
    #[error("cannot render {0} Gaussians; at most {max} fit", max = u32::MAX)]
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
    /// True if the GPU failed, not the request: the same scene and view may be rendered on the CPU,
    /// or again later.
    pub fn is_device_fault(&self) -> bool {
        matches!(
            self,
            Self::Device { .. } | Self::DeviceLost { .. } | Self::OutOfMemory { .. }
        )
    }
}
