//! `run`: evaluates methods on datasets into a run folder.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::bail;
use clap::Args;
use serde::Serialize;
use sharp_metrics::Simd;

use super::data_args::{self, say_what_was_opened};
use super::memory::MemoryArgs;
use super::outcome::UsageError;
use super::output::{Terminal, span};
use super::report::{outcome, tables};
use super::{Outcome, output};
use crate::config::RunConfig;
use crate::evaluate::{
    Estimate, EvaluateError, Manifest, Request, RunFolder, RunOptions, RunStatus, Shard, Stages,
    UnitCounts, prepare,
};
use crate::io::counts::counted;
use crate::methods::KINDS;

/// Evaluate methods on datasets and write the results to a run folder
///
/// The result of one method on one pair is a unit, stored in its own file. The same command resumes a stopped run:
/// finished units are kept, and failed units are retried. If a unit fails, the failure is recorded, the run continues,
/// and the exit code is 4. More methods, pairs, metrics and datasets can be added to the folder later without repeating
/// finished work.
#[derive(Debug, Args)]
#[command(
    after_help = help(),
    args_override_self = true,
    override_usage = "sharp-bench run [OPTIONS] --dataset <SPEC> --method <SPEC> --out <DIR>\n       \
                      sharp-bench run --config <FILE> [OPTIONS] --out <DIR>\n       \
                      sharp-bench run --plan <DIR> --shard <I/N> [OPTIONS]"
)]
pub(super) struct RunArgs {
    /// Read options from a TOML file: keys are the options' names without leading dashes (`limit = 10`,
    /// `method = ["copy"]`), and relative paths are resolved against the file's folder. Options on the
    /// command line take precedence. Every run folder contains the options of the run as run.toml
    #[arg(long = "config", value_name = "FILE")]
    file: Option<PathBuf>,
    #[command(flatten)]
    config: RunConfig,
    /// The run folder
    #[arg(long, value_name = "DIR", required_unless_present_any = ["dry_run", "estimate", "plan"])]
    out: Option<PathBuf>,
    /// Evaluate nothing, but write a plan of the run with its estimated cost into --out, to be executed in shards
    /// (--plan, --shard)
    #[arg(long, conflicts_with_all = ["dry_run", "estimate"])]
    plan_only: bool,
    /// Execute one shard of the plan in this folder, with the options of the plan. Writes unit files
    /// only; `merge` writes the tables
    #[arg(
        long,
        value_name = "DIR",
        requires = "shard",
        conflicts_with_all = ["dry_run", "estimate", "out", "plan_only", "file"]
    )]
    plan: Option<PathBuf>,
    /// Which shard to execute: I/N with I from 1 to N. In an array job of Slurm, Kubernetes or AWS Batch: auto or
    /// auto/N, which read I from the scheduler
    #[arg(long, value_name = "I/N", requires = "plan")]
    shard: Option<Shard>,
    /// Allow the plan's `command` methods to start their programs; check a plan that someone else made before you allow
    /// this
    #[arg(long, requires = "plan")]
    allow_programs: bool,
    /// Start no new unit once this much time has passed; then exit with code 75, as after SIGTERM or SIGUSR1. Times are
    /// written as 90s, 55m or 3h
    #[arg(long, value_name = "TIME", value_parser = time)]
    time_budget: Option<Duration>,
    /// Stages to execute; another machine can execute the others later
    #[arg(long, value_enum, default_value_t = Stages::All)]
    stage: Stages,
    #[command(flatten)]
    memory: MemoryArgs,
    /// Number of threads; does not affect the results [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Evaluate nothing; count finished, failed and missing units
    #[arg(long)]
    dry_run: bool,
    /// Estimate CPU time, memory and disk space for all pairs by evaluating a few; keep no results
    #[arg(long, conflicts_with = "dry_run")]
    estimate: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn help() -> String {
    let mut kinds = String::new();
    for kind in &KINDS {
        kinds += &format!("  {:<12} {}\n", kind.name, kind.summary);
        for (setting, meaning) in kind.settings {
            kinds += &format!("    {setting}  {meaning}\n");
        }
    }
    format!(
        "Methods, KIND[:key=value,…], with their settings (only dir= and run= are required; every method also takes \
         label=NAME, the name shown in tables):\n{kinds}\n{}\n\
         Examples:\n  \
         sharp-bench run --dataset middlebury=data/Middlebury2014 --method copy --method depth-splat \\\n      \
         --out runs/first\n  \
         sharp-bench run --dataset synthetic --method imported:label=mine,dir=predictions \\\n      \
         --metrics paper,ssim-all --out runs/mine",
        data_args::formats_help()
    )
}

