//! The harness: pairs from datasets, predictions from methods, scores from metrics, and reports.
//!
//! Data flows one way: each module uses only modules listed above it. The command line uses only the public API.
//!
//! * [`io`]: reading and writing files.
//! * [`pairs`]: selection of the evaluated pairs, and the geometry behind it.
//! * [`rendering`]: choice of the rendering backend, and recovery from device failures.
//! * [`scoring`]: scores of predictions against ground truth.
//! * [`methods`]: methods that predict a target view from a source view.
//! * [`config`]: the configuration of a run.
//! * [`evaluate`]: the core: prepare, run, read results.
//! * [`scale`]: submits a plan's shards to a scheduler.
//! * [`protocols`]: published evaluation procedures by name.
//! * [`report`]: tables, plots and a browsable page from results.
//! * [`track`]: comparison of two runs, a regression gate, and runs over time.
//! * [`export`]: inputs for external methods, as files.
//! * [`pictures`]: comparison of two pictures or two folders.
//! * [`analyze`]: the paper's experiment on the metrics' sensitivity to shifts.
//! * [`train`]: training, validated by runs of this harness.
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
