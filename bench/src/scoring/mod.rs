//! Predictions against the truth. Besides the method `target`, this is the only module that sees a target's photograph.
//!
//! * [`ground_truth`]: a target's photograph and which of its pixels count.
//! * [`metrics`]: the metrics of a run with their weights; several predictions of one target scored together.
//! * [`region`]: parts of a picture, for methods that crop.
//! * [`rules`]: what a protocol may change besides the metrics.
//! * [`scale_sweep`]: the best of several scales.

pub mod ground_truth;
pub mod metrics;
pub mod region;
pub mod rules;
pub mod scale_sweep;

pub use ground_truth::GroundTruth;
pub use metrics::Scoring;
pub use region::Region;
pub use rules::ScoringRules;
pub use scale_sweep::ScaleChooser;
