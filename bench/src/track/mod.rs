//! What becomes of scores from run to run.
//!
//! * [`compare`]: two runs pair by pair; what changed, where, and whether chance could have done it.
//! * [`gate`]: limits on such changes, for continuous integration.
//! * [`history`]: runs over time, and which of them changed what.

pub mod compare;
pub mod gate;
pub mod history;
