//! Two pictures or two folders of them: the work of the command `metrics`.
//!
//! * [`matching`]: pairs pictures of two folders.
//! * [`maps`]: maps of a metric over a picture.
//! * [`keyed_scores`]: scores for JSON and CSV.
//! * [`other_forms`]: values that other people's code computes under the names of our metrics.

pub mod keyed_scores;
pub mod maps;
pub mod matching;
pub mod other_forms;
