//! `bundle RUN`: packs the scores of a run into one small file.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

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
    /// Include time and memory of predictions, which a gate's limits on seconds_per_pair and peak_memory need
    #[arg(long)]
    times: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Packed {
    out: String,
    sha256: String,
    bytes: u64,
    units: usize,
    missing: usize,
}

impl Display for Packed {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let units = counted(self.units, "unit");
        write!(
            f,
            "{}  {units} in {:.1} kB",
            self.out,
            self.bytes as f64 / 1000.0
        )
    }
}

pub(super) fn execute(args: &BundleArgs) -> anyhow::Result<Outcome> {
    let results = write_bundle(&args.run, &args.out, args.times)?;
    let packed = Packed {
        out: args.out.display().to_string(),
        sha256: file_sha256(&args.out)?,
        bytes: std::fs::metadata(&args.out)?.len(),
        units: results.records.len(),
        missing: results.missing.len(),
    };
    output::print(&packed, args.json)?;
    if !results.missing.is_empty() {
        output::remark(format!(
            "note: the run has not ended; missing: {}",
            counted(results.missing.len(), "unit")
        ));
    }
    Ok(Outcome::of_problems(super::report::warn_damaged(&results)))
}
