//! SHARP in Rust: one photograph to 3D Gaussians, and Gaussians to nearby views.
//!
//! # Conventions
//! * Camera axes are OpenCV's: x right, y down, z forward. Lengths are metres.
//! * Extrinsics are world-to-camera and named by the spaces they join: `camera_from_world`.
//! * The centre of pixel (i, j) lies at (i + 0.5, j + 0.5); principal points follow (COLMAP's rule).
//! * Depth is z-depth, not ray length; 0 marks an invalid pixel.
//! * Gaussian colours are linear RGB, blended in linear light.
//!
//! # Contents
//! * [`camera`]: intrinsics, rigid poses, affine view transforms.
//! * [`color`]: sRGB ↔ linear light, 8-bit quantisation.
//! * [`gaussians`]: the container every stage hands on.
//! * [`resize`]: the network's bilinear rule, nearest for depth.
//! * [`initializer`], [`composer`]: image and depth layers to Gaussians, with or without deltas.
//! * `model` (feature `model`): the network, from photograph to prediction.
//! * [`unprojection`]: the release's way from normalised to metric space.
//! * [`ply`]: Gaussian scenes as files.
//! * [`render`]: Gaussians to pictures (feature `render`).

pub mod camera;
pub mod color;
pub mod composer;
pub mod gaussians;
pub mod initializer;
#[cfg(feature = "model")]
pub mod model;
pub mod ply;
#[cfg(feature = "render")]
pub mod render;
pub mod resize;
pub mod unprojection;
