//! `pairs --dataset … --out FILE`: builds a dataset's pair list.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde::Serialize;

use super::super::data_args::DatasetArgs;
use super::super::output::Terminal;
use super::super::{Outcome, output};
use crate::config::OverlapConfig;
use crate::io::atomic_files::write_over_own;
use crate::pairs::advice::counted_pairs;
use crate::pairs::ambiguity::{Alternative, other_readings};
use crate::pairs::build::PairCounts;
use crate::pairs::options::paper::PROXY;
use crate::pairs::pair_list::LIST_MARK;
use crate::pairs::provenance::ListCompanion;
use crate::pairs::{PairOptions, PairProvenance};

/// Options of `pairs` without a subcommand.
#[derive(Debug, Args)]
pub(super) struct BuildArgs {
    #[command(flatten)]
    datasets: DatasetArgs,
    /// Pair options that the paper leaves open, key=value,…; listed below
    #[arg(long, value_name = "LIST", default_value = "")]
    pair_options: PairOptions,
    #[command(flatten)]
    overlap: OverlapConfig,
    /// File for the list; FILE.json next to the list records how the list was made
    #[arg(long, value_name = "FILE", required_unless_present = "ambiguity")]
    out: Option<PathBuf>,
    /// Print how the number of pairs changes with each choice that the paper leaves open and with
    /// each alternative reading of the datasets
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
        let ambiguity = Ambiguity {
            options: recipe.options.to_string(),
            choices: rows,
        };
        output::print(&ambiguity, args.json)?;
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

    let built = ListSummary {
        out: out.display().to_string(),
        sha256: &list.sha256,
        options: recipe.options.to_string(),
        overlap_depth: built.common_depth(),
        choices: &built.provenance,
        proxies: recipe.options.proxies(),
        warnings: &built.advice,
        datasets: &build.summaries,
    };
    output::print(&built, args.json)?;
    Ok(outcome)
}

#[derive(Serialize)]
struct ListSummary<'a> {
    out: String,
    sha256: &'a str,
    options: String,
    overlap_depth: Option<&'a str>,
    choices: &'a BTreeMap<String, PairProvenance>,
    proxies: Vec<String>,
    warnings: &'a [String],
    datasets: &'a BTreeMap<String, PairCounts>,
}

impl Display for ListSummary<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (dataset, counts) in self.datasets {
            writeln!(f, "{}", counted_pairs(dataset, counts))?;
        }
        for (dataset, choices) in self.choices {
            for proxy in choices.options.proxies() {
                writeln!(f, "{dataset}: {proxy} ({PROXY})")?;
            }
            writeln!(f, "{dataset}: depth {}", choices.overlap_depth)?;
        }
        write!(f, "sha256  {}\nlist    {}", self.sha256, self.out)
    }
}

/// How the number of pairs depends on each open choice.
#[derive(Serialize)]
struct Ambiguity {
    options: String,
    choices: Vec<Alternative>,
}

impl Display for Ambiguity {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let rows = &self.choices;
        let datasets: BTreeSet<&String> = rows
            .iter()
            .flat_map(|row| row.counts.keys().chain(row.unavailable.keys()))
            .collect();
        for dataset in datasets {
            writeln!(f, "{dataset}, one choice changed at a time:")?;
            writeln!(
                f,
                "  {:<18} {:<28} {:>8} {:>8} {:>8}",
                "about", "choice", "qualify", "selected", "shared"
            )?;
            for row in rows {
                let change = if row.change.is_empty() {
                    "(as given)"
                } else {
                    &row.change
                };
                if let Some(count) = row.counts.get(dataset) {
                    writeln!(
                        f,
                        "  {:<18} {change:<28} {:>8} {:>8} {:>8}",
                        row.about, count.qualified, count.selected, count.shared
                    )?;
                } else if let Some(reason) = row.unavailable.get(dataset) {
                    writeln!(
                        f,
                        "  {:<18} {change:<28} the dataset cannot be opened: {reason}",
                        row.about
                    )?;
                }
            }
        }
        writeln!(
            f,
            "shared: pairs that the given options also select; choices that do not affect a dataset are omitted",
        )?;
        write!(f, "as given: {}", self.options)
    }
}
