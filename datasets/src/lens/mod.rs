//! Camera models with lens distortion: the models of COLMAP and OpenCV that real datasets use.
//!
//! * [`Distortion`]: the models and their formulas; `inverse` undoes them.
//! * [`Lens`]: a camera with one of them.

mod camera;
mod distortion;
mod inverse;

pub use camera::{Lens, colmap_parameters};
pub use distortion::Distortion;
