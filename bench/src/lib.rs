//! The harness: pairs from datasets, predictions from methods, scores from metrics, and reports.
//!
//! Data flows one way; each module uses only those above it.
//!
//! * [`durable`]: files that are whole or absent, and their hashes.
//! * [`protocol`]: which pairs are evaluated, overlap, alignment, frustum mask.
//! * [`record`]: one scored (or failed) prediction, the unit that runs store and reports read.
//! * [`report`]: tables, plots and a browsable page from records.

pub mod durable;
pub mod protocol;
pub mod record;
pub mod report;
