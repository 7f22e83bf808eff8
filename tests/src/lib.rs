//! What tests of several crates share.

pub mod hostile_checkpoints;
mod shared_data;
pub mod unreliable_server;

pub use shared_data::shared_data;
