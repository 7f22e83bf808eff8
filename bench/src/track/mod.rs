//! What becomes of scores from run to run.
//!
//! * [`compare`]: two runs pair by pair; what changed, where, and whether chance could have done it.
//! * [`gate`]: limits on such changes, for continuous integration.

pub mod compare;
pub mod gate;
