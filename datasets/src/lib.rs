//! Posed images on disk, read into [`Scene`]s and [`View`]s.
//!
//! There is one module per dataset and one per format. Every dataset's own conventions (axes, units, pixel centres,
//! disparity) are converted here to those of the project; see the conventions of the crate `sharp`.
//!
//! # Contents
//! * [`entry`](mod@entry): description and settings of each dataset, defined next to its reader.
//! * [`spec`]: a dataset as specified on a command line, and opening it.
//! * [`view`]: the output of every reader; [`left_out`]: excluded scenes and views, with reasons.
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
pub mod entry;
pub mod error;
mod eth3d;
mod file_content;
mod file_finder;
pub mod files;
pub mod format;
pub mod left_out;
pub mod lens;
mod mask;
mod middlebury;
pub mod natural_order;
mod nerfstudio;
mod picture_notes;
pub mod processing;
pub mod required_files;
mod scan_depth;
mod scannetpp;
mod scene_builder;
mod scene_search;
pub mod spec;
mod stereo;
mod stereo_pair;
pub mod synthetic;
mod tanks_and_temples;
pub mod undistort;
pub mod view;
mod wildrgbd;

pub use entry::DatasetEntry;
pub use error::DatasetError;
pub use spec::{DatasetSpec, open, open_each};
pub use view::{DepthMap, Pairing, Scene, View, ViewContent};
