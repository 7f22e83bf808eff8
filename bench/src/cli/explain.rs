//! `explain`: why a number differs from the published one.

use std::path::PathBuf;

use anyhow::{bail, ensure};
use clap::Args;
use serde_json::json;
use sharp_metrics::Selection;

use super::outcome::UsageError;
use super::output::{self, Terminal};
use super::{Outcome, data_args};
use crate::evaluate::Results;
use crate::evaluate::readings::score_readings;
use crate::io::atomic_files::write_over_own;
use crate::io::text::visible;
use crate::report::explain::explain;
use crate::report::explain::text::ReadingLine;
use crate::report::paper::published::MadeBy;
use crate::report::paper::{OwnRow, TABLES, published};
use crate::scoring::Scoring;

/// Why a number differs from the published one
///
/// Scores the kept predictions of a run under every reading of the protocol that needs no other prediction: variants of the
/// metrics, masks, 8 bit by rounding or truncation or not at all, colour divided by alpha, cropped borders, what the mean is
/// over, one scene a place. Each cell of the paper's row gets a verdict: equal to rounding, ambiguous with the candidates,
/// inside the protocol's spread, or outside. What needs other pairs or pictures is listed as not computed.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench run --dataset eth3d=data/eth3d --method sharp --keep float --out runs/sharp
  sharp-bench explain quantitative runs/sharp --out why
  sharp-bench explain psnr-ssim runs/flash3d:mine --row Flash3D --metrics all

Writes explain.md and readings.csv, a line a reading. Without --keep float, truncation and division by alpha are not computed.")]
pub(super) struct ExplainArgs {
    /// A table of scores by its name in `table list`
    #[arg(value_name = "TABLE")]
    table: String,
    /// Run folders, each with its method where it has several
    #[arg(value_name = "RUN[:METHOD]", required = true)]
    runs: Vec<String>,
    /// The published row to compare with
    #[arg(long, value_name = "LABEL", default_value = "SHARP (ours)")]
    row: String,
    /// Variants of the metrics to try
    #[arg(long, value_name = "LIST", default_value = "all,all@frustum")]
    metrics: String,
    /// A backbone's weights file: alexnet=FILE, vgg16=FILE or squeezenet1_1=FILE; repeatable
    #[arg(long, value_name = "NAME=FILE")]
    weights: Vec<String>,
    /// Write explain.md and readings.csv into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Stands in what was written before.
const MARK: &str = "<!-- sharp-bench explain -->";

pub(super) fn execute(args: &ExplainArgs) -> anyhow::Result<Outcome> {
    let made_by_runs = |made_by| matches!(made_by, MadeBy::Run | MadeBy::PrivilegedRun);
    let Some(table) = published(&args.table).filter(|table| made_by_runs(table.made_by)) else {
        let tables = TABLES.iter().filter(|table| made_by_runs(table.made_by));
        let names: Vec<&str> = tables.map(|table| table.name).collect();
        let reason = format!(
            "no table of scores '{}'; there are {}",
            args.table,
            names.join(", ")
        );
        return Err(UsageError(reason).into());
    };
    if !table.rows.iter().any(|(label, _)| *label == args.row) {
        let labels: Vec<&str> = table.rows.iter().map(|(label, _)| *label).collect();
        let reason = format!(
            "--row {}: {} has the rows {}",
            args.row,
            table.name,
            labels.join(", ")
        );
        return Err(UsageError(reason).into());
    }
    let selection = Selection::parse(&args.metrics)?;
    let scoring = Scoring::new(&selection, &data_args::weights(&args.weights)?)?;
    let terminal = Terminal::default();
    let (mut text, mut markdown, mut found) = (String::new(), String::new(), Vec::new());
    let mut readings_csv: Vec<u8> = Vec::new();
    for run in &args.runs {
        let OwnRow { path, method, .. } = format!("run={run}").parse()?;
        ensure!(
            path.is_dir(),
            "{}: no run folder; a bundle has no pictures to read again",
            path.display()
        );
        let results = Results::read(&path)?;
        let labels: Vec<&str> = results
            .manifest
            .methods
            .iter()
            .map(|m| m.label.as_str())
            .collect();
        let method = match (method, labels.as_slice()) {
            (Some(method), _) if labels.contains(&method.as_str()) => method,
            (None, [only]) => (*only).to_owned(),
            _ => bail!(
                "{run}: it has the methods {}; say {}:METHOD",
                labels.join(", "),
                path.display()
            ),
        };
        let readings = score_readings(&path, &method, &scoring, &terminal)?;
        if readings.changed > 0 {
            output::remark(format!(
                "warning: {}: {} of the run's scores are not what its pictures give today: weights or code have changed since",
                path.display(),
                readings.changed
            ));
        }
        let explanation = explain(table, &args.row, &readings, &results.manifest);
        let title = format!(
            "{} ({}) and {method} of {}",
            args.row,
            table.name,
            path.display()
        );
        text += &format!("{title}\n\n");
        markdown += &format!("# {}\n\n", crate::report::tables::markdown::escape(&title));
        text += &format!("{}\n", explanation.text());
        markdown += &format!("{}\n", explanation.markdown());
        let csv = explanation.csv()?;
        let rows = csv
            .iter()
            .position(|byte| *byte == b'\n')
            .map_or(0, |at| at + 1);
        readings_csv.extend_from_slice(if readings_csv.is_empty() {
            &csv
        } else {
            &csv[rows..]
        });
        found.push((path, method, explanation));
    }
    let mut written = Vec::new();
    if let Some(out) = &args.out {
        let page = format!("{MARK}\n\n{markdown}");
        for (name, bytes, mark) in [
            ("explain.md", page.as_bytes(), MARK),
            ("readings.csv", &readings_csv, "dataset,metric,key,picture"),
        ] {
            let path = out.join(name);
            let text = String::from_utf8_lossy(bytes);
            write_over_own(&path, visible(&text).as_bytes(), mark)?;
            written.push(path);
        }
    }
    if args.json {
        let runs = found.iter().map(|(path, method, explanation)| {
            let cells = explanation.cells.iter().map(|cell| {
                let candidates = cell.candidates();
                json!({
                    "dataset": cell.column,
                    "metric": cell.metric.label,
                    "published": cell.published,
                    "here": cell.as_scored,
                    "spread": cell.spread().map(|(low, high)| [low, high]),
                    "verdict": cell.verdict,
                    "candidates": candidates.iter().map(|value| json!({
                        "key": value.reading.key,
                        "reading": value.reading.words(),
                        "value": value.value,
                    })).collect::<Vec<_>>(),
                })
            });
            let readings: Vec<ReadingLine<'_>> = explanation.lines();
            json!({
                "run": path.display().to_string(),
                "method": method,
                "cells": cells.collect::<Vec<_>>(),
                "readings": readings,
                "not_computed": explanation.absent,
            })
        });
        output::json(&json!({
            "table": table.name,
            "row": args.row,
            "runs": runs.collect::<Vec<_>>(),
            "files": written.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        }))?;
        return Ok(Outcome::Done);
    }
    output::line(text.trim_end())?;
    for path in &written {
        output::line(format!("wrote {}", path.display()))?;
    }
    Ok(Outcome::Done)
}
