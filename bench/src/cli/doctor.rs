//! `doctor`: what this machine has, what lacks, and how to get it.

use clap::Args;
use serde::Serialize;

use super::{Outcome, output};
use crate::runs::unit::{SOURCE_FINGERPRINT, cpu_backend};

/// Show what this machine has, what lacks, and how to get it
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench doctor --json")]
pub(super) struct DoctorArgs {
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// One finding.
#[derive(Debug, Serialize)]
struct Finding {
    /// What was looked at.
    what: &'static str,
    /// What was found.
    found: String,
    /// How to get what lacks; empty where nothing does.
    advice: String,
}

pub(super) fn execute(args: &DoctorArgs) -> anyhow::Result<Outcome> {
    let findings = findings();
    if args.json {
        output::json(&findings)?;
        return Ok(Outcome::Done);
    }
    for finding in &findings {
        output::line(format!("{:<16} {}", finding.what, finding.found))?;
        if !finding.advice.is_empty() {
            output::line(format!("{:<16} → {}", "", finding.advice))?;
        }
    }
    Ok(Outcome::Done)
}

fn findings() -> Vec<Finding> {
    let mut findings = vec![
        Finding {
            what: "version",
            found: format!(
                "{} (sources {})",
                env!("CARGO_PKG_VERSION"),
                &SOURCE_FINGERPRINT[..12]
            ),
            advice: String::new(),
        },
        Finding {
            what: "threads",
            found: rayon::current_num_threads().to_string(),
            advice: String::new(),
        },
        Finding {
            what: "cpu backend",
            found: cpu_backend().to_owned(),
            advice: String::new(),
        },
        Finding {
            what: "datasets",
            found: "middlebury/Motorcycle-quarter and a procedural scene are built in".to_owned(),
            advice: "use your own with --dataset FORMAT=PATH".to_owned(),
        },
    ];
    findings.extend(metric_findings());
    findings
}

/// Metrics that cannot be computed here, by reason.
fn metric_findings() -> Vec<Finding> {
    Vec::new()
}
