//! `pairs`: lists of pairs as files: built, compared, checked, exported.

mod build;
mod compare;
mod export;

use clap::{Args, Subcommand};

use super::Outcome;
use super::data_args;
use crate::protocol::PairOptions;

/// Build, compare, check and export lists of pairs
///
/// The list is an artifact: CSV with a sha256, to be published, compared and evaluated with `run --pairs`.
#[derive(Debug, Args)]
#[command(after_help = help(), args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct PairsArgs {
    #[command(subcommand)]
    command: Option<PairsCommand>,
    #[command(flatten)]
    build: build::BuildArgs,
}

#[derive(Debug, Subcommand)]
enum PairsCommand {
    Diff(compare::DiffArgs),
    Verify(compare::VerifyArgs),
    Export(export::ExportArgs),
}

fn help() -> String {
    format!(
        "Choices and their defaults:\n  {}\n\n{}\nExamples:\n  \
         sharp-bench pairs --dataset synthetic --out pairs.csv\n  \
         sharp-bench pairs diff pairs.csv theirs.csv\n  \
         sharp-bench pairs verify theirs.csv --dataset synthetic\n  \
         sharp-bench pairs export --pairs pairs.csv --dataset synthetic --out for-others --with target,depth",
        PairOptions::default().to_string().replace(',', "\n  "),
        data_args::formats_help()
    )
}

pub(super) fn execute(args: &PairsArgs) -> anyhow::Result<Outcome> {
    match &args.command {
        None => build::execute(&args.build),
        Some(PairsCommand::Diff(args)) => compare::diff(args),
        Some(PairsCommand::Verify(args)) => compare::verify(args),
        Some(PairsCommand::Export(args)) => export::execute(args),
    }
}
