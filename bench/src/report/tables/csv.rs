//! CSV with numbers at full precision, and texts that spreadsheets do not evaluate as formulas.

use serde::Serialize;

use super::{Table, letter};
use crate::evaluate::results::number;
use crate::io::text::{csv_bytes, csv_cell};

/// A cell with this text, preceded by a quote if a spreadsheet would evaluate it as a formula.
pub fn text(text: &str) -> String {
    csv_cell(text).into_owned()
}

/// A number as text; empty for `None`.
pub fn optional(value: Option<f64>) -> String {
    value.map(number).unwrap_or_default()
}

/// Writes one row per value, with the fields' names as header. Cells that are not numbers are made safe by
/// [`text`](text()).
///
/// # Errors
/// If a field is neither a number nor a text.
pub fn csv_of<T: Serialize>(rows: impl IntoIterator<Item = T>) -> Result<Vec<u8>, ::csv::Error> {
    let mut plain = ::csv::Writer::from_writer(Vec::new());
    for row in rows {
        plain.serialize(row)?;
    }
    let plain = plain.into_inner().map_err(|error| error.into_error())?;
    if plain.is_empty() {
        return Ok(plain);
    }
    let mut reader = ::csv::Reader::from_reader(&plain[..]);
    let head = reader.headers()?.clone();
    let rows = reader.records().collect::<Result<Vec<_>, _>>()?;
    let cell = |cell: &str| match cell.parse::<f64>() {
        Ok(_) => cell.to_owned(),
        Err(_) => text(cell),
    };
    Ok(csv_bytes(
        &head,
        rows.iter().map(|row| row.iter().map(cell)),
    ))
}

impl Table {
    /// One line per cell. Numbers round-trip; a missing number is an empty cell, and its footnote
    /// gives the reason.
    pub fn csv(&self) -> Vec<u8> {
        const HEAD: &str = "method,dataset,metric,mean,std,n,total,failed,infinite,rank,shown_decimals,footnotes,\
                            footnote_text";
        let count = |n: Option<usize>| n.map(|n| n.to_string()).unwrap_or_default();
        let rows = self.rows.iter().flat_map(|row| {
            self.cells(row).enumerate().map(move |(i, (column, cell))| {
                let group = &self.groups[i / self.columns.len()];
                let notes = group.note.iter().chain(&row.note).chain(&cell.notes);
                let letters: Vec<String> = notes.clone().map(|note| letter(*note)).collect();
                let texts = notes.filter_map(|note| self.notes.get(*note));
                let texts: Vec<&str> = texts.map(String::as_str).collect();
                let mut line = vec![
                    text(&row.label),
                    text(&group.name),
                    column.key.clone(),
                    optional(cell.value),
                    optional(cell.std),
                    count(cell.coverage.map(|c| c.0)),
                    count(cell.coverage.map(|c| c.1)),
                    count(cell.coverage.map(|_| cell.failed)),
                    count(cell.coverage.map(|_| cell.infinite)),
                    count(cell.rank.map(usize::from)),
                    column.decimals.to_string(),
                    letters.join(" "),
                    text(&texts.join(" ")),
                ];
                if let Some(uncertainty) = self.uncertainty {
                    line.push(count(cell.spread.map(|spread| spread.scenes)));
                    line.push(optional(cell.spread.map(|spread| spread.of(uncertainty))));
                }
                line
            })
        });
        let uncertainty = self
            .uncertainty
            .map(|uncertainty| ["scenes", uncertainty.name()]);
        csv_bytes(
            HEAD.split(',').chain(uncertainty.into_iter().flatten()),
            rows,
        )
    }
}
