//! `sweep RUN…`: scores against camera motion.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};
use sharp_datasets::error::nearest_of;
use sharp_metrics::MetricKey;

use super::outcome::UsageError;
use super::report::{ShownRuns, warn_damaged};
use super::{Outcome, output};
use crate::evaluate::Results;
use crate::io::counts::counted;
use crate::pictures::keyed_scores::json_number;
use crate::report::sweep::spec::Threshold;
use crate::report::sweep::study::FoundCrossing;
use crate::report::sweep::{Band, Motion, Split, Sweep, SweepSpec, files, table};
use sharp_plots::bins::Binning;
use sharp_plots::style::FigureStyle;

/// Plot scores against camera motion, with a table of the plotted values
///
/// Pairs are binned. Each bin shows the mean of each method's scores, their standard deviation, and
/// the 95 % interval of the mean, computed over scenes because pairs of one scene are correlated.
/// Lines and shaded bands stop at empty bins; a bin with a single pair is a hollow point.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench sweep runs/first --out sweep
  sharp-bench sweep runs/sharp runs/baselines --x overlap --bins quantile:8 --band ci95 --out sweep
  sharp-bench sweep runs/first --bins 0.1 --metrics dists --threshold dists=0.2 \\
      --against sharp --out sweep

Writes sweep-METRIC.svg, .png and .pdf, sweep.csv (dataset,method,split,metric,x,x_low,x_high,n,mean,sd,ci_low,ci_high),
sweep.tex, and with --threshold or --against sweep-crossings.csv. The paper's own plots: sharp-bench figure motion,
figure motion-privileged.")]
pub(super) struct SweepArgs {
    #[command(flatten)]
    runs: ShownRuns,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The horizontal axis
    #[arg(long, value_enum, value_name = "MOTION", default_value = "baseline_m")]
    x: Motion,
    /// Bins: a width (0.1), quantile:N (N bins of equally many pairs, up to 1000) or edges (0,0.1,0.5; pairs beyond
    /// the edges are left out). A bin includes its lower edge [default: at most ten bins, whose width is a round number]
    #[arg(long, value_name = "BINS")]
    bins: Option<Binning>,
    /// The shaded band around a mean
    #[arg(long, value_enum, default_value_t)]
    band: Band,
    /// What each panel shows
    #[arg(long, value_enum, default_value_t)]
    split: Split,
    /// Report the motion beyond which each method's mean is worse than VALUE; repeatable
    #[arg(long = "threshold", value_name = "METRIC=VALUE")]
    thresholds: Vec<Threshold>,
    /// Report the motion beyond which each method is worse than METHOD, over the pairs scored for both methods
    #[arg(long, value_name = "METHOD")]
    against: Option<String>,
    /// A TOML file with the figures' sizes and colours: width_mm, font_pt, dpi, panel_aspect, caption, colours
    #[arg(long, value_name = "FILE")]
    style: Option<PathBuf>,
    /// Print the list of written files, and the results of `--threshold` and `--against`, as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &SweepArgs) -> anyhow::Result<Outcome> {
    let listed = &args.runs.shown.metrics;
    let left_out = |key: &&MetricKey| !listed.is_empty() && !listed.contains(key);
    let mut limited = args.thresholds.iter().map(|threshold| &threshold.metric);
    if let Some(key) = limited.find(left_out) {
        let reason = format!("--threshold {key}=…: --metrics does not include {key}");
        return Err(UsageError(reason).into());
    }
    let style = style(args.style.as_ref())?;
    let spec = SweepSpec {
        x: args.x,
        band: args.band,
        split: args.split,
        thresholds: args.thresholds.clone(),
        against: args
            .against
            .as_ref()
            .map(|label| args.runs.shown.name(label).to_owned()),
        binning: args.bins.clone().unwrap_or(SweepSpec::default().binning),
        ..SweepSpec::default()
    };
    sweep(&args.runs, spec, (&args.out, "sweep"), &style, args.json)
}

pub(super) fn style(file: Option<&PathBuf>) -> anyhow::Result<FigureStyle> {
    let style = file.map_or_else(
        || Ok(FigureStyle::default()),
        |file| FigureStyle::read(file),
    );
    style.map_err(|error| UsageError(format!("--style: {error:#}")).into())
}

/// Rejects a style that has an entry for a method that none of the results shows.
pub(super) fn check_methods(style: &FigureStyle, results: &Results) -> Result<(), UsageError> {
    let methods = results.manifest.methods.iter();
    let known: Vec<&str> = methods.map(|method| method.label.as_str()).collect();
    let unknown = style
        .methods
        .keys()
        .find(|name| !known.contains(&name.as_str()));
    unknown.map_or(Ok(()), |name| {
        let nearest = nearest_of(name, &known);
        Err(UsageError(format!(
            "--style: [methods.{name}] is for a method that is not shown; {nearest}"
        )))
    })
}

/// Computes a sweep, writes it and prints a summary.
pub(super) fn sweep(
    runs: &ShownRuns,
    spec: SweepSpec,
    (out, stem): (&Path, &str),
    style: &FigureStyle,
    as_json: bool,
) -> anyhow::Result<Outcome> {
    let results = runs.results(None)?;
    check_methods(style, &results)?;
    let sweep = Sweep::of(&results, spec)?;
    let files = files::write(&sweep, out, stem, style)?;
    let removed = output::names(&files.removed);
    let value = || {
        let crossings = sweep
            .crossings
            .iter()
            .map(|found| crossing_json(&sweep, found));
        json!({
            "out": out.display().to_string(),
            "files": output::names(&files.written),
            "removed": removed,
            "crossings": crossings.collect::<Vec<_>>(),
        })
    };
    output::print(as_json, value, || {
        let sentence = |found| table::sentence(&sweep, found) + "\n";
        let sentences: String = sweep.crossings.iter().map(sentence).collect();
        sentences + &output::wrote(&files.written)
    })?;
    for file in &removed {
        output::remark(format!(
            "note: {file} was left by an earlier sweep and has been removed"
        ));
    }
    let x = sweep.spec.x.title();
    for panel in &sweep.without_lines {
        output::remark(format!(
            "warning: {}: not shown, because none of {} has both a score and a known {x} within the bins",
            panel.split,
            counted(panel.pairs, "pair")
        ));
    }
    for panel in &sweep.panels {
        for (count, what) in [
            (panel.unplaced, "have an unknown value"),
            (panel.outside, "lie outside all bins"),
        ] {
            if count > 0 {
                let (split, all) = (&panel.split, counted(panel.pairs, "pair"));
                output::remark(format!("note: {split}: {count} of {all} {what} ({x})"));
            }
        }
    }
    let nothing = sweep.panels.is_empty();
    if nothing && sweep.without_lines.is_empty() {
        output::remark(
            "warning: nothing to plot, because the runs have no pairs or none of the selected methods",
        );
    }
    Ok(Outcome::of_problems(
        warn_damaged(&results) || nothing || !sweep.without_lines.is_empty(),
    ))
}

fn crossing_json(sweep: &Sweep, crossing: &FoundCrossing) -> Value {
    let interval = crossing.found.interval;
    json!({
        "dataset": crossing.dataset,
        "method": crossing.method,
        "split": crossing.split,
        "metric": sweep.metrics[crossing.metric].key.to_string(),
        "rule": table::rule(sweep, crossing),
        "x": json_number(crossing.found.x),
        "ci_low": interval.map(|(low, _)| json_number(low)),
        "ci_high": interval.map(|(_, high)| json_number(high)),
        "clusters": crossing.found.clusters,
    })
}
