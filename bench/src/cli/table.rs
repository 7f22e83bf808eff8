//! `table`: the paper's tables with your own rows.

use sharp_datasets::error::nearest_of;
use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};
use sharp_metrics::{Backbone, MetricKey, Selection, Weights};

use super::outcome::UsageError;
use super::{Outcome, output};
use crate::io::checkpoint::find_checkpoint;
use crate::report::paper::published::MadeBy;
use crate::report::paper::{
    Beside, OwnRow, PublishedTable, RowError, TABLES, numbers, paper_table, published, write_table,
};
use crate::report::tables::Origin;
use crate::report::tables::grid::{GridCell, TextGrid};

/// Show the SHARP paper's tables with your own rows
///
/// Published rows and yours share a table, separated by a line and ranked separately. A checklist
/// below the table states what still prevents a digit-by-digit comparison.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench table list
  sharp-bench table quantitative
  sharp-bench table quantitative --row mine=runs/first:sharp --row baseline=runs/first:copy \\
      --out tables
  sharp-bench table ablation_gram --row no=runs/without:sharp --row yes=runs/with:sharp --out tables

Writes NAME.md, NAME.csv, NAME.html, NAME.tex for a paper, and NAME-document.tex, which compiles by itself.")]
pub(super) struct TableArgs {
    /// Name of a table (`table list` shows all names), or `list`
    #[arg(value_name = "NAME")]
    name: String,
    /// Your own row: a run folder or bundle; name the method if the run has several; repeatable. `table
    /// list` shows the requirements of every table
    #[arg(long = "row", value_name = "LABEL=RUN[:METHOD]")]
    rows: Vec<String>,
    /// The metric variants to show, at most one per metric [default: the default variants that all rows have]
    #[arg(long, value_name = "LIST")]
    metrics: Option<String>,
    /// Omit datasets for which none of your rows has scores
    #[arg(long, requires = "rows")]
    only_measured: bool,
    /// The datasets to show, by their names in the table [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    datasets: Vec<String>,
    /// Write Markdown, CSV, LaTeX and HTML into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &TableArgs) -> anyhow::Result<Outcome> {
    if args.name == "list" {
        return list(args.json);
    }
    let Some(paper) = published(&args.name) else {
        let names: Vec<&str> = TABLES.iter().map(|table| table.name).collect();
        let reason = format!(
            "no table '{0}'; {1}",
            args.name,
            nearest_of(&args.name, &names)
        );
        return Err(UsageError(reason).into());
    };
    let metrics: Vec<MetricKey> = match &args.metrics {
        Some(list) => Selection::parse(list)?.keys().collect(),
        None => Vec::new(),
    };
    for (at, key) in metrics.iter().enumerate() {
        let family = key.family();
        let is_shown = paper
            .metrics
            .iter()
            .any(|name| name.eq_ignore_ascii_case(family.name()));
        if !is_shown || metrics[..at].iter().any(|before| before.family() == family) {
            let reason = format!(
                "--metrics {key}: the table {} has the columns {}; name at most one variant of each",
                paper.name,
                paper.metrics.join(", ")
            );
            return Err(UsageError(reason).into());
        }
    }
    if args.only_measured && paper.datasets.iter().all(|name| name.is_empty()) {
        let reason = format!("--only-measured: {} has no datasets", paper.name);
        return Err(UsageError(reason).into());
    }
    let rows: Result<Vec<OwnRow>, RowError> = args.rows.iter().map(|row| row.parse()).collect();
    let beside = Beside {
        rows: rows.map_err(|error| UsageError(format!("--row {error}")))?,
        metrics,
        only_measured: args.only_measured,
        datasets: args.datasets.clone(),
    };
    let table = paper_table(paper, &beside)?;
    let too_few = !args.only_measured && table.groups.len() < args.datasets.len();
    if table.groups.is_empty() || too_few {
        let reason = format!(
            "--datasets {}: the table {} has only {}",
            args.datasets.join(","),
            paper.name,
            paper.datasets.join(", ")
        );
        return Err(UsageError(reason).into());
    }
    let mut own = table
        .rows
        .iter()
        .filter(|row| row.origin == Origin::Measured);
    let is_empty =
        !args.rows.is_empty() && own.all(|row| row.cells.iter().all(|cell| cell.value.is_none()));
    if is_empty {
        output::remark(
            "warning: none of your rows has a number for this table's datasets and metrics",
        );
    }
    let outcome = Outcome::of_problems(is_empty);
    let written = match &args.out {
        Some(out) => write_table(paper, &table, out)?,
        None => Vec::new(),
    };
    let value = || {
        let checks = table
            .checklist
            .iter()
            .map(|check| json!({"met": check.is_met, "text": check.text}));
        json!({
            "table": paper.name,
            "label": paper.label,
            "cells": numbers(paper, &table),
            "checklist": checks.collect::<Vec<_>>(),
            "files": output::names(&written),
        })
    };
    output::print(args.json, value, || {
        format!("{}\n{}", table.text().trim_end(), output::wrote(&written))
    })?;
    Ok(outcome)
}

