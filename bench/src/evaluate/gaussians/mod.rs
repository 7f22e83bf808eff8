//! Gaussians of a source: predicted once, stored, rendered, and compared with the source's photograph.
//!
//! * `gaussian_store`, `prediction_file`: storage in memory or on disk while pairs of their source are processed.
//! * `render`: placing, scaling and rendering for a target; `footprint`: covered tiles.
//! * [`source_check`]: renders Gaussians into their own source and compares with its photograph; `rereading`: other
//!   settings for reading their file; `other_view`: other views as their source; `mismatch`: means that do not fit the
//!   standard deviations or quaternions; `depth_check`: units; `registration`: shifts and zooms; `likeness`: similarity
//!   of two pictures.

mod depth_check;
pub(super) mod footprint;
pub(super) mod gaussian_store;
pub(super) mod likeness;
mod mismatch;
mod other_view;
pub(super) mod prediction_file;
pub(super) mod registration;
pub(super) mod render;
pub(super) mod rereading;
pub mod source_check;
