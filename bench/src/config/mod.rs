//! Configuration of a run: parsed once, stored typed, printed in one form.
//!
//! * `dataset`: a dataset with the settings of its reader, its frame and its own pair options.

mod dataset;

pub use dataset::{DatasetConfig, PairOverrides};
