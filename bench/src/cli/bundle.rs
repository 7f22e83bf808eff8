//! `bundle RUN`: packs the scores of a run into one small file.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{Outcome, output};
use crate::evaluate::write_bundle;
use crate::io::counts::counted;
use crate::io::hash::file_sha256;

/// Pack the scores of a run into one small file, to share or to commit as a baseline
///
/// Contains the exact scores, the manifest and the evaluated pairs, but no pictures. Equal results give equal bytes,
/// unless times are included. `report`, `compare`, `gate` and `history add` accept the file in place of a run folder.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench bundle runs/v1 --out baselines/v1.zip")]
pub(super) struct BundleArgs {
    /// The run folder, or an entry of a history
    run: PathBuf,
    /// The bundle to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Include the time and memory of predictions; needed if `gate` has limits on seconds_per_pair or peak_memory
    #[arg(long)]
    times: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &BundleArgs) -> anyhow::Result<Outcome> {
    let results = write_bundle(&args.run, &args.out, args.times)?;
    let (units, missing) = (results.records.len(), results.missing.len());
    let out = args.out.display();
    let (sha256, bytes) = (file_sha256(&args.out)?, std::fs::metadata(&args.out)?.len());
    output::print(
        args.json,
        || {
            json!({
                "out": out.to_string(),
                "sha256": sha256,
                "bytes": bytes,
                "units": units,
                "missing": missing,
            })
        },
        || {
            format!(
                "{out}  {} in {:.1} kB",
                counted(units, "unit"),
                bytes as f64 / 1000.0
            )
        },
    )?;
    if missing > 0 {
        let missing = counted(missing, "unit");
        output::remark(format!("note: the run is unfinished; {missing} missing"));
    }
    Ok(Outcome::of_problems(super::report::warn_damaged(&results)))
}
