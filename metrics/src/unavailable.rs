//! Reasons why a metric has no value.

use crate::options::Device;
use crate::picture::PictureError;
use crate::weights::backbone::Backbone;

/// Reason that a metric has no value for a pair.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unavailable {
    /// The network's weights were not given.
    #[error(
        "needs the weights of {backbone}; download them with `sharp-bench weights fetch {backbone}`, or pass a file \
         with `--weights {backbone}=FILE`"
    )]
    NoWeights { backbone: Backbone },
    /// The picture is smaller than the metric's window or network requires.
    #[error("the pictures are {width}x{height}; sides of at least {smallest} are needed")]
    TooSmall {
        width: u32,
        height: u32,
        /// Minimum side in pixels.
        smallest: u32,
    },
    /// The key requires a view-frustum mask, but the pair has none.
    #[error("needs the view-frustum mask of the pair, which requires the target's depth")]
    NoFrustumMask,
    /// The key requires a mask from the caller, but none was given.
    #[error("needs a mask (`sharp-bench metrics --mask FILE|DIR`)")]
    NoMask,
    /// The mask contains no pixel for which the metric has a value.
    #[error("the mask leaves no pixel to score")]
    EmptyMask,
    /// The target is a virtual view, which has no photograph.
    #[error("the target is only a camera, without a photograph to compare with")]
    NoPhotograph,
    /// Both pictures are constant, but the variant derives the data range from them.
    #[error("both pictures are constant, so their data range is zero and the value undefined")]
    NoRange,
    /// The device failed on this pair, usually for lack of memory.
    #[error("{device}: {reason}")]
    Device { device: Device, reason: String },
}

/// Reason that a pair cannot be scored at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScoreError {
    /// The two pictures differ in size; nothing is ever resized silently.
    #[error(
        "the prediction is {}x{} but the target is {}x{}", prediction.0, prediction.1, target.0,
        target.1
    )]
    SizeMismatch {
        prediction: (u32, u32),
        target: (u32, u32),
    },
    /// The mask's size differs from the pictures'.
    #[error("the mask is {}x{} but the pictures are {}x{}", mask.0, mask.1, target.0, target.1)]
    MaskSizeMismatch {
        mask: (u32, u32),
        target: (u32, u32),
    },
    /// The prediction has invalid pixels or an invalid size.
    #[error("prediction: {0}")]
    Prediction(PictureError),
    /// The target has invalid pixels or an invalid size.
    #[error("target: {0}")]
    Target(PictureError),
}
