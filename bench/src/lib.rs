//! The harness: pairs from datasets, predictions from methods, scores from metrics, and reports.
//!
//! Data flows one way; each module uses only those above it.
//!
//! * [`durable`]: files that are whole or absent, and their hashes.
//! * `view_hashes`: what a view is made of, as a hash.
//! * `counted`: numbers with their nouns.
//! * [`record`]: one scored (or failed) prediction, the unit that runs store and reports read.
//! * [`pictures`], [`picture_pairs`], [`render_file`], [`scene_file`], [`model_files`]: pictures, renderings, scenes and
//!   checkpoints as files.
//! * [`movie`]: pictures in a row as GIF and MP4.
//! * [`rendering`]: which backend renders, and what happens when its device fails.
//! * [`process_memory`]: how much memory this process has used.
//! * [`protocol`]: which pairs are evaluated, and the geometry that decides it.
//! * [`exchange`]: what foreign methods are given, as files.
//! * [`masks`]: masks as files.
//! * [`methods`]: what predicts a target view from a source view.
//! * [`runs`]: plans, units and the folder that keeps their results.
//! * [`report`]: tables, plots and a browsable page from records.
//! * [`methods_text`]: which metrics these are, as a paper should say it.
//! * [`score_maps`]: where in a picture a metric finds a difference.
//! * [`analyze`]: the paper's explanatory experiments.
//! * [`cli`]: the command line.

pub mod analyze;
pub mod cli;
mod counted;
pub mod durable;
pub mod exchange;
pub mod masks;
pub mod methods;
pub mod methods_text;
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
pub mod score_maps;
mod view_hashes;
