//! sharp-checkpoint
