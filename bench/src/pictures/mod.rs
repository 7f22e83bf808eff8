//! Comparison of two pictures or two folders, for the command `metrics`.
//!
//! * [`matching`]: pairs the pictures of two folders.
//! * [`maps`]: maps of a metric over a picture.
//! * [`keyed_scores`]: scores for JSON and CSV.
//! * [`other_forms`]: variants that other packages compute under the names of our metrics.

pub mod keyed_scores;
pub mod maps;
pub mod matching;
pub mod other_forms;
