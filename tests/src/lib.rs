//! What tests of several crates share.

pub mod hostile_checkpoints;
pub mod mutants;
mod shared_data;
pub mod unreliable_server;

pub use shared_data::shared_data;
