//! Why a run stops.

use crate::durable::FileError;

/// Why a run stopped before its end. What was finished is kept.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The run folder cannot be read or written.
    #[error(transparent)]
    Folder(#[from] FileError),
    /// The renderer's device failed: the unit stays undone, and the same run goes on from there.
    #[error("{method} on {pair_id}: {reason}; what is done is kept, the same command goes on")]
    Device {
        /// The pair of the unit.
        pair_id: String,
        /// Its method.
        method: String,
        /// What the device said.
        reason: String,
    },
}