/// The command whose output a table's rows are read from, and what a row must name.
fn made_by(table: &PublishedTable) -> (&'static str, &'static str) {
    match table.made_by {
        MadeBy::Run => ("run", "a run on the table's datasets"),
        MadeBy::PrivilegedRun => (
            "run --method KIND:depth=privileged or --scale-sweep",
            "a run on those of the table's datasets that have depth",
        ),
        MadeBy::Speed => ("speed --out", "the folder that the command wrote"),
        MadeBy::Translation => (
            "analyze translation --out",
            "the folder that the command wrote",
        ),
        MadeBy::Checkpoint => ("a checkpoint", "a .pt or .safetensors file"),
    }
}

/// Which of the things that the table's rows require are on this machine.
fn at_hand(table: &PublishedTable) -> String {
    let weights = Weights::at_hand();
    match table.made_by {
        MadeBy::Checkpoint => find_checkpoint().map_or_else(
            |_| "no checkpoint of the release".to_owned(),
            |path| path.display().to_string(),
        ),
        MadeBy::Speed => "the cpu renderer; for GPUs see `doctor`".to_owned(),
        MadeBy::Run | MadeBy::PrivilegedRun | MadeBy::Translation => {
            let keys = table
                .metrics
                .iter()
                .filter_map(|name| name.to_lowercase().parse().ok());
            let networks = keys.filter_map(|key: MetricKey| Backbone::of(key.metric()));
            let lacking = networks.filter(|network| weights.source(*network).is_none());
            let lacking: BTreeSet<&str> = lacking.map(Backbone::name).collect();
            if lacking.is_empty() {
                "its metrics".to_owned()
            } else {
                format!("not the weights of {}", Vec::from_iter(lacking).join(", "))
            }
        }
    }
}

fn list(as_json: bool) -> anyhow::Result<Outcome> {
    output::print(as_json, list_json, || {
        let rows = TABLES.iter().map(|table| {
            let (made_by, needs) = made_by(table);
            let numbers = table.rows.iter().flat_map(|(_, cells)| cells).flatten();
            let words = [table.name, table.title, made_by, needs];
            let mut row: Vec<GridCell> = words.into_iter().map(GridCell::words).collect();
            row.insert(2, GridCell::count(numbers.count()));
            row.push(GridCell::words(at_hand(table)));
            row
        });
        let heads = [
            "name",
            "shows",
            "numbers",
            "rows of yours by",
            "needs",
            "available",
        ];
        let title = "Tables of the SHARP paper, with all of their numbers";
        TextGrid::new(title, &heads, rows).text()
    })?;
    Ok(Outcome::Done)
}

fn list_json() -> Value {
    let tables = TABLES.iter().map(|table| {
        let (made_by, needs) = made_by(table);
        let datasets = table.datasets.iter().filter(|name| !name.is_empty());
        let rows = table.rows.iter().map(|(label, _)| *label);
        json!({
            "name": table.name,
            "label": table.label,
            "title": table.title,
            "datasets": datasets.collect::<Vec<_>>(),
            "metrics": table.metrics,
            "published_rows": rows.collect::<Vec<_>>(),
            "made_by": made_by,
            "needs": needs,
            "at_hand": at_hand(table),
        })
    });
    tables.collect()
}
