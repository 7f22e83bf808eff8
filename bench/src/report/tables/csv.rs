//! A table for programs: one line per number, full precision.

use super::{Table, letter};
use crate::evaluate::results::number;
use crate::io::text::csv_cell;

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

impl Table {
    /// Comma-separated values with a header. Numbers round-trip; an absent one is empty, and its footnote says why.
    pub fn csv(&self) -> String {
        let mut writer = ::csv::Writer::from_writer(Vec::new());
        // Writing into memory cannot fail.
        let _ = writer.write_record(COLUMNS);
        for row in &self.rows {
            let columns = self.columns.len();
            for (i, (column, cell)) in self.cells(row).enumerate() {
                let count = |n: Option<usize>| n.map(|n| n.to_string()).unwrap_or_default();
                let group = &self.groups[i / columns];
                let notes = group.note.iter().chain(&row.note).chain(&cell.notes);
                let letters: Vec<String> = notes.clone().map(|note| letter(*note)).collect();
                let texts = notes.filter_map(|note| self.notes.get(*note));
                let texts: Vec<&str> = texts.map(String::as_str).collect();
                let _ = writer.write_record([
                    csv_cell(&row.label).into_owned(),
                    csv_cell(&group.name).into_owned(),
                    column.key.clone(),
                    cell.value.map(number).unwrap_or_default(),
                    cell.std.map(number).unwrap_or_default(),
                    count(cell.coverage.map(|c| c.0)),
                    count(cell.coverage.map(|c| c.1)),
                    count(cell.coverage.map(|_| cell.failed)),
                    count(cell.coverage.map(|_| cell.infinite)),
                    count(cell.rank.map(usize::from)),
                    column.decimals.to_string(),
                    letters.join(" "),
                    csv_cell(&texts.join(" ")).into_owned(),
                ]);
            }
        }
        let bytes = writer.into_inner().unwrap_or_default();
        String::from_utf8_lossy(&bytes).into_owned()
    }
}
