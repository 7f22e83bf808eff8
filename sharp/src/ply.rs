//! Gaussian scenes as PLY files: the SHARP release's own form, the plain form that third-party
//! viewers read, and a reader for both and for other programs' files.
//!
//! Stored values are encoded: scales as natural logarithms, opacities as logits, colours as the
//! constant term of spherical harmonics, `(c − ½) / √(1 / 4π)`.

mod file;
mod header;
mod read;
mod write;

use std::path::{Path, PathBuf};

use crate::camera::{CameraError, Intrinsics};
use crate::gaussians::Gaussians;

pub use read::{ReadOptions, from_bytes, load};
pub use write::{PlyForm, to_bytes};

/// √(1 / 4π), the value of the constant spherical harmonic.
const SH_CONSTANT: f32 = 0.282_094_79;

/// Encoding of colours in a file; in memory they are always linear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColorSpace {
    /// sRGB-encoded, code 0: what the release writes, for viewers that blend encoded values.
    Srgb,
    /// Linear light, code 1: what the release assumes of a file that does not say.
    #[default]
    Linear,
}

/// Gaussians with what a file says about them.
#[derive(Debug, Clone, PartialEq)]
pub struct GaussianScene {
    /// In the space of the camera, metres; linear colours.
    pub gaussians: Gaussians,
    /// The camera the scene was predicted from; `None` for a file without one.
    pub intrinsics: Option<Intrinsics>,
    /// Row-major 4×4 `camera_from_world`; `None` for a file without one.
    pub extrinsics: Option<[f32; 16]>,
    /// How colours were stored in the file read; the writer always stores sRGB.
    pub color_space: ColorSpace,
    /// The writing program's format version; the release writes 1.5.0.
    pub version: Option<[u8; 3]>,
    /// How many view-dependent colour coefficients (`f_rest_*`) a Gaussian has in the file. They
    /// are not read: only the constant term is.
    pub ignored_color_coefficients: usize,
}

impl GaussianScene {
    /// A scene as the predictor yields it.
    pub fn new(gaussians: Gaussians, intrinsics: Intrinsics) -> Self {
        Self {
            gaussians,
            intrinsics: Some(intrinsics),
            extrinsics: None,
            color_space: ColorSpace::Srgb,
            version: None,
            ignored_color_coefficients: 0,
        }
    }

    /// The stored camera, or the release's default for files without one: 640 × 480 pixels, focal
    /// length 512 px, principal point in the middle.
    pub fn intrinsics_or_default(&self) -> Intrinsics {
        self.intrinsics.unwrap_or(Intrinsics {
            fx: 512.0,
            fy: 512.0,
            cx: 320.0,
            cy: 240.0,
            width: 640,
            height: 480,
        })
    }

    /// Writes the scene to `path`.
    ///
    /// # Errors
    /// [`PlyError`] with the path and the operating system's reason.
    pub fn save(&self, path: &Path, form: PlyForm) -> Result<(), PlyError> {
        std::fs::write(path, to_bytes(self, form)).map_err(|e| PlyError::new(path, e.into()))
    }
}

/// A file that cannot be read or written as a Gaussian scene.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct PlyError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    #[source]
    pub reason: PlyReason,
}

impl PlyError {
    fn new(path: &Path, reason: PlyReason) -> Self {
        Self {
            path: path.to_owned(),
            reason,
        }
    }
}

/// What can be wrong with a PLY file.
#[derive(Debug, thiserror::Error)]
pub enum PlyReason {
    /// The operating system refused.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The first line is not `ply`.
    #[error("not a PLY file")]
    NotPly,
    /// A header line that is not understood.
    #[error("header line {line}: {what}")]
    Header {
        /// Counted from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
    /// The header names more data than the file holds.
    #[error("element `{element}` wants {count} rows, the file ends before")]
    Truncated {
        /// Element.
        element: String,
        /// Rows according to the header.
        count: usize,
    },
    /// A word of an ASCII file that is not a number.
    #[error("element `{element}`, row {row}: `{word}` is not a number")]
    NotANumber {
        /// Element.
        element: String,
        /// Counted from 0.
        row: usize,
        /// The word, shortened.
        word: String,
    },
    /// The file is a PLY, but not of Gaussians.
    #[error("no Gaussians: element `vertex` lacks {0}")]
    Missing(String),
    /// An extra element that does not have the size or values it should.
    #[error("element `{element}`: {what}")]
    Extra {
        /// Element.
        element: &'static str,
        /// What is wrong.
        what: String,
    },
    /// A stored camera that is no camera.
    #[error("stored camera: {0}")]
    Camera(#[from] CameraError),
}

#[cfg(test)]
mod tests;
