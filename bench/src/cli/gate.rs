//! `gate --baseline A --candidate B`: decides in continuous integration whether B may replace A.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde::Serialize;

use super::compare::method_pair;
use super::outcome::UsageError;
use super::{Outcome, output};
use crate::io::atomic_files::write_over_own;
use crate::track::compare::CompareError;
use crate::track::gate::config::MetricName;
use crate::track::gate::output::{junit, markdown};
use crate::track::gate::{CheckState, GateConfig, GateError, GateReport, Limit, gate};

/// Compare a run with a baseline in continuous integration: exit code 3 if the run is worse than the limits allow
///
/// A limit fires if B is worse than A by more than the limit, on a dataset or over all datasets, with p < 0.05 after
/// Holm's correction. Limits marked `per scene` fire for any p. If no limits are given, every significant loss fires.
/// Missing scores count as violations. Exit code 5 means that no limit fired, but at least one limit cannot be decided.
#[derive(Debug, Args)]
#[command(after_help = "\
Limits:
  lpips > +0.005             on each dataset, and over all
  psnr < -0.1 on eth3d       on one dataset; `on all` is the mean of the datasets
  psnr < -1 per scene        on the mean of each scene, significant or not
  |lpips| > 0.005            in either direction
  seconds_per_pair > +10 %   more than 10 % slower than A, on the same class of device
  peak_memory > +10 %        more than 10 % above A's memory, on the same class of device

Examples:
  sharp-bench gate --baseline main.zip --candidate runs/now \\
      --fail-if 'psnr < -0.1' --fail-if 'lpips > +0.005'
  sharp-bench gate --baseline main.zip --candidate runs/now \\
      --config gate.toml --junit gate.xml --markdown comment.md")]
pub(super) struct GateArgs {
    /// Run A, the baseline: a folder or a bundle
    #[arg(long, value_name = "A")]
    baseline: PathBuf,
    /// Run B, the candidate: a folder or a bundle
    #[arg(long, value_name = "B")]
    candidate: PathBuf,
    /// A TOML file of limits, with lines such as fail_if = ["psnr < -0.1"], missing_pairs = 0 or
    /// require_power = { psnr = 0.5 }
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// A limit on the significant difference B − A, in addition to those of --config; repeatable
    #[arg(long, value_name = "LIMIT")]
    fail_if: Vec<Limit>,
    /// Exit code 5 if the runs have too little data to detect a difference of this size, as in psnr=0.5,lpips=0.01
    #[arg(long, value_name = "METRIC=D", value_delimiter = ',', value_parser = power)]
    require_power: Vec<(MetricName, f64)>,
    /// Compare method OLD of A with method NEW of B [default: methods with the same label, or each run's only method]
    #[arg(long = "method", value_name = "OLD=NEW", value_parser = method_pair)]
    methods: Vec<(String, String)>,
    /// Write the result as JUnit XML
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Write the result as Markdown, for a comment on a pull request
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn power(text: &str) -> Result<(MetricName, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected METRIC=D")?;
    let value = value.parse().ok();
    let value = value.filter(|d: &f64| d.is_finite() && *d > 0.0);
    Ok((name.parse()?, value.ok_or("expected a number above 0")?))
}

#[derive(Serialize)]
struct Judged<'a> {
    schema: u32,
    headline: String,
    gate: &'a GateReport,
}

pub(super) fn execute(args: &GateArgs) -> anyhow::Result<Outcome> {
    let mut config = GateConfig::default();
    if let Some(path) = &args.config {
        let text = sharp::files::read_text(path).with_context(|| path.display().to_string())?;
        let usage = |reason| UsageError(format!("{}: {reason}", path.display()));
        config = GateConfig::parse(&text).map_err(usage)?;
    }
    config.fail_if.extend(args.fail_if.iter().cloned());
    config
        .require_power
        .extend(args.require_power.iter().copied());
    let report = gate(&args.baseline, &args.candidate, &args.methods, &config);
    let report = report.map_err(|error| match error {
        GateError::Limits(reason) | GateError::Compare(CompareError::Methods(reason)) => {
            anyhow::Error::from(UsageError(reason))
        }
        other => other.into(),
    })?;
    if let Some(path) = &args.junit {
        write_over_own(
            path,
            junit(&report).as_bytes(),
            "<testsuite name=\"sharp-bench gate\"",
        )?;
    }
    if let Some(path) = &args.markdown {
        write_over_own(path, markdown(&report).as_bytes(), "### Quality gate")?;
    }
    let judged = Judged {
        schema: 1,
        headline: report.headline(),
        gate: &report,
    };
    output::print(
        args.json,
        || &judged,
        || {
            let mut text = String::new();
            for grid in report.grids() {
                text += &format!("{}\n", grid.text());
            }
            text + &judged.headline
        },
    )?;
    for note in &report.notes {
        output::remark(format!("note: {note}"));
    }
    Ok(match report.state {
        CheckState::Fired => Outcome::GateFired,
        CheckState::Inconclusive => Outcome::GateInconclusive,
        _ => Outcome::Done,
    })
}
