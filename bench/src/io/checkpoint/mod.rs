//! SHARP's official checkpoint: what it is, where it lies, and whether it is still the same file.
//!
//! * [`release`]: name, address and licence.
//! * [`find`]: where the release itself and we keep it.
//! * [`record`]: its size and sha256 from the first use on.
//! * `fetch`: getting it (feature `download`).

#[cfg(any(feature = "download", test))]
pub mod fetch;
pub mod find;
pub mod record;
pub mod release;

pub use find::{NoCheckpoint, find_checkpoint};
pub use release::{RELEASE_ADDRESS, RELEASE_FILE};
