//! `schema`: prints the JSON Schema of the files in a run folder.

use clap::{Args, ValueEnum};

use super::{Outcome, output};
use crate::config::RunConfig;
use crate::evaluate::record::Record;
use crate::evaluate::unit::Unit;
use crate::evaluate::{Manifest, RunPlan};

/// Print the JSON Schema of a file in a run folder
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench schema manifest > manifest.schema.json")]
pub(super) struct SchemaArgs {
    /// The file to describe
    #[arg(value_enum)]
    file: SchemaFile,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SchemaFile {
    /// manifest.json
    Manifest,
    /// units/*/*.json
    Unit,
    /// A record: the result of a method on a pair, with its scores, as the library's example `report_from_records`
    /// reads it
    Record,
    /// plan.json
    Plan,
    /// run.toml, and the file for `run --config`
    Run,
}

pub(super) fn execute(args: &SchemaArgs) -> anyhow::Result<Outcome> {
    output::json(&match args.file {
        SchemaFile::Manifest => schemars::schema_for!(Manifest),
        SchemaFile::Unit => schemars::schema_for!(Unit),
        SchemaFile::Record => schemars::schema_for!(Record),
        SchemaFile::Plan => schemars::schema_for!(RunPlan),
        SchemaFile::Run => schemars::schema_for!(RunConfig),
    })?;
    Ok(Outcome::Done)
}
