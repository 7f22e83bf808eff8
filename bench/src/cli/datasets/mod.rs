//! `datasets`: lists them, names the files that a pair list needs, checks one.

mod check;
mod list;
mod needed;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::{Outcome, data_args};

/// List datasets, name the files that a pair list needs, check a dataset before a long run
#[derive(Debug, Args)]
#[command(after_help = help())]
pub(super) struct DatasetsArgs {
    #[command(subcommand)]
    command: DatasetsCommand,
}

#[derive(Debug, Subcommand)]
enum DatasetsCommand {
    /// What each dataset is: official page, terms, what to download, layout, readings of the paper by name
    ///
    /// With --needed-for, lists exactly the files that the selected pairs of a list need; with --dataset too, checks
    /// that they exist (exit code 4 if some do not).
    List {
        /// Name the files that this pair list needs
        #[arg(long, value_name = "PAIRS.csv")]
        needed_for: Option<PathBuf>,
        /// A dataset of the list, [NAME:]FORMAT=PATH; repeatable
        #[arg(long = "dataset", value_name = "SPEC", requires = "needed_for")]
        datasets: Vec<String>,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Check a dataset: what it holds, what is broken and why, whether poses agree with depth
    ///
    /// Reads cameras of every scene, decodes pictures and depth of some views of each, and carries depth between
    /// neighbouring views by their poses. The scale of poses without depth, and two exchanged pictures that are not among
    /// those looked at, cannot be told from proper data. Nothing is written. Exit code 0 when it is sound, 4 when something is broken,
    /// 1 when it cannot be opened.
    Check {
        /// The dataset, [NAME:]FORMAT=PATH[,key=value…]; several are checked one by one
        #[arg(required = true, value_name = "SPEC")]
        datasets: Vec<String>,
        /// Views of a scene to decode, evenly spaced; of the others only their existence is checked
        #[arg(long, value_name = "N", default_value_t = 10)]
        views: usize,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
}

fn help() -> String {
    format!(
        "{}\nExamples:\n  \
         sharp-bench datasets list\n  \
         sharp-bench datasets list --needed-for pairs.csv\n  \
         sharp-bench datasets list --needed-for pairs.csv --dataset eth3d=/data/eth3d\n  \
         sharp-bench datasets check middlebury=/data/middlebury\n  \
         sharp-bench datasets check scannetpp=/data/scannetpp,split=nvs_sem_val --views 3 --json",
        data_args::formats_help()
    )
}

pub(super) fn execute(args: &DatasetsArgs) -> anyhow::Result<Outcome> {
    match &args.command {
        DatasetsCommand::List {
            needed_for: Some(pairs),
            datasets,
            json,
        } => needed::execute(pairs, datasets, *json),
        DatasetsCommand::List { json, .. } => list::execute(*json),
        DatasetsCommand::Check {
            datasets,
            views,
            json,
        } => check::execute(datasets, *views, *json),
    }
}
