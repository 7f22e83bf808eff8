//! What tests of several crates share.

pub mod hostile_checkpoints;
pub mod unreliable_server;
