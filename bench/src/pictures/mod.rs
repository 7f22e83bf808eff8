//! Two pictures or two folders of them: the work of the command `metrics`.
//!
//! * [`matching`]: which picture is compared with which.
//! * [`maps`]: where in a picture a metric finds a difference.
//! * [`keyed_scores`]: scores for JSON and CSV.
//! * [`other_forms`]: what other people's code computes under the names of our metrics.

pub mod keyed_scores;
pub mod maps;
pub mod matching;
pub mod other_forms;
