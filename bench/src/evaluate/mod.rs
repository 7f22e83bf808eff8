//! The evaluation core: what is evaluated, by which stages, and the folder that keeps its results.
//!
//! ```
//! use sharp_bench::evaluate::{EvaluateError, Request, RunOptions, prepare};
//! use sharp_bench::io::observer::Quiet;
//!
//! fn evaluate(request: Request) -> Result<(), EvaluateError> {
//!     let run = prepare(request, &Quiet)?.run("runs/first".as_ref(), RunOptions::default(), &Quiet)?;
//!     for record in &run.results.records {
//!         println!("{} {} {:?}", record.pair_id, record.method, record.scores);
//!     }
//!     Ok(())
//! }
//! ```
//!
//! * [`mod@prepare`]: a request made ready; [`pipeline`]: its units predicted, rendered and scored; `estimate`: what that
//!   would cost; [`mod@speed`]: what inference and rendering take, apart, of Gaussians whose `footprint` explains it.
//! * [`plan`]: which pairs by which methods; [`shard`]: a process's part of it; `run`: all of it, or such a part, done;
//!   [`status`]: how far it is.
//! * `keys`: what each stage depends on; `render`, `score`: the later two stages; `gaussian_store`,
//!   `prediction_file`: predictions of sources, made once; [`source_check`]: whether they show their source.
//! * [`record`]: one result; [`mod@unit`]: the same with its keys, as it is stored; [`folder`]: the run folder;
//!   [`manifest`]: what its results share.
//! * [`aggregation`]: what a mean is a mean of.
//! * [`results`]: a folder as records and tables; [`bundle`]: the same in one file; [`mod@join`]: several folders as one; [`mod@rescore`]: kept predictions
//!   scored again; [`readings`]: the same under other readings of the protocol, kept nowhere.

pub mod aggregation;
pub mod bundle;
pub mod error;
pub mod estimate;
pub mod folder;
mod footprint;
mod gaussian_store;
pub mod join;
mod keys;
mod likeness;
pub mod manifest;
pub mod pipeline;
pub mod plan;
mod prediction_file;
pub mod prepare;
pub mod readings;
pub mod record;
mod render;
mod rereading;
pub mod rescore;
pub mod results;
mod run;
mod score;
pub mod shard;
pub mod source_check;
pub mod speed;
pub mod status;
#[cfg(test)]
pub(crate) mod test_records;
#[cfg(test)]
mod tests;
pub mod unit;

pub use aggregation::Aggregation;
pub use bundle::{Bundle, Occasion, write_bundle};
pub use error::EvaluateError;
pub use estimate::Estimate;
pub use folder::RunFolder;
pub use join::{Named, join, join_under, merge};
pub use manifest::Manifest;
pub use pipeline::{Keep, MEMORY_LIMIT_BYTES, RunOptions, Stages, UnitCounts};
pub use plan::{PlannedCommand, RunPlan};
pub use prepare::{Evaluation, PairOrigin, Request, RunStatus, prepare};
pub use rescore::{rescore, score_shard};
pub use results::Results;
pub use run::Finished;
pub use shard::Shard;
pub use status::RunProgress;
