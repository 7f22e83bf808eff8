//! `pairs`: the list of pairs of a dataset, as a file.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Map, json};
use sharp_datasets::Scene;

use super::data_args::{self, DatasetArgs};
use super::{Outcome, evaluate, output};
use crate::durable::write_atomic;
use crate::protocol::{PairList, PairOptions};

/// Build the list of pairs of a dataset
///
/// The list is an artifact: CSV with a sha256, to be published, compared and evaluated with `run --pairs`.
#[derive(Debug, Args)]
#[command(after_help = help())]
pub(super) struct PairsArgs {
    #[command(flatten)]
    datasets: DatasetArgs,
    /// Choices that the paper leaves open, key=value,…
    #[arg(long, value_name = "LIST", default_value = "")]
    pair_options: PairOptions,
    /// Where to write the list
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn help() -> String {
    format!(
        "Choices and their defaults:\n  {}\n\n{}\nExample:\n  sharp-bench pairs --dataset synthetic --out pairs.csv",
        PairOptions::default().to_string().replace(',', "\n  "),
        data_args::formats_help()
    )
}

pub(super) fn execute(args: &PairsArgs) -> anyhow::Result<Outcome> {
    let datasets = data_args::open(&args.datasets.datasets, args.datasets.scenes.as_deref())?;
    let scenes: Vec<Scene> = datasets.iter().flat_map(|d| d.scenes.clone()).collect();
    let build = evaluate::build(&scenes, &args.pair_options, &datasets)?;
    let list = PairList::new(&args.out, build.pairs);
    write_atomic(&args.out, list.to_csv().as_bytes())?;

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
            "out": args.out.display().to_string(),
            "sha256": list.sha256,
            "options": args.pair_options.to_string(),
            "datasets": counts,
        }))?;
        return Ok(Outcome::Done);
    }
    for (dataset, counts) in &build.summaries {
        output::line(format!(
            "{dataset}: {} scenes, {} views, {} sets, {} ordered pairs; without depth {}, too little overlap {}, \
             too near {}; {} qualify, {} selected",
            counts.scenes,
            counts.views,
            counts.sets,
            counts.considered,
            counts.without_depth,
            counts.too_little_overlap,
            counts.too_near,
            counts.qualified,
            counts.selected
        ))?;
    }
    output::line(format!("options {}", args.pair_options))?;
    output::line(format!("sha256  {}", list.sha256))?;
    output::line(format!("list    {}", args.out.display()))?;
    Ok(Outcome::Done)
}
