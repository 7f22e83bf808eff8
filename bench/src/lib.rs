//! The harness: pairs from datasets, predictions from methods, scores from metrics, and reports.
//!
//! Data flows one way; each module uses only those above it.
//!
//! * [`durable`]: files that are whole or absent, and their hashes.
//! * `counted`: numbers with their nouns.
//! * [`record`]: one scored (or failed) prediction, the unit that runs store and reports read.
//! * [`pictures`], [`picture_pairs`], [`render_file`], [`scene_file`], [`model_files`]: pictures, renderings, scenes and
//!   checkpoints as files.
//! * [`movie`]: pictures in a row as GIF and MP4.
//! * [`rendering`]: which backend renders, and what happens when its device fails.
//! * [`process_memory`]: how much memory this process has used.
//! * [`protocol`]: which pairs are evaluated, and the geometry that decides it.
//! * [`exchange`]: what foreign methods are given, as files.
//! * [`methods`]: what predicts a target view from a source view.
//! * [`runs`]: plans, units and the folder that keeps their results.
//! * [`report`]: tables, plots and a browsable page from records.
//! * [`cli`]: the command line.

pub mod cli;
mod counted;
pub mod durable;
pub mod exchange;
pub mod methods;
pub mod model_files;
pub mod movie;
pub mod picture_pairs;
pub mod pictures;
pub mod process_memory;
pub mod protocol;
pub mod record;
pub mod render_file;
pub mod rendering;
pub mod report;
pub mod runs;
pub mod scene_file;
