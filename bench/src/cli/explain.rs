//! `explain`: finds out why a number differs from the published one.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};
use sharp_metrics::Selection;

use super::Outcome;
use super::outcome::UsageError;
use super::output::{self, Terminal};
use crate::config::metrics;
use crate::pictures::keyed_scores::json_number;
use crate::report::explain::text::{terminal, write_explanations};
use crate::report::explain::{ExplainedRun, explain_run};
use crate::report::paper::published::MadeBy;
use crate::report::paper::{TABLES, published};
use crate::scoring::Scoring;

/// Explain why a score differs from the published number
///
/// A published number depends on details that its paper may leave open. Rescores a run's kept predictions under every
/// interpretation (reading) of the evaluation protocol that needs no new prediction. Readings differ in metric
/// variants, masks, conversion to 8 bits (rounded, truncated or none), division of colours by alpha, cropping of
/// borders, the averaging rule, and whether only the first of several scenes of one place counts. Each number of the
/// published row gets a verdict: equal to one reading after rounding, ambiguous (equal to several, which are listed),
/// or inside or outside the range of the readings. Readings that need other pairs or pictures are listed as not
/// computed.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench run --dataset eth3d=data/eth3d --method sharp --keep float --out runs/sharp
  sharp-bench explain quantitative runs/sharp --out why
  sharp-bench explain psnr-ssim runs/flash3d:mine --row Flash3D --metrics all

Writes explain.md and readings.csv, one line per reading. Without --keep float, truncation and division by alpha are not
computed.")]
pub(super) struct ExplainArgs {
    /// Name of a table of scores; `table list` shows the names
    #[arg(value_name = "TABLE")]
    table: String,
    /// Run folders; name the method if a run has several
    #[arg(value_name = "RUN[:METHOD]", required = true)]
    runs: Vec<String>,
    /// The published row to compare with
    #[arg(long, value_name = "LABEL", default_value = "SHARP (ours)")]
    row: String,
    /// Metrics and variants to score, comma-separated
    #[arg(long, value_name = "LIST", default_value = "all,all@frustum")]
    metrics: String,
    /// Weights file of a network that LPIPS or DISTS uses: alexnet=FILE, vgg16=FILE or squeezenet1_1=FILE; repeatable
    #[arg(long, value_name = "NAME=FILE")]
    weights: Vec<String>,
    /// Write explain.md and readings.csv into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &ExplainArgs) -> anyhow::Result<Outcome> {
    let made_by_runs = |made_by| matches!(made_by, MadeBy::Run | MadeBy::PrivilegedRun);
    let Some(table) = published(&args.table).filter(|table| made_by_runs(table.made_by)) else {
        let tables = TABLES.iter().filter(|table| made_by_runs(table.made_by));
        let names: Vec<&str> = tables.map(|table| table.name).collect();
        let reason = format!(
            "no table of scores is named '{}'; available: {}",
            args.table,
            names.join(", ")
        );
        return Err(UsageError(reason).into());
    };
    if !table.rows.iter().any(|(label, _)| *label == args.row) {
        let labels: Vec<&str> = table.rows.iter().map(|(label, _)| *label).collect();
        let reason = format!(
            "--row {}: {} has no row with this name; its rows are {}",
            args.row,
            table.name,
            labels.join(", ")
        );
        return Err(UsageError(reason).into());
    }
    let selection = Selection::parse(&args.metrics)?;
    let scoring = Scoring::new(&selection, &metrics::weights(&args.weights)?)?;
    let mut runs: Vec<ExplainedRun> = Vec::new();
    for run in &args.runs {
        let Ok(run) = run.parse();
        let explained = explain_run(table, &args.row, &run, &scoring, &Terminal::default())?;
        if explained.changed > 0 {
            output::remark(format!(
                "warning: {}: {} of the run's scores differ from those recomputed from the kept \
                 pictures, because weights or code have changed since the run",
                explained.path.display(),
                explained.changed
            ));
        }
        if explained.lacks_pairs() {
            output::remark(format!(
                "warning: {}: the readings exclude pairs whose scored picture was not kept",
                explained.path.display()
            ));
        }
        runs.push(explained);
    }
    let outcome = Outcome::of_problems(runs.iter().any(ExplainedRun::lacks_pairs));
    let written = match &args.out {
        Some(out) => write_explanations(&runs, out)?,
        None => Vec::new(),
    };
    let value = || {
        json!({
            "table": table.name,
            "row": args.row,
            "runs": runs.iter().map(to_json).collect::<Vec<_>>(),
            "files": output::names(&written),
        })
    };
    output::print(args.json, value, || {
        format!(
            "{}\n{}",
            terminal(&runs).trim_end(),
            output::wrote(&written)
        )
    })?;
    Ok(outcome)
}

fn to_json(run: &ExplainedRun) -> Value {
    let ExplainedRun {
        path,
        method,
        explanation,
        ..
    } = run;
    let cells = explanation.cells.iter().map(|cell| {
        let candidates = cell.candidates().into_iter().map(|value| {
            json!({
                "key": value.reading.key,
                "reading": value.reading.words(),
                "value": json_number(value.value),
            })
        });
        json!({
            "dataset": cell.column,
            "metric": cell.metric.label,
            "published": cell.published,
            "here": cell.as_scored.map(json_number),
            "spread": cell.spread().map(|(low, high)| [low, high].map(json_number)),
            "verdict": cell.verdict,
            "candidates": candidates.collect::<Vec<_>>(),
        })
    });
    json!({
        "run": path.display().to_string(),
        "method": method,
        "cells": cells.collect::<Vec<_>>(),
        "readings": explanation.lines(),
        "not_computed": explanation.absent,
    })
}
