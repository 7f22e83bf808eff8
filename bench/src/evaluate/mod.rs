//! The evaluation core: requests, stages, and the run folder with the results.
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
//! * [`mod@prepare`]: from a request to an evaluation; [`pipeline`]: processes the units of a [`job`] through `predict`
//!   and `score`; `estimate`: the cost of an evaluation; [`mod@speed`]: times of inference and rendering.
//! * [`plan`]: planned pairs and methods; [`shard`]: a process's part of a plan; `run`: runs a plan or a shard;
//!   [`status`]: progress.
//! * `keys`: hashed inputs of each stage; [`gaussians`]: predictions of sources, stored, rendered and compared with
//!   photographs.
//! * [`picture_check`]: compares stored pictures with photographs to find what is wrong with them; [`doubts`]: the
//!   warnings about a run's results, from these comparisons and from [`gaussians`].
//! * [`record`]: one result; [`mod@unit`]: a result with its keys, as stored; [`folder`]: the run folder; [`manifest`]:
//!   facts common to all results of a folder; `differences`: which facts may differ between combined results.
//! * [`aggregation`]: means over pairs.
//! * [`results`]: a folder as records and tables; [`bundle`]: results in one file; [`mod@join`]: combines folders;
//!   [`mod@shown`]: selects and renames what is shown; [`mod@rescore`]: rescores kept predictions; [`readings`]: scores
//!   them under each way of reading a protocol's rules.

pub mod aggregation;
pub mod bundle;
mod differences;
pub mod doubts;
pub mod error;
pub mod estimate;
pub mod folder;
pub mod gaussians;
pub mod job;
pub mod join;
mod keys;
pub mod manifest;
pub mod picture_check;
pub mod pipeline;
pub mod plan;
mod predict;
pub mod prepare;
pub mod readings;
pub mod record;
pub mod rescore;
pub mod results;
mod run;
mod score;
pub mod shard;
pub mod shown;
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
pub use folder::RunFolder;
pub use job::{MEMORY_LIMIT_BYTES, RunOptions, Stages, UnitCounts};
pub use join::{Named, join, join_under, merge};
pub use manifest::Manifest;
pub use plan::{Estimate, RunPlan, RunStatus};
pub use prepare::{Evaluation, Request, prepare};
pub use rescore::{rescore, score_shard};
pub use results::Results;
pub use run::Finished;
pub use shard::Shard;
pub use shown::Shown;
pub use status::RunProgress;
