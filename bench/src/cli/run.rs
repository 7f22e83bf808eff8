//! `run`: methods on datasets, into a run folder.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use sharp::render::Backend;

use super::data_args::{DatasetArgs, MetricArgs};
use super::evaluate::{Evaluation, Request};
use super::pair_args::PairArgs;
use super::usage::UsageError;
use super::{Outcome, backend_args, output, report};
use crate::counted::counted;
use crate::runs::error::RunError;
use crate::runs::plan::Keep;

/// Evaluate methods on datasets into a run folder
///
/// A run can be stopped and started again with the same command: finished units are kept, recorded failures are tried
/// again. A pair that fails becomes a recorded failure and the others go on (exit code 4).
#[derive(Debug, Args)]
#[command(after_help = help())]
pub(super) struct RunArgs {
    #[command(flatten)]
    datasets: DatasetArgs,
    /// A method, KIND[:key=value,…]; repeatable
    #[arg(long = "method", value_name = "SPEC", required = true)]
    methods: Vec<String>,
    #[command(flatten)]
    metrics: MetricArgs,
    #[command(flatten)]
    pairs: PairArgs,
    /// Evaluate at most this many pairs: the first ones by id of each dataset in turn
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// Score all methods of a pair on the part of the target that all of them predict
    #[arg(long)]
    common_region: bool,
    /// Of methods that rendered several scales, score the one with the least DISTS of each pair (the paper's rule for
    /// methods without metric scale); the report says "best of N scales by DISTS"
    #[arg(long)]
    scale_sweep: bool,
    /// The run folder
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Which predicted pictures to keep
    #[arg(long, value_enum, default_value_t = Keep::All)]
    keep: Keep,
    /// Who renders: cpu, or wgpu (a GPU through Vulkan, Metal or Direct3D 12). The exact backend is part of every
    /// result's identity, and a run has one
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Cpu)]
    backend: Backend,
    /// The GPU, by a part of its description (`sharp-bench doctor` lists them)
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Threads; all cores without it. Results do not depend on it
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Show what would be evaluated, and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn help() -> String {
    let kinds: String = crate::methods::KINDS
        .iter()
        .map(|kind| format!("  {:<12} {}\n", kind.name, kind.summary))
        .collect();
    format!(
        "Methods (each also takes label=NAME):\n{kinds}\n{}\n\
         Examples:\n  \
         sharp-bench run --dataset middlebury=data/Middlebury2014 --method copy --method depth-splat --out runs/first\n  \
         sharp-bench run --dataset synthetic --method imported:label=mine,dir=predictions --metrics paper,ssim --out runs/mine",
        super::data_args::formats_help()
    )
}

pub(super) fn execute(args: &RunArgs) -> anyhow::Result<Outcome> {
    super::set_threads(args.threads)?;
    let backend = backend_args::chosen(&args.backend, args.adapter.as_deref())?;
    if backend == Backend::Auto {
        let reason = "--backend auto is for `render`: scores must not depend on what a machine has; say cpu or wgpu";
        return Err(UsageError(reason.to_owned()).into());
    }
    let scoring = args.metrics.complete_scoring()?;
    let evaluation = Evaluation::prepare(Request {
        datasets: &args.datasets.datasets,
        scenes: args.datasets.scenes.as_deref(),
        pairs: args.pairs.origin()?,
        methods: &args.methods,
        scoring,
        limit: args.limit,
        common_region: args.common_region,
        backend: &backend,
        chooser: args
            .scale_sweep
            .then(|| args.metrics.scale_chooser())
            .transpose()?,
    })?;
    if args.dry_run {
        return dry_run(&evaluation, args.json);
    }
    let finished = match evaluation.run(&args.out, args.keep) {
        Err(error) if matches!(error.downcast_ref(), Some(RunError::Device { .. })) => {
            output::remark(format!("stopped: {error:#}"));
            return Ok(Outcome::Resumable);
        }
        result => result?,
    };
    let outcome = report::outcome(&finished.executed);
    let (root, scores) = (
        finished.folder.root().display().to_string(),
        finished.folder.scores_path().display().to_string(),
    );
    if args.json {
        output::json(&json!({
            "run": root,
            "scores": scores,
            "units": finished.executed.units.len(),
            "reused": finished.executed.reused,
            "failed": finished.executed.failures(),
            "manifest": finished.manifest,
        }))?;
    } else {
        report::print_tables(&[finished.into()])?;
        output::line(format!("scores  {scores}"))?;
        output::line(format!("run     {root}  (sharp-bench report {root})"))?;
    }
    Ok(outcome)
}

fn dry_run(evaluation: &Evaluation, json: bool) -> anyhow::Result<Outcome> {
    let manifest = evaluation.manifest()?;
    if json {
        output::json(&manifest)?;
        return Ok(Outcome::Done);
    }
    for dataset in &manifest.datasets {
        output::line(format!(
            "dataset {}: {}, {} ({})",
            dataset.name,
            counted(dataset.scenes, "scene"),
            counted(dataset.views, "view"),
            dataset.spec
        ))?;
    }
    output::line(format!(
        "pairs   {} of {} listed, sha256 {}",
        manifest.pairs.evaluated, manifest.pairs.listed, manifest.pairs.sha256
    ))?;
    for method in &manifest.methods {
        output::line(format!("method  {} ({})", method.label, method.identity))?;
    }
    for metric in &manifest.metrics {
        output::line(format!("metric  {}", metric.key))?;
    }
    output::line(format!(
        "units   {}",
        manifest.pairs.evaluated * manifest.methods.len()
    ))?;
    Ok(Outcome::Done)
}
