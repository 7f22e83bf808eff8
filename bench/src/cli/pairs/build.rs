//! `pairs --dataset … --out FILE`: the list of pairs of a dataset.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde_json::{Map, json};

use super::super::data_args::DatasetArgs;
use super::super::observer::Terminal;
use super::super::pair_args::OverlapArgs;
use super::super::{Outcome, output};
use super::ambiguity;
use crate::io::atomic_files::write_atomic;
use crate::pairs::PairOptions;
use crate::pairs::advice::counted_pairs;
use crate::pairs::ambiguity::other_readings;
use crate::pairs::options::paper::PROXY;
use crate::pairs::provenance::ListCompanion;

/// What `pairs` without a subcommand takes.
#[derive(Debug, Args)]
pub(super) struct BuildArgs {
    #[command(flatten)]
    datasets: DatasetArgs,
    /// Choices that the paper leaves open, key=value,…; keys, values and defaults below
    #[arg(long, value_name = "LIST", default_value = "")]
    pair_options: PairOptions,
    #[command(flatten)]
    overlap: OverlapArgs,
    /// Where to write the list; FILE.json beside it says how it came about
    #[arg(long, value_name = "FILE", required_unless_present = "ambiguity")]
    out: Option<PathBuf>,
    /// Print how the number of pairs changes over the choices that the paper leaves open and over the datasets' other
    /// readings, one at a time
    #[arg(long, conflicts_with = "out")]
    ambiguity: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &BuildArgs) -> anyhow::Result<Outcome> {
    let recipe = args.overlap.recipe(&args.pair_options)?;
    let datasets = args.datasets.open()?;
    let (cache, terminal) = (args.overlap.cache(), Terminal::default());
    if args.ambiguity {
        let readings = other_readings(&datasets, args.datasets.scenes.as_deref())?;
        let rows = recipe.ambiguity(&datasets, &readings, cache.as_ref(), &terminal)?;
        return ambiguity::print(&rows, &recipe.options, args.json);
    }
    let out = args.out.as_deref().context("--out FILE is needed")?;
    let built = recipe.build(&datasets, cache.as_ref(), &terminal)?;
    let list = built.list(out);
    write_atomic(out, list.to_csv().as_bytes())?;
    ListCompanion::new(&list, &built.provenance, &args.datasets.datasets).write(out)?;
    let build = &built.build;
    let outcome = if built.has_selected() {
        Outcome::Done
    } else {
        Outcome::RecordedFailures
    };
    for advice in &built.advice {
        output::remark(format!("warning: {advice}"));
    }

    if args.json {
        let counts: Map<String, _> = build
            .summaries
            .iter()
            .map(|(dataset, counts)| {
                let counts = json!({
                    "scenes": counts.scenes,
                    "views": counts.views,
                    "with_depth": counts.with_depth,
                    "with_sparse_depth": counts.with_sparse_depth,
                    "sets": counts.sets,
                    "considered": counts.considered,
                    "too_near": counts.too_near,
                    "without_depth": counts.without_depth,
                    "too_little_overlap": counts.too_little_overlap,
                    "qualified": counts.qualified,
                    "selected": counts.selected,
                });
                (dataset.clone(), counts)
            })
            .collect();
        output::json(&json!({
            "out": out.display().to_string(),
            "sha256": list.sha256,
            "options": recipe.options.to_string(),
            "overlap_depth": built.common_depth(),
            "choices": built.provenance,
            "proxies": recipe.options.proxies(),
            "warnings": built.advice,
            "datasets": counts,
        }))?;
        return Ok(outcome);
    }
    for (dataset, counts) in &build.summaries {
        output::line(counted_pairs(dataset, counts))?;
    }
    for (dataset, choices) in &built.provenance {
        output::line(format!("{dataset}: options {}", choices.options))?;
        for proxy in choices.options.proxies() {
            output::line(format!("        {proxy} ({PROXY})"))?;
        }
        output::line(format!("        depth {}", choices.overlap_depth))?;
    }
    output::line(format!("sha256  {}", list.sha256))?;
    output::line(format!("list    {}", out.display()))?;
    Ok(outcome)
}
