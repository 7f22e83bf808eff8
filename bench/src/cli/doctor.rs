//! `doctor`: what this machine has, what lacks, and how to get it.

use clap::Args;
use serde::Serialize;

use sharp_metrics::Backbone;
use sharp_metrics::weights::{Published, cache_folder};

use super::{Outcome, output};
use crate::model_files::find_checkpoint;
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
        output::line(format!("{:<18} {}", finding.what, finding.found))?;
        if !finding.advice.is_empty() {
            output::line(format!("{:<18} → {}", "", finding.advice))?;
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
    findings.extend(Backbone::ALL.map(backbone));
    findings.push(match find_checkpoint() {
        Ok(path) => Finding {
            what: "SHARP weights",
            found: path.display().to_string(),
            advice: String::new(),
        },
        Err(error) => Finding {
            what: "SHARP weights",
            found: "not at hand".to_owned(),
            advice: error.to_string(),
        },
    });
    findings
}

/// Whether the weights that LPIPS or DISTS need were fetched.
fn backbone(backbone: Backbone) -> Finding {
    let what = match backbone {
        Backbone::AlexNet => "lpips-alex",
        Backbone::Vgg16 => "lpips-vgg, dists",
        Backbone::SqueezeNet1_1 => "lpips-squeeze",
    };
    let kept = cache_folder().map(|cache| Published::of(backbone).cached(&cache));
    match kept.filter(|path| path.is_file()) {
        Some(path) => Finding {
            what,
            found: path.display().to_string(),
            advice: String::new(),
        },
        None => Finding {
            what,
            found: format!("the weights of {} are not fetched", backbone.name()),
            advice: format!(
                "sharp-bench weights fetch {0}, or --weights {0}=FILE",
                backbone.name()
            ),
        },
    }
}
