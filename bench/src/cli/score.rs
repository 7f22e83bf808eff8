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
use super::report::{outcome, tables};
use super::run::{print_shard, time};
use super::{Outcome, output};
use crate::config::MetricConfig;
use crate::evaluate::{RunFolder, Shard, rescore, score_shard};
use crate::io::counts::counted;

/// Add metrics to a run by scoring its kept pictures
///
/// Predicts and renders nothing. Only results whose predicted picture was kept get new scores. If pictures were not
/// kept, the exit code is 4, and --json has their number.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench score runs/first --metrics lpips-vgg,ssim-all")]
pub(super) struct ScoreArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    metrics: MetricConfig,
    /// Score one shard of a plan (I/N, auto or auto/N, as for `run --shard`) with the plan's metrics. Needs the
    /// datasets, but neither the methods' files nor their devices. Writes unit files only; `merge` writes the tables
    #[arg(long, value_name = "I/N", conflicts_with = "metrics")]
    shard: Option<Shard>,
    /// Start no new pair once this much time has passed; then exit with code 75, as after SIGTERM or SIGUSR1. Times are
    /// written as 90s, 55m or 3h
    #[arg(long, value_name = "TIME", value_parser = time)]
    time_budget: Option<Duration>,
    /// Instruction set of the CPU kernels: avx512, avx2 or portable [default: the run's]
    #[arg(long, value_name = "SET")]
    simd: Option<InstructionSet>,
    #[command(flatten)]
    memory: MemoryArgs,
    /// Number of threads; does not affect the results [default: all cores]
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
        // All scores of a run must be computed by the same kernels.
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
        print_shard(args.json, &args.run, shard, counts)?;
        return Ok(outcome(counts, true));
    }
    let scoring = args.metrics.complete_scoring(&args.metrics.selection()?)?;
    let (counts, results) = rescore(&args.run, &scoring, limit, &terminal)?;
    args.memory.say_if_exceeded();
    let tables = tables(&results, None)?;
    let value = || {
        json!({
            "run": args.run.display().to_string(),
            "units": counts.units,
            "reused": counts.reused,
            "scored": counts.scored,
            "not_kept": counts.waiting,
            "left": counts.left,
            "failed": counts.failed,
        })
    };
    output::print(args.json, value, || tables)?;
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
