//! `pairs --dataset … --out FILE`: builds a dataset's pair list.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde_json::json;

use super::super::data_args::DatasetArgs;
use super::super::output::Terminal;
use super::super::{Outcome, output};
use crate::config::OverlapConfig;
use crate::io::atomic_files::write_over_own;
use crate::pairs::PairOptions;
use crate::pairs::advice::counted_pairs;
use crate::pairs::ambiguity::{Alternative, other_readings};
use crate::pairs::options::paper::PROXY;
use crate::pairs::pair_list::LIST_MARK;
use crate::pairs::provenance::ListCompanion;

/// Options of `pairs` without a subcommand.
#[derive(Debug, Args)]
pub(super) struct BuildArgs {
    #[command(flatten)]
    datasets: DatasetArgs,
    /// How to build pairs where the paper leaves a choice, key=value,…; listed below
    #[arg(long, value_name = "LIST", default_value = "")]
    pair_options: PairOptions,
    #[command(flatten)]
    overlap: OverlapConfig,
    /// Write the list to this file; FILE.json next to it records how the list was made
    #[arg(long, value_name = "FILE", required_unless_present = "ambiguity")]
    out: Option<PathBuf>,
    /// Print how the number of pairs changes with each choice that the SHARP paper leaves open, and with each
    /// alternative setting of the datasets
    #[arg(long, conflicts_with = "out")]
    ambiguity: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &BuildArgs) -> anyhow::Result<Outcome> {
    let recipe = args.overlap.recipe(&args.pair_options)?;
    let mut datasets = args.datasets.open()?;
    let (cache, terminal) = (args.overlap.cache(), Terminal::default());
    if let Some(checks) = args.overlap.checks() {
        let datasets = datasets.iter_mut();
        datasets.for_each(|dataset| checks.look_at(dataset, &terminal));
    }
    if args.ambiguity {
        let readings = other_readings(&datasets, args.datasets.scenes.as_deref())?;
        let rows = recipe.ambiguity(&datasets, &readings, cache.as_ref(), &terminal)?;
        let options = recipe.options.to_string();
        let value = || json!({"options": options, "choices": rows});
        output::print(args.json, value, || {
            ambiguity(&rows) + "as given: " + &options
        })?;
        return Ok(Outcome::Done);
    }
    let out = args.out.as_deref().context("give --out FILE")?;
    let built = recipe.build(&datasets, cache.as_ref(), &terminal)?;
    let list = built.list(out);
    write_over_own(out, list.bytes(), LIST_MARK)?;
    ListCompanion::new(&list, &built.provenance, &args.datasets.datasets).write(out)?;
    let build = &built.build;
    let has_problems = !built.has_selected() || build.left_out().next().is_some();
    let outcome = Outcome::of_problems(has_problems).with_scenes_of(&datasets);
    for advice in &built.advice {
        output::remark(format!("warning: {advice}"));
    }

    let value = || {
        json!({
            "out": out.display().to_string(),
            "sha256": list.sha256,
            "options": recipe.options.to_string(),
            "overlap_depth": built.common_depth(),
            "choices": built.provenance,
            "proxies": recipe.options.proxies(),
            "warnings": built.advice,
            "datasets": build.summaries,
        })
    };
    output::print(args.json, value, || {
        let mut text = String::new();
        for (dataset, counts) in &build.summaries {
            text += &format!("{}\n", counted_pairs(dataset, counts));
        }
        for (dataset, choices) in &built.provenance {
            for proxy in choices.options.proxies() {
                text += &format!("{dataset}: {proxy} ({PROXY})\n");
            }
            text += &format!("{dataset}: depth {}\n", choices.overlap_depth);
        }
        text + &format!("sha256  {}\nlist    {}", list.sha256, out.display())
    })?;
    Ok(outcome)
}

/// Text on how the number of pairs depends on each open choice.
fn ambiguity(rows: &[Alternative]) -> String {
    let mut text = String::new();
    let datasets: BTreeSet<&String> = rows
        .iter()
        .flat_map(|row| row.counts.keys().chain(row.unavailable.keys()))
        .collect();
    for dataset in datasets {
        text += &format!("{dataset}, one choice changed at a time:\n");
        text += &format!(
            "  {:<18} {:<28} {:>8} {:>8} {:>8}\n",
            "about", "choice", "qualify", "selected", "shared"
        );
        for row in rows {
            let change = if row.change.is_empty() {
                "(as given)"
            } else {
                &row.change
            };
            if let Some(count) = row.counts.get(dataset) {
                text += &format!(
                    "  {:<18} {change:<28} {:>8} {:>8} {:>8}\n",
                    row.about, count.qualified, count.selected, count.shared
                );
            } else if let Some(reason) = row.unavailable.get(dataset) {
                text += &format!(
                    "  {:<18} {change:<28} the dataset cannot be opened: {reason}\n",
                    row.about
                );
            }
        }
    }
    text + "shared: pairs that the given options also select; choices that do not affect a dataset are omitted\n"
}
