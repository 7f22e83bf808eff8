//! Camera models with lens distortion: the models of COLMAP and OpenCV that real datasets use.
//!
//! * [`Distortion`]: the models and their formulas; `inverse`: their inverses.
//! * [`Lens`]: a camera with a distortion model.

mod camera;
mod distortion;
mod inverse;

use sharp::camera::CameraError;

pub use camera::{COLMAP_MODELS, Lens};
pub use distortion::Distortion;

/// Errors of creating a lens, or a pinhole camera for one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LensError {
    #[error(
        "camera model '{model}' is not supported; make pinhole pictures with `colmap image_undistorter`"
    )]
    UnsupportedModel { model: String },
    #[error("camera model {model} takes {expected} parameters, not {found}")]
    ParameterCount {
        model: String,
        expected: usize,
        found: usize,
    },
    #[error("camera model {model} has a parameter that is not finite")]
    NotFinite { model: String },
    #[error("camera model {model} has a parameter out of its range")]
    OutOfRange { model: String },
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Even the narrowest pinhole view has blank pixels.
    #[error("the lens distorts too strongly for a pinhole view without blank pixels")]
    NoWholePinhole,
    #[error("the midpoints of the picture's edges are outside the lens's field of view")]
    EdgesUnseen,
}
