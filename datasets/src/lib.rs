//! Posed images on disk, read into [`Scene`]s and [`View`]s.
//!
//! One file a dataset, one file a format. Whatever a dataset's own convention is (axes, units,
//! pixel centres, disparity), it is converted here, at the border, to the project's: see the
//! conventions of the crate `sharp`.
//!
//! # Contents
//! * [`view`]: what every reader produces.
//! * [`processing`]: what readers do on the way from files to pixels, for the record.
//! * [`spec`]: what a format is and what can be set; [`catalog`]: the formats by name, and how one is
//!   asked for and opened.
//! * [`facts`]: what each dataset is and where to get it.
//! * [`needed`]: the files that a photograph needs beside it.
//! * [`check`](mod@check): what is there, what is broken, whether poses make sense.
//! * [`synthetic`]: procedural scenes with exact depth and exact visibility.
//! * [`bundled`]: the dataset that comes with the program.
//! * [`format`](mod@format): file formats, one a file.
//! * [`files`]: bounded reads and listings that cannot leave a dataset's folder.
//! * [`lens`]: camera models with distortion.
//! * [`undistort`]: pictures and depth resampled to a pinhole camera.
//! * [`natural`]: the order of frames.
//! * [`error`]: what every reader may fail with.

mod booster;
pub mod bundled;
mod camera_size;
pub mod catalog;
pub mod check;
mod colmap;
mod content;
mod depth;
pub mod error;
mod eth3d;
pub mod facts;
pub mod files;
mod finder;
pub mod format;
pub mod lens;
mod mask;
mod middlebury;
pub mod natural;
pub mod needed;
mod nerfstudio;
mod posed;
pub mod processing;
mod rig;
mod scan;
mod scannetpp;
mod search;
mod skipped;
pub mod spec;
mod stereo;
pub mod synthetic;
mod tanks_and_temples;
pub mod undistort;
pub mod view;
mod wildrgbd;

pub use catalog::open;
pub use error::DatasetError;
pub use spec::DatasetSpec;
pub use view::{DepthMap, Pairing, Scene, View, ViewContent};
