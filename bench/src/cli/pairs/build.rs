//! `pairs --dataset … --out FILE`: the list of pairs of a dataset.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde_json::{Map, json};
use sharp_datasets::Scene;

use super::super::data_args::{self, DatasetArgs};
use super::super::{Outcome, evaluate, output};
use crate::durable::write_atomic;
use crate::protocol::{PairList, PairOptions};

/// What `pairs` without a subcommand takes.
#[derive(Debug, Args)]
pub(super) struct BuildArgs {
    #[command(flatten)]
    datasets: DatasetArgs,
    /// Choices that the paper leaves open, key=value,…
    #[arg(long, value_name = "LIST", default_value = "")]
    pair_options: PairOptions,
    /// Where to write the list
    #[arg(long, value_name = "FILE", required = true)]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &BuildArgs) -> anyhow::Result<Outcome> {
    let out = args.out.as_deref().context("--out FILE is needed")?;
    let datasets = data_args::open(&args.datasets.datasets, args.datasets.scenes.as_deref())?;
    let scenes: Vec<Scene> = datasets.iter().flat_map(|d| d.scenes.clone()).collect();
    let build = evaluate::build(&scenes, &args.pair_options, &datasets)?;
    let list = PairList::new(out, build.pairs);
    write_atomic(out, list.to_csv().as_bytes())?;

    if args.json {
        let counts: Map<String, _> = build
            .summaries
            .iter()
            .map(|(dataset, counts)| {
                let counts = json!({
                    "scenes": counts.scenes,
                    "views": counts.views,
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
            "options": args.pair_options.to_string(),
            "datasets": counts,
        }))?;
        return Ok(Outcome::Done);
    }
    for (dataset, counts) in &build.summaries {
        output::line(evaluate::counted_pairs(dataset, counts))?;
    }
    output::line(format!("options {}", args.pair_options))?;
    output::line(format!("sha256  {}", list.sha256))?;
    output::line(format!("list    {}", out.display()))?;
    Ok(Outcome::Done)
}
