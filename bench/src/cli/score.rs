//! `score`: adds metrics to kept predictions.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use clap::Args;
use serde_json::json;
use sharp_metrics::{InstructionSet, Selection, Simd};

use super::memory::MemoryArgs;
use super::outcome::UsageError;
use super::output::Terminal;
use super::report::{outcome, print_tables};
use super::run::{print_counts, time};
use super::{Outcome, output};
use crate::config::MetricConfig;
use crate::evaluate::{RunFolder, Shard, rescore, score_shard};
use crate::io::counts::counted;

/// Add metrics to a run from its kept predictions
///
/// Predicts and renders nothing. Units without kept pictures are counted and receive no new scores.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench score runs/first --metrics lpips-vgg,ssim-all")]
pub(super) struct ScoreArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    metrics: MetricConfig,
    /// Score a shard of a plan by the plan's metrics, and write units only: I/N, auto or auto/N, as `run --shard`.
    /// Needs the datasets, but no method's files or device
    #[arg(long, value_name = "I/N", conflicts_with = "metrics")]
    shard: Option<Shard>,
    /// Start no pair after this time (55m) and end with exit code 75, as after SIGTERM or SIGUSR1
    #[arg(long, value_name = "TIME", value_parser = time)]
    time_budget: Option<Duration>,
    /// Class of CPU kernels: avx512, avx2 or portable [default: the run's]
    #[arg(long, value_name = "SET")]
    simd: Option<InstructionSet>,
    #[command(flatten)]
    memory: MemoryArgs,
    /// Threads [default: all cores]. Results do not depend on it
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &ScoreArgs) -> anyhow::Result<Outcome> {
    super::set_threads(args.threads)?;
    let manifest = RunFolder::open(&args.run)?.manifest()?;
    match (args.simd, &manifest) {
        (Some(set), _) => {
            Simd::pin(set).map_err(|error| UsageError(format!("--simd {set}: {error}")))?;
        }
        // Any other value would be rejected.
        (None, Some(manifest)) => {
            Simd::pin(manifest.kernels).with_context(|| args.run.display().to_string())?;
        }
        (None, None) => {}
    }
    let terminal = Terminal::until(args.time_budget)?;
    let limit = args.memory.limit_bytes();
    if let Some(shard) = args.shard {
        let metrics = manifest.iter().flat_map(|manifest| &manifest.metrics);
        let keys: Vec<String> = metrics.map(|metric| metric.info.key.to_string()).collect();
        let selection = Selection::parse(&keys.join(","))?;
        let scoring = args.metrics.complete_scoring(&selection)?;
        let counts = score_shard(&args.run, &scoring, shard, limit, &terminal)?;
        args.memory.say_if_exceeded();
        print_counts(&counts, &args.run, shard, args.json)?;
        return Ok(outcome(counts, true));
    }
    let scoring = args.metrics.complete_scoring(&args.metrics.selection()?)?;
    let (counts, results) = rescore(&args.run, &scoring, limit, &terminal)?;
    args.memory.say_if_exceeded();
    if args.json {
        output::json(&json!({
            "run": args.run.display().to_string(),
            "units": counts.units,
            "reused": counts.reused,
            "scored": counts.scored,
            "not_kept": counts.waiting,
            "left": counts.left,
            "failed": counts.failed,
        }))?;
    } else {
        print_tables(&results, None)?;
    }
    if !results.missing.is_empty() {
        output::remark(format!(
            "warning: {} of the run have no result yet",
            counted(results.missing.len(), "unit")
        ));
        return Ok(Outcome::Resumable);
    }
    let waits = Outcome::of_problems(counts.waiting > 0);
    Ok(outcome(counts, false).or(waits))
}
