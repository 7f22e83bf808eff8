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
//! * [`files`]: files that someone names, read so that reading ends.
//! * `frustum_mask` (feature `render`): which pixels of a view another camera has in its field of view.
//! * `gaussian_files` (feature `gaussian-files`): Gaussians in files of any format that is read.
//! * `image_file` (feature `image-file`): the one decoder of photographs.
//! * [`gaussians`]: the container that all stages share.
//! * [`resize`]: the network's bilinear rule, nearest for depth.
//! * [`initializer`], [`composer`]: image and depth layers to Gaussians, with or without deltas.
//!   Their derivatives come with feature `render`, whose types they share.
//! * `model` (feature `model`): the network, from photograph to prediction.
//! * [`unprojection`]: from normalised to metric space, as the release does it.
//! * [`ply`]: Gaussian scenes as files, and PLY files of any kind.
//! * [`random`]: the generator behind every seeded choice.
//! * [`render`]: Gaussians to pictures (feature `render`).

pub mod camera;
pub mod color;
pub mod composer;
pub mod files;
#[cfg(feature = "render")]
pub mod frustum_mask;
#[cfg(feature = "gaussian-files")]
pub mod gaussian_files;
pub mod gaussians;
#[cfg(feature = "image-file")]
pub mod image_file;
pub mod initializer;
#[cfg(feature = "model")]
pub mod model;
pub mod ply;
pub mod random;
#[cfg(feature = "render")]
pub mod render;
pub mod resize;
pub mod unprojection;
