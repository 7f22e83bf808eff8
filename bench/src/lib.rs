//! The harness: pairs from datasets, predictions from methods, scores from metrics, and reports.
//!
//! Data flows one way; each module uses only those above it.
//! The command line calls what is public here and no more.
//!
//! * [`io`]: what goes to disk and comes back.
//! * [`pairs`]: which pairs are evaluated, and the geometry that decides it.
//! * [`rendering`]: which backend renders, and what happens when its device fails.
//! * [`scoring`]: predictions against the truth.
//! * [`methods`]: what predicts a target view from a source view.
//! * [`config`]: what a run is asked for.
//! * [`evaluate`]: the core: prepare, run, read results.
//! * [`scale`]: a plan's shards handed to a scheduler.
//! * [`protocols`]: other people's evaluations by name.
//! * [`report`]: tables, plots and a browsable page from results.
//! * [`track`]: two runs compared, a gate between them, and runs over time.
//! * [`export`]: what foreign methods are given, as files.
//! * [`pictures`]: two pictures or two folders, compared.
//! * [`analyze`]: the paper's explanatory experiments.
//! * [`train`]: trainings, validated by all of that.
//! * [`cli`]: the command line.

pub mod analyze;
pub mod cli;
pub mod config;
pub mod evaluate;
pub mod export;
pub mod io;
pub mod methods;
pub mod pairs;
pub mod pictures;
pub mod protocols;
pub mod rendering;
pub mod report;
pub mod scale;
pub mod scoring;
pub mod track;
pub mod train;
