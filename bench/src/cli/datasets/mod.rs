//! `datasets`: lists datasets and the files that a pair list needs, and checks datasets.

mod check;
mod list;
mod needed;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::{Outcome, data_args};
use crate::pairs::{DatasetConfig, clap_dataset};

/// List datasets, list the files that a pair list needs, check a dataset before a long run
#[derive(Debug, Args)]
#[command(after_help = help())]
pub(super) struct DatasetsArgs {
    #[command(subcommand)]
    command: DatasetsCommand,
}

#[derive(Debug, Subcommand)]
enum DatasetsCommand {
    /// Describe each dataset: official page, terms, downloads, layout, and the settings that stand for different
    /// interpretations of the paper
    ///
    /// With --needed-for, lists exactly the files that the selected pairs of a list need. If --dataset is also given,
    /// checks that these files exist; the exit code is 4 if files are missing.
    List {
        /// List the files that this pair list needs
        #[arg(long, value_name = "PAIRS.csv")]
        needed_for: Option<PathBuf>,
        /// A dataset of the list, [NAME:]FORMAT=PATH; repeatable
        #[arg(long = "dataset", value_name = "SPEC", requires = "needed_for", value_parser = clap_dataset)]
        datasets: Vec<DatasetConfig>,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Check a dataset: its contents, broken files, and whether poses agree with depth
    ///
    /// Reads the cameras of every scene, decodes pictures and depth of some views of each scene, and uses the poses to
    /// project depth between neighbouring views. Without depth, a wrong scale of the poses is not detected. Swapped
    /// pictures are detected only among decoded views. Writes nothing. Exit code 0 if the dataset is sound, 4 if
    /// something is broken, 1 if it cannot be opened.
    Check {
        /// Datasets to check, [NAME:]FORMAT=PATH[,key=value…]
        #[arg(required = true, value_name = "SPEC", value_parser = clap_dataset)]
        datasets: Vec<DatasetConfig>,
        /// Number of views to decode per scene, evenly spaced; the files of the other views are only checked for
        /// existence
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
