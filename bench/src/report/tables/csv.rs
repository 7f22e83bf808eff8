//! A table for programs: one line per number, full precision.

use super::{Table, letter};
use crate::evaluate::record::finite_or_text;

/// Columns of [`csv()`].
pub const COLUMNS: [&str; 13] = [
    "method",
    "dataset",
    "metric",
    "mean",
    "std",
    "n",
    "total",
    "failed",
    "infinite",
    "rank",
    "shown_decimals",
    "footnotes",
    "footnote_text",
];

/// Comma-separated values with a header. Numbers round-trip; an absent one is empty, and its footnote says why.
pub fn csv(table: &Table) -> String {
    let mut writer = ::csv::Writer::from_writer(Vec::new());
    // Writing into memory cannot fail.
    let _ = writer.write_record(COLUMNS);
    for row in &table.rows {
        for (i, cell) in row.cells.iter().enumerate() {
            let count = |n: Option<usize>| n.map(|n| n.to_string()).unwrap_or_default();
            let group = table.group_of(i);
            let notes = group.note.iter().chain(&row.note).chain(&cell.notes);
            let notes: Vec<usize> = notes.copied().collect();
            let letters: Vec<String> = notes.iter().map(|i| letter(*i)).collect();
            let texts: Vec<&str> = notes
                .iter()
                .filter_map(|i| table.notes.get(*i))
                .map(String::as_str)
                .collect();
            let metric = table.metric_of(i);
            let _ = writer.write_record([
                row.label.clone(),
                group.title.clone(),
                metric.key.clone(),
                number(cell.value),
                number(cell.std),
                count(cell.coverage.map(|c| c.0)),
                count(cell.coverage.map(|c| c.1)),
                count(cell.coverage.map(|_| cell.failed)),
                count(cell.coverage.map(|_| cell.infinite)),
                count(cell.rank.map(usize::from)),
                metric.decimals.to_string(),
                letters.join(" "),
                texts.join(" "),
            ]);
        }
    }
    writer
        .into_inner()
        .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
        .unwrap_or_default()
}

/// Shortest text that reads back as the same number.
fn number(value: Option<f64>) -> String {
    match value {
        None => String::new(),
        Some(v) => finite_or_text::text(v).map_or_else(|| format!("{v}"), str::to_owned),
    }
}
