//! `score`: more metrics over kept predictions.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::data_args::MetricArgs;
use super::output::Terminal;
use super::report::{outcome, print_tables};
use super::{Outcome, output};
use crate::evaluate::rescore;

/// Add metrics to a run from its kept predictions
///
/// Nothing is predicted or rendered. Units whose pictures were not kept are counted and stay without the new values.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench score runs/first --metrics lpips-vgg,ssim-all")]
pub(super) struct ScoreArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    metrics: MetricArgs,
    /// Threads; all cores without it. Results do not depend on it
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &ScoreArgs) -> anyhow::Result<Outcome> {
    super::set_threads(args.threads)?;
    let scoring = args.metrics.complete_scoring(&args.metrics.selection()?)?;
    let (counts, results) = rescore(&args.run, &scoring, &Terminal::default())?;
    if args.json {
        output::json(&json!({
            "run": args.run.display().to_string(),
            "units": counts.units,
            "reused": counts.reused,
            "scored": counts.scored,
            "not_kept": counts.waiting,
            "failed": counts.failed,
        }))?;
    } else {
        print_tables(&results)?;
    }
    Ok(outcome(counts))
}
