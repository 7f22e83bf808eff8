//! Gaussians of a source: made once, kept, rendered, and compared with their photograph.
//!
//! * `gaussian_store`, `prediction_file`: kept in memory or on disk while their source's pairs are done.
//! * `render`: placed, scaled and rendered for a target; `footprint`: tiles that they cover.
//! * [`source_check`]: rendered into their own source and compared with its photograph; `rereading`: other readings of
//!   their file; `registration`: shifts and zooms; `likeness`: how like two pictures are.

pub(super) mod footprint;
pub(super) mod gaussian_store;
pub(super) mod likeness;
pub(super) mod prediction_file;
pub(super) mod registration;
pub(super) mod render;
pub(super) mod rereading;
pub mod source_check;
