//! Posed images on disk, read into [`Scene`]s and [`View`]s.
//!
//! There is one module per dataset and one per format. Every dataset's own conventions (axes, units, pixel centres,
//! disparity) are converted here to those of the project; see the conventions of the crate `sharp`.
//!
//! # Contents
//! * [`spec`]: a dataset's description, defined next to its reader, and a dataset as specified on a command line;
//!   [`setting`]: its settings.
//! * [`registry`]: all datasets; parses specifications and opens them.
//! * [`view`]: the output of every reader; [`found_scenes`], [`left_out`]: excluded scenes and views, with reasons.
//! * [`processing`]: processing from files to pixels, for records.
//! * [`required_files`]: the files that a photograph requires.
//! * [`check`](mod@check): completeness, damage, and consistency of poses, depth and pictures.
//! * [`synthetic`]: procedural scenes with exact depth and exact visibility.
//! * [`bundled`]: the dataset bundled with the program.
//! * [`format`](mod@format): file formats, one per module; photographs are decoded by [`format::picture`].
//! * [`files`]: bounded reads and listings, confined to a dataset's folder.
//! * [`lens`]: camera models with distortion.
//! * [`undistort`]: resampling of pictures and depth to a pinhole camera.
//! * [`natural_order`]: the order of frames.
//! * [`error`]: errors of readers.

mod booster;
pub mod bundled;
mod camera_size;
pub mod check;
mod colmap;
mod depth;
mod depth_map;
pub mod error;
mod eth3d;
mod file_content;
mod file_finder;
pub mod files;
pub mod format;
pub mod found_scenes;
pub mod left_out;
pub mod lens;
mod mask;
mod mask_labels;
mod middlebury;
pub mod natural_order;
mod nerfstudio;
pub mod processing;
pub mod registry;
pub mod required_files;
mod scan_depth;
mod scannetpp;
mod scene_builder;
mod scene_notes;
mod scene_search;
pub mod setting;
pub mod spec;
mod stereo;
mod stereo_pair;
pub mod synthetic;
mod tanks_and_temples;
pub mod undistort;
pub mod view;
mod virtual_views;
mod wildrgbd;

pub use depth_map::DepthMap;
pub use error::DatasetError;
pub use registry::{open, open_each};
pub use spec::{DatasetEntry, DatasetSpec};
pub use view::{Pairing, Scene, View, ViewContent};
