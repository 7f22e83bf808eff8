//! Where in a picture a metric finds a difference: maps as PNG for eyes and as EXR for numbers.
//!
//! * [`map`]: a map and its scale; the absolute difference.
//! * [`drawing`]: false colours with a labelled colour bar.
//! * [`mod@write`]: both files.

pub mod drawing;
pub mod map;
pub mod write;

pub use map::{LocalMap, Scale};
pub use write::{MapFiles, write_map};
