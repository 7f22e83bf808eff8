//! `pairs --dataset … --out FILE`: the list of pairs of a dataset.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde_json::{Map, json};

use super::super::data_args::{self, DatasetArgs};
use super::super::list_facts::ListCompanion;
use super::super::pair_advice::counted_pairs;
use super::super::pair_recipe::{OverlapArgs, PairRecipe};
use super::super::{Outcome, output};
use super::ambiguity;
use crate::durable::write_atomic;
use crate::protocol::options::paper::PROXY;
use crate::protocol::{PairList, PairOptions};

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
    let recipe = PairRecipe::new(args.pair_options.clone(), args.overlap.clone())?;
    let datasets = data_args::open(&args.datasets.datasets, args.datasets.scenes.as_deref())?;
    if args.ambiguity {
        let readings = ambiguity::readings(&datasets, args.datasets.scenes.as_deref())?;
        let rows = recipe.ambiguity(&datasets, &readings)?;
        return ambiguity::print(&rows, recipe.options(), args.json);
    }
    let out = args.out.as_deref().context("--out FILE is needed")?;
    let built = recipe.build(&datasets)?;
    let list = PairList::new(out, built.pairs.pairs.clone());
    write_atomic(out, list.to_csv().as_bytes())?;
    ListCompanion::new(&list.sha256, &built, &args.datasets.datasets).write(out)?;
    let build = &built.pairs;
    let outcome = if build.pairs.iter().any(|pair| pair.selected) {
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
            "options": recipe.options().to_string(),
            "overlap_depth": built.facts.get("overlap depth"),
            "overlap_depth_maps": built.facts.get("overlap depth maps"),
            "proxies": recipe.options().proxies(),
            "warnings": built.advice,
            "datasets": counts,
        }))?;
        return Ok(outcome);
    }
    for (dataset, counts) in &build.summaries {
        output::line(counted_pairs(dataset, counts))?;
    }
    output::line(format!("options {}", recipe.options()))?;
    for proxy in recipe.options().proxies() {
        output::line(format!("        {proxy} ({PROXY})"))?;
    }
    if let Some(depth) = built.facts.get("overlap depth") {
        output::line(format!("depth   {depth}"))?;
    }
    output::line(format!("sha256  {}", list.sha256))?;
    output::line(format!("list    {}", out.display()))?;
    Ok(outcome)
}
