//! `merge`: joins run folders, or updates the tables of one.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{Outcome, output};
use crate::evaluate::merge;
use crate::io::counts::counted;

/// Join run folders
///
/// The joined folder has the pairs, methods and datasets of all folders. Results that occur in several folders are kept
/// once; contradicting results are an error. For a single folder without --out, the tables are rewritten from the
/// results in the folder's units/.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench merge runs/node1 runs/node2 --out runs/all
  sharp-bench merge runs/first")]
pub(super) struct MergeArgs {
    /// Run folders
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Folder to write to; without it, the tables of a single folder are rewritten
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &MergeArgs) -> anyhow::Result<Outcome> {
    let results = merge(&args.folders, args.out.as_deref())?;
    for text in results.warnings() {
        output::remark(format!("warning: {text}"));
    }
    let target = args.out.as_ref().or(args.folders.first());
    let run = target.map_or_else(String::new, |path| path.display().to_string());
    let (units, missing) = (results.records.len(), results.missing.len());
    let failed = results.failures();
    output::print(
        args.json,
        || json!({"run": run, "units": units, "missing": missing, "failed": failed}),
        || {
            format!(
                "{} in {run}: {missing} missing, {failed} failed",
                counted(units, "unit")
            )
        },
    )?;
    Ok(match (missing, failed) {
        (0, 0) => Outcome::of_problems(results.manifest.lacks_files()),
        (0, _) => Outcome::RecordedFailures,
        _ => Outcome::Resumable,
    })
}
