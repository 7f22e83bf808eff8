//! Explains why a number differs from the published one: computes every reading of the protocol that the kept
//! predictions allow, and its distance from the printed number.
//!
//! * [`cells`]: the readings of a cell and a verdict; [`joint`]: one reading for all metrics of a dataset.
//! * [`text`]: output for a terminal, as Markdown and as CSV.

pub mod cells;
pub mod joint;
#[cfg(test)]
mod tests;
pub mod text;

use std::collections::BTreeMap;
use std::path::PathBuf;

use sharp_datasets::registry::entry;

use crate::evaluate::manifest::DatasetRecord;
use crate::evaluate::readings::{Readings, score_readings};
use crate::evaluate::{Manifest, Results};
use crate::io::observer::Observer;
use crate::report::board::ReportDataset;
use crate::report::paper::{self, PublishedTable, RowError, RowSource};
use crate::scoring::Scoring;

use cells::{CellExplanation, cell};
use joint::{JointReading, joint_readings};

/// Maximum number of readings named per reason for a missing score.
const NAMED: usize = 4;

/// A published row compared with a method's predictions scored under other readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// Cells, sorted by dataset, then in the order of the table's metrics.
    pub cells: Vec<CellExplanation>,
    /// Joint readings, sorted by dataset, then by increasing distance.
    pub joint_readings: Vec<JointReading>,
    /// Readings that were not computed, and why.
    pub absent: Vec<String>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct ExplainedRun {
    pub path: PathBuf,
    pub method: String,
    /// The published row, and the table that it is from.
    published: String,
    /// Number of the run's scores that differ when recomputed from its kept pictures, because
    /// weights or code changed.
    pub changed: usize,
    pub explanation: Explanation,
}

/// Scores a run's kept predictions under every reading, and compares them with the published row labelled `row`.
///
/// # Errors
/// If the run cannot be read, is a bundle (which has no pictures), or has several methods and none is named.
pub fn explain_run(
    table: &PublishedTable,
    row: &str,
    run: &RowSource,
    scoring: &Scoring,
    observer: &dyn Observer,
) -> Result<ExplainedRun, RowError> {
    let path = run.path.clone();
    if path.is_file() {
        let reason = "it is not a run folder (a bundle has no pictures to score again)".to_owned();
        return Err(RowError::Unusable { path, reason });
    }
    let manifest = Results::read(&path)?.manifest;
    let method = run.chosen(manifest.methods.iter().map(|m| m.label.as_str()))?;
    let readings = score_readings(&path, method, scoring, observer)?;
    Ok(ExplainedRun {
        method: method.to_owned(),
        published: format!("{row} in {}", table.name),
        changed: readings.changed,
        explanation: explain(table, row, &readings, &manifest),
        path,
    })
}

impl ExplainedRun {
    /// Whether a reading of a cell covers fewer pairs than the run, or a dataset has no reading at all. Metrics that
    /// were not requested do not count.
    pub fn lacks_pairs(&self) -> bool {
        let cells = &self.explanation.cells;
        let is_read = |dataset: &str| {
            let mut of_dataset = cells.iter().filter(|cell| cell.dataset == dataset);
            of_dataset.any(|cell| !cell.readings.is_empty())
        };
        let lacks = |cell: &CellExplanation| match cell.readings.first() {
            Some(first) => first.n < cell.pairs,
            None => !is_read(&cell.dataset),
        };
        cells.is_empty() || cells.iter().any(lacks)
    }
}

/// Compares the readings of a method's predictions with the published row labelled `row`. Skips datasets that are not
/// in the table, or for which the row has a dash.
fn explain(
    table: &PublishedTable,
    row: &str,
    readings: &Readings,
    manifest: &Manifest,
) -> Explanation {
    let mut cells = Vec::new();
    let mut absent = Vec::new();
    let columns = table.columns();
    for dataset in readings.datasets() {
        let record = manifest
            .datasets
            .iter()
            .find(|record| record.name == dataset);
        let format = record.map_or("", |record| &record.format);
        let Some(column) = paper::column(&ReportDataset::of(dataset, format)) else {
            absent.push(format!("{dataset}: not a dataset of the paper"));
            continue;
        };
        for (metric, shown) in table.metrics.iter().zip(&columns) {
            if let Some(published) = table.number(row, column, metric) {
                let own = manifest.aggregation;
                cells.push(cell(readings, dataset, column, shown, published, own));
            }
        }
        absent.extend(
            record
                .into_iter()
                .flat_map(|record| other_readings(record, column)),
        );
    }
    let mut lacking: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for ((what, reason), n) in &readings.absent {
        let all = *n == readings.records.len();
        let count = if all {
            String::new()
        } else {
            format!(" ({n} pairs)")
        };
        lacking
            .entry(reason)
            .or_default()
            .push(format!("{what}{count}"));
    }
    for (reason, what) in lacking {
        let more = match what.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let named: Vec<String> = what.into_iter().take(NAMED).collect();
        absent.push(format!("{}{more}: {reason}", named.join(", ")));
    }
    absent.push("The paper's own pairs: their list is not published".to_owned());
    if readings
        .records
        .iter()
        .any(|record| record.resized_from.is_some())
    {
        absent.push("Other resize kernels: predictions are kept at the target's size; run again with another `resize`".to_owned());
    }
    Explanation {
        joint_readings: joint_readings(&cells),
        cells,
        absent,
    }
}

/// Alternative settings of a dataset's reader whose scores need a separate run.
fn other_readings(record: &DatasetRecord, column: &str) -> Vec<String> {
    let Ok(entry) = entry(&record.format) else {
        return Vec::new();
    };
    let in_force = |key: &str| record.readings.iter().find(|reading| reading.key == key);
    let mut others = Vec::new();
    for setting in entry.settings {
        let now = in_force(setting.key).map_or(setting.default, |reading| reading.value.as_str());
        let choices = setting.choices.iter().filter(|choice| choice.value != now);
        others.extend(choices.map(|choice| {
            let differs = if choice.proxy {
                "; differs from the paper"
            } else {
                ""
            };
            format!(
                "{column} with `{}={}` ({}{differs}) needs a separate run",
                setting.key, choice.value, choice.meaning
            )
        }));
    }
    others
}
