//! Scores predictions against ground truth: the targets' photographs, which the code of methods never sees.
//!
//! * [`ground_truth`]: a target's photograph and the pixels that count.
//! * [`metrics`]: the metrics of a run with their weights; scores several predictions of one target together.
//! * [`region`]: parts of a picture, for methods that crop.
//! * [`rules`]: settings other than metrics that a protocol may change.
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