/// Parses a time such as `90s`, `55m` or `3h`.
pub(super) fn time(text: &str) -> Result<Duration, String> {
    let wrong = || format!("'{text}': expected a time such as 90s, 55m or 3h");
    let unit = match text.chars().last() {
        Some('s') => 1,
        Some('m') => 60,
        Some('h') => 3600,
        _ => return Err(wrong()),
    };
    let number: u64 = text[..text.len() - 1].parse().map_err(|_| wrong())?;
    let secs = number.checked_mul(unit).ok_or_else(wrong)?;
    Ok(Duration::from_secs(secs))
}

/// The configuration from the file, the plan and the options.
fn configuration(args: &RunArgs) -> anyhow::Result<RunConfig> {
    let Some(root) = &args.plan else {
        return Ok(match &args.file {
            Some(file) => RunConfig::read(file)?.overlaid(&args.config)?,
            None => args.config.clone(),
        });
    };
    let own = args.config.keys()?;
    // `--simd` is allowed here: if this machine lacks the plan's kernels, a later check reports it.
    if let Some(key) = own.keys().find(|key| *key != "simd") {
        let reason = format!(
            "--{key} cannot be combined with --plan, because a shard uses the planned options"
        );
        return Err(UsageError(reason).into());
    }
    let folder = RunFolder::open(root)?;
    if folder.plan()?.estimate.is_none() {
        bail!(
            "{}: not planned by `run --plan-only`, so it has no shards",
            root.display()
        );
    }
    let config = RunConfig::read(&folder.config_path())?.overlaid(&args.config)?;
    if let Some(method) = config.program().filter(|_| !args.allow_programs) {
        let reason = format!(
            "the plan starts a program (--method {method}); if you trust the program, add --allow-programs"
        );
        return Err(UsageError(reason).into());
    }
    Ok(config)
}

pub(super) fn execute(args: &RunArgs) -> anyhow::Result<Outcome> {
    let config = configuration(args)?;
    super::set_threads(args.threads)?;
    if let Some(set) = config.simd {
        Simd::pin(set).map_err(|error| UsageError(format!("--simd {set}: {error}")))?;
    }
    if config.methods.is_empty() {
        let reason = "no method; give one with --method SPEC (`run --help-all` lists the kinds)";
        return Err(UsageError(reason.to_owned()).into());
    }
    let plan = args.plan.as_deref().map(std::path::absolute).transpose()?;
    let request = Request::of(&config, plan.as_deref())?;
    let terminal = Terminal::until(args.time_budget)?;
    say_what_was_opened(&request.datasets);
    if let Some(protocol) = &request.protocol {
        for departure in &protocol.departures {
            output::remark(format!(
                "note: this run differs from {}: {departure}",
                protocol.name
            ));
        }
    }
    let evaluation = prepare(request, &terminal)?;
    let complete = Outcome::of_problems(evaluation.manifest()?.lacks_files());
    let options = RunOptions {
        stages: args.stage,
        memory_limit_bytes: args.memory.limit_bytes(),
        ..RunOptions::from(&config)
    };
    if args.estimate {
        print_estimate(&evaluation.estimate(options)?, args.json)?;
        return Ok(Outcome::Done);
    }
    if let (Some(root), Some(shard)) = (&plan, args.shard) {
        let counts = evaluation.run_shard(root, shard, options, &terminal);
        args.memory.say_if_exceeded();
        let Some(counts) = unless_stopped(counts)? else {
            return Ok(Outcome::Resumable);
        };
        print_shard(args.json, root, shard, counts)?;
        return Ok(outcome(counts, args.stage.scores()).or(complete));
    }
    let Some(out) = args.out.as_deref().filter(|_| !args.dry_run) else {
        let found = DryRun {
            manifest: &evaluation.manifest()?,
            units: evaluation.status(args.out.as_deref())?,
        };
        output::print(args.json, || &found, || found.to_string())?;
        return Ok(complete);
    };
    if args.plan_only {
        let estimate = evaluation.plan(out, options, &terminal)?;
        print_estimate(&estimate, args.json)?;
        return Ok(complete);
    }
    let finished = evaluation.run(out, options, &terminal);
    args.memory.say_if_exceeded();
    let Some(finished) = unless_stopped(finished)? else {
        return Ok(Outcome::Resumable);
    };
    let evaluated = Evaluated {
        run: finished.folder.root().display().to_string(),
        scores: finished.folder.scores_path().display().to_string(),
        counts: finished.counts,
        manifest: &finished.results.manifest,
        tables: if finished.counts.left == 0 && args.stage.scores() {
            Some(tables(&finished.results, None)?)
        } else {
            None
        },
    };
    output::print(args.json, || &evaluated, || evaluated.to_string())?;
    Ok(outcome(finished.counts, args.stage.scores()).or(complete))
}

#[derive(Serialize)]
struct Evaluated<'a> {
    run: String,
    scores: String,
    #[serde(flatten)]
    counts: UnitCounts,
    manifest: &'a Manifest,
    /// The means, if all units are scored.
    #[serde(skip)]
    tables: Option<String>,
}

