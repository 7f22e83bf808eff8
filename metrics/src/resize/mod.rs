//! Resizing exactly as in the libraries used for published numbers.
//!
//! A prediction smaller than its ground truth is resized before it is scored, and the libraries'
//! results differ in the second decimal of a PSNR. Therefore a [`ResizeKernel`] is one function of
//! one library, not a family of filters, and its name is part of the number's identity.
//!
//! # Contents
//! * [`ResizeKernel`], [`resize`]: the kernels by name and the entry point.
//! * `torch`: bilinear of `torch.nn.functional.interpolate`, with and without antialiasing.
//! * `pillow`: bicubic, Lanczos (and the bilinear of `dists[resize256]`) of PIL.
//! * `area`: OpenCV's `INTER_AREA`, for reduction only.
//! * `shorter_side`: the reduction used by `dists[resize256]`.

mod area;
mod kernel;
mod pillow;
mod shorter_side;
mod torch;

pub use kernel::{ResizeKernel, ResizeKernelError, resize};
pub(crate) use shorter_side::to_shorter_side_256;

/// Width and height in pixels of a picture of interleaved RGB.
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
