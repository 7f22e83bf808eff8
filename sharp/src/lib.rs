//! SHARP in Rust: one photograph to 3D Gaussians, and Gaussians to nearby views.
//!
//! # Conventions
//! * "The paper" is the publication of SHARP; "the release" is Apple's code and checkpoint for it (`ml-sharp`).
//! * Camera axes are OpenCV's: x right, y down, z forward. Lengths are metres.
//! * Extrinsics are world-to-camera and named by the spaces they join: `camera_from_world`.
//! * The centre of pixel (i, j) is at (i + 0.5, j + 0.5), also for principal points (COLMAP's convention).
//! * Depth is z-depth, not ray length; 0 marks an invalid pixel.
//! * Gaussian colours are linear RGB, blended in linear light.
//!
//! # Contents
//! * [`camera`]: intrinsics, rigid poses, affine view transforms.
//! * [`color`]: sRGB ↔ linear light, 8-bit quantisation.
//! * [`files`]: reading of user-supplied regular files.
//! * `frustum_mask` (feature `render`): mask of a view's pixels that are in another camera's field of view.
//! * `gaussian_files` (feature `gaussian-files`): reading of Gaussians in any supported format.
//! * `image_file` (feature `image-file`): decoding of photographs.
//! * [`gaussians`]: the container shared by all stages.
//! * [`resize`]: bilinear resampling as in the network; nearest for depth.
//! * [`initializer`], [`composer`]: image and depth layers to Gaussians, with or without deltas. Their derivatives
//!   require feature `render`, whose types they share.
//! * `model` (feature `model`): the network, from photograph to prediction.
//! * [`unprojection`]: from normalised to metric space, as in the release.
//! * [`ply`]: PLY files of Gaussian scenes, and of any other kind.
//! * [`random`]: the random generator for every seeded choice.
//! * [`render`]: Gaussians to pictures (feature `render`).
//! * [`trajectory`]: the release's camera paths.

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
pub mod trajectory;
pub mod unprojection;
