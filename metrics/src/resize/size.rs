//! Width and height.

/// Width and height of a picture of interleaved RGB, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Size {
    pub(super) width: usize,
    pub(super) height: usize,
}

impl From<(u32, u32)> for Size {
    fn from((width, height): (u32, u32)) -> Self {
        Self {
            width: width as usize,
            height: height as usize,
        }
    }
}
