//! Posed images on disk, read into [`Scene`]s and [`View`]s.
//!
//! One file a dataset, one file a format. Whatever a dataset's own convention is (axes, units,
//! pixel centres, disparity), it is converted here, at the border, to the project's: see the
//! conventions of the crate `sharp`.
//!
//! # Contents
//! * [`entry`](mod@entry): what each dataset is and what can be set, from one entry beside each reader.
//! * [`spec`]: a dataset as asked for on a command line, and how it is opened.
//! * [`view`]: what every reader produces; [`left_out`]: what it leaves out, and why.
//! * [`processing`]: what readers do on the way from files to pixels, for the record.
//! * [`required_files`]: the files that a photograph needs beside it.
//! * [`check`](mod@check): what is present, what is broken, whether poses are plausible.
//! * [`synthetic`]: procedural scenes with exact depth and exact visibility.
//! * [`bundled`]: the dataset that comes with the program.
//! * [`format`](mod@format): file formats, one a file; the decoder of photographs is
//!   [`format::picture`].
//! * [`files`]: bounded reads and listings that cannot leave a dataset's folder.
//! * [`lens`]: camera models with distortion.
//! * [`undistort`]: pictures and depth resampled to a pinhole camera.
//! * [`natural_order`]: the order of frames.
//! * [`error`]: what every reader may fail with.

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
