//! Posed images on disk, read into [`Scene`]s and [`View`]s.
//!
//! One file a dataset, one file a format. Whatever a dataset's own convention is (axes, units,
//! pixel centres, disparity), it is converted here, at the border, to the project's: see the
//! conventions of the crate `sharp`.
//!
//! # Contents
//! * [`view`]: what every reader produces.
//! * [`error`]: what every reader may fail with.

pub mod error;
pub mod view;

pub use error::DatasetError;
pub use view::{DepthMap, Pairing, Scene, View, ViewContent};