impl Display for Evaluated<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            run,
            scores,
            counts,
            ..
        } = self;
        if counts.left > 0 {
            let left = counted(counts.left, "unit");
            return write!(
                f,
                "stopped with {left} left of {}; the same command resumes it",
                counts.units
            );
        }
        match &self.tables {
            Some(tables) => write!(
                f,
                "{tables}\nscores  {scores}\nrun     {run}  (sharp-bench report {run})"
            ),
            None => write!(
                f,
                "{} and {} created; score the pictures with `--stage score`",
                counted(counts.predicted, "prediction"),
                counted(counts.rendered, "rendering")
            ),
        }
    }
}

#[derive(Serialize)]
struct DryRun<'a> {
    #[serde(flatten)]
    manifest: &'a Manifest,
    units: RunStatus,
}

impl Display for DryRun<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let manifest = self.manifest;
        for dataset in &manifest.datasets {
            writeln!(
                f,
                "dataset {}: {}, {} ({})",
                dataset.name,
                counted(dataset.scenes, "scene"),
                counted(dataset.views, "view"),
                dataset.spec_text()
            )?;
        }
        writeln!(
            f,
            "pairs   {} of {} listed, sha256 {}",
            manifest.pairs.evaluated, manifest.pairs.listed, manifest.pairs.sha256
        )?;
        for method in &manifest.methods {
            writeln!(f, "method  {} ({})", method.label, method.identity)?;
        }
        for metric in &manifest.metrics {
            writeln!(f, "metric  {}", metric.info.key)?;
        }
        let RunStatus {
            units,
            done,
            unscored,
            failed,
            missing,
        } = self.units;
        write!(
            f,
            "units   {units}: {done} done, {unscored} to score, {missing} missing, {failed} failed"
        )
    }
}

/// The result, or `None` if the renderer's device failed. The same command then resumes the run.
fn unless_stopped<T>(result: Result<T, EvaluateError>) -> anyhow::Result<Option<T>> {
    match result {
        Err(error @ EvaluateError::Device { .. }) => {
            output::remark(format!("stopped: {error:#}"));
            Ok(None)
        }
        result => Ok(Some(result?)),
    }
}

/// Prints the counts of `run` or `score` for a shard of the run in `root`.
pub(super) fn print_shard(
    as_json: bool,
    root: &Path,
    shard: Shard,
    counts: UnitCounts,
) -> anyhow::Result<()> {
    #[derive(Serialize)]
    struct ShardDone {
        run: String,
        shard: String,
        #[serde(flatten)]
        counts: UnitCounts,
    }
    let run = root.display().to_string();
    let text = format!(
        "shard {shard} of {run}: {}, {} done before, {} scored, {} failed, {} waiting, {} not started",
        counted(counts.units, "unit"),
        counts.reused,
        counts.scored,
        counts.failed,
        counts.waiting,
        counts.left
    );
    let shard = shard.to_string();
    output::print(as_json, || ShardDone { run, shard, counts }, || text)
}

impl Display for Estimate {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Estimate {
            units,
            sources,
            pairs,
            measured_pairs,
            total,
            predict,
            render,
            score,
            ..
        } = *self;
        let gib = |bytes: u64| format!("{:.2}", bytes as f64 / f64::from(1 << 30));
        writeln!(
            f,
            "{} ({} of {}), estimated from {measured_pairs} of these pairs:",
            counted(units, "unit"),
            counted(pairs, "pair"),
            counted(sources, "source"),
        )?;
        writeln!(f, "          CPU hours          time  memory GiB  disk GiB")?;
        let stages = [
            ("predict", predict),
            ("render", render),
            ("score", score),
            ("all", total),
        ];
        for (name, cost) in stages {
            writeln!(
                f,
                "{name:<8}{:>11.2}{:>14}{:>12}{:>10}",
                cost.cpu_secs / 3600.0,
                span(cost.wall_secs),
                cost.peak_bytes.map_or_else(|| "unknown".to_owned(), gib),
                gib(cost.disk_bytes)
            )?;
        }
        f.write_str(
        "times assume this machine's current speed; for `all`, disk is the final size of the run folder",
    )
    }
}

fn print_estimate(estimate: &Estimate, as_json: bool) -> anyhow::Result<()> {
    output::print(as_json, || estimate, || estimate.to_string())?;
    if let Estimate {
        measured_pairs,
        measured_failures: failures @ 1..,
        ..
    } = *estimate
    {
        output::remark(format!(
            "warning: {} of the measured units failed, so the estimate is too low; `run --limit \
             {measured_pairs}` shows why",
            counted(failures, "unit")
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units() {
        for (text, secs) in [("90s", 90), ("55m", 3300), ("3h", 10_800)] {
            assert_eq!(time(text), Ok(Duration::from_secs(secs)));
        }
        for text in ["", "m", "55", "-1m", "1.5h", "99999999999999999h", "5µ"] {
            assert!(time(text).is_err(), "{text}");
        }
    }
}
