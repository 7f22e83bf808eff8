//! `merge`: joins run folders, or updates the tables of one.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::{Outcome, output};
use crate::evaluate::merge;
use crate::io::counts::counted;

/// Join run folders
///
/// Results that occur in several folders are kept once; all other pairs, methods and datasets are combined;
/// contradictions are an error. For a single folder without --out, the tables are rewritten from the results in the
/// folder's units/.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench merge runs/node1 runs/node2 --out runs/all
  sharp-bench merge runs/first")]
pub(super) struct MergeArgs {
    /// Run folders
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Merged {
    run: String,
    units: usize,
    missing: usize,
    failed: usize,
}

impl Display for Merged {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let units = counted(self.units, "unit");
        let Self {
            run,
            missing,
            failed,
            ..
        } = self;
        write!(f, "{units} in {run}: {missing} missing, {failed} failed")
    }
}

pub(super) fn execute(args: &MergeArgs) -> anyhow::Result<Outcome> {
    let results = merge(&args.folders, args.out.as_deref())?;
    for text in results.warnings() {
        output::remark(format!("warning: {text}"));
    }
    let target = args.out.as_ref().or(args.folders.first());
    let merged = Merged {
        run: target.map_or_else(String::new, |path| path.display().to_string()),
        units: results.records.len(),
        missing: results.missing.len(),
        failed: results.failures(),
    };
    output::print(&merged, args.json)?;
    Ok(match (merged.missing, merged.failed) {
        (0, 0) => Outcome::of_problems(results.manifest.lacks_files()),
        (0, _) => Outcome::RecordedFailures,
        _ => Outcome::Resumable,
    })
}
