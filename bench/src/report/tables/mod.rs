//! Tables in the paper's form: methods as rows, datasets as column groups, and metrics as the
//! columns of each group.
//!
//! * [`rank`]: best, second and third of a column; [`build`]: tables from a
//!   [`Board`](super::board::Board).
//! * [`csv`], [`html`], [`latex`], [`markdown`], [`text`]: writers.
//! * [`grid`]: a table of any other shape.
//! * `footnotes`: notes on a cell or a column; `remarks`: notes on a whole table.
//!
//! Every cell states how many pairs it covers. If a cell has no number, a footnote gives the
//! reason.

pub mod build;
pub mod csv;
mod footnotes;
pub mod grid;
pub mod html;
pub mod latex;
pub mod markdown;
pub mod rank;
pub(super) mod remarks;
pub mod text;

pub use sharp_plots::scale::shown;

use super::column::Column;
use super::statistics::{Spread, Uncertainty};
use crate::io::text::visible_line;

/// A table that can be written in any format.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Stem of file names.
    pub name: String,
    /// Caption.
    pub title: String,
    /// Heading above the rows' labels.
    pub row_head: &'static str,
    pub groups: Vec<Group>,
    /// Columns within each group.
    pub columns: Vec<Column>,
    pub rows: Vec<Row>,
    /// Sentences about the whole table, shown below it.
    pub remarks: Vec<String>,
    /// Footnotes; groups, rows and cells refer to them by index.
    pub notes: Vec<String>,
    /// Conditions for comparing the measured rows with the published ones.
    pub checklist: Vec<Condition>,
    /// Uncertainty shown as ± after a mean.
    pub uncertainty: Option<Uncertainty>,
}

/// A condition for comparing measured and published numbers digit by digit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Condition {
    pub is_met: bool,
    /// One or two sentences.
    pub text: String,
}

/// Origin of a row's numbers. Rows of different origins are never ranked together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Origin {
    /// Computed by this harness.
    #[default]
    Measured,
    /// Printed in the SHARP paper.
    Published,
}

impl Origin {
    /// The name: `measured` or `published`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Published => "published",
        }
    }
}

/// A dataset as the heading of its columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    /// Name as in the records.
    pub name: String,
    /// Display name.
    pub title: String,
    /// Number of pairs of the dataset; `None` if the source of the numbers does not state it.
    pub pairs: Option<usize>,
    /// Footnote on the columns of the group.
    pub note: Option<usize>,
}

/// A method and its cells, group by group.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub label: String,
    pub origin: Origin,
    pub note: Option<usize>,
    /// `groups.len() * columns.len()` cells; the cell of group g and column c is at `g * columns.len() + c`.
    pub cells: Vec<Cell>,
}

/// One number with its coverage and notes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cell {
    /// Value at full precision; `None` if there is no number. A footnote then gives the reason.
    pub value: Option<f64>,
    /// Text as printed in the source, for numbers that were not computed here; shown unchanged.
    pub printed: Option<String>,
    /// Rank 1, 2 or 3, based on the displayed numbers.
    pub rank: Option<u8>,
    /// Number of pairs with a score, and of pairs in the dataset; `None` if the source does not state them.
    pub coverage: Option<(usize, usize)>,
    /// Sample standard deviation over the pairs.
    pub std: Option<f64>,
    /// Spread of the mean over scenes.
    pub spread: Option<Spread>,
    pub infinite: usize,
    pub failed: usize,
    /// Indices of footnotes.
    pub notes: Vec<usize>,
}

impl Cell {
    /// A measured number.
    pub(crate) fn of(value: Option<f64>) -> Self {
        Self {
            value,
            ..Self::default()
        }
    }

    /// A cell that displays `text` instead of the formatted value.
    pub(crate) fn printed(value: Option<f64>, text: impl Into<String>) -> Self {
        Self {
            printed: Some(text.into()),
            ..Self::of(value)
        }
    }

    /// A cell without a number, displayed as a dash.
    pub(crate) fn dash() -> Self {
        Self::printed(None, "–")
    }

    /// The number as displayed, or `n/a`.
    fn text(&self, column: &Column) -> String {
        let value = || self.value.map(|value| shown(value, column.decimals));
        let text = self.printed.clone().or_else(value);
        text.unwrap_or_else(|| "n/a".to_owned())
    }

    /// The coverage (pairs with a score, pairs in the dataset) if it is incomplete; otherwise `None`.
    fn partial(&self) -> Option<(usize, usize)> {
        self.coverage.filter(|(n, total)| n != total && *n > 0)
    }
}

impl Row {
    pub(crate) fn measured(label: impl Into<String>, cells: Vec<Cell>) -> Self {
        Self {
            label: label.into(),
            origin: Origin::Measured,
            note: None,
            cells,
        }
    }
}

impl Group {
    /// A column group that is not a dataset of the run.
    pub(crate) fn titled(title: &str) -> Self {
        Self {
            name: title.to_owned(),
            title: title.to_owned(),
            pairs: None,
            note: None,
        }
    }
}

impl Table {
    /// A table without footnotes and remarks.
    pub(crate) fn new(
        name: impl Into<String>,
        title: impl Into<String>,
        groups: Vec<Group>,
        columns: Vec<Column>,
        rows: Vec<Row>,
    ) -> Self {
        Self {
            name: name.into(),
            title: title.into(),
            row_head: "method",
            groups,
            columns,
            rows,
            remarks: Vec::new(),
            notes: Vec::new(),
            checklist: Vec::new(),
            uncertainty: None,
        }
    }

    fn cells<'a>(&'a self, row: &'a Row) -> impl Iterator<Item = (&'a Column, &'a Cell)> {
        self.columns.iter().cycle().zip(&row.cells)
    }

    /// A copy whose means are shown with this uncertainty.
    pub(super) fn with_uncertainty(&self, uncertainty: Option<Uncertainty>) -> Self {
        let mut table = Self {
            uncertainty,
            ..self.clone()
        };
        let mut cells = self.rows.iter().flat_map(|row| &row.cells);
        if let Some(uncertainty) = uncertainty.filter(|_| cells.any(|cell| cell.spread.is_some())) {
            table.remarks.insert(0, uncertainty.sentence().to_owned());
        }
        table
    }

    /// The uncertainty of a cell as displayed, with its ± sign; empty if there is none.
    fn plus_minus(&self, column: &Column, cell: &Cell) -> String {
        let found = self.uncertainty.zip(cell.spread);
        found.map_or_else(String::new, |(uncertainty, spread)| {
            format!("± {}", shown(spread.of(uncertainty), column.decimals))
        })
    }

    /// The number as displayed, followed by its uncertainty; `n/a` if there is no number.
    fn number(&self, column: &Column, cell: &Cell) -> String {
        let text = format!("{} {}", cell.text(column), self.plus_minus(column, cell));
        text.trim_end().to_owned()
    }

    /// Whether the table has both measured and published rows.
    pub(super) fn is_mixed(&self) -> bool {
        self.rows
            .iter()
            .any(|row| row.origin != self.rows[0].origin)
    }

    /// Whether a rule separates row number `at` from the row above, because their origins differ.
    pub(super) fn has_rule_before(&self, at: &usize) -> bool {
        let before = at.checked_sub(1).and_then(|before| self.rows.get(before));
        before.is_some_and(|before| before.origin != self.rows[*at].origin)
    }

    /// The label of a row. A dagger marks published rows if the table also has measured ones.
    pub(super) fn label(&self, row: &Row) -> String {
        let dagger = row.origin == Origin::Published && self.is_mixed();
        let label = visible_line(&row.label);
        format!("{label}{}", if dagger { "†" } else { "" })
    }

    pub(super) fn is_ranked(&self) -> bool {
        let mut cells = self.rows.iter().flat_map(|row| &row.cells);
        cells.any(|cell| cell.rank.is_some())
    }

    /// Index of the footnote `text` in `notes`. Adds the footnote if it is new.
    pub(crate) fn note(notes: &mut Vec<String>, text: String) -> usize {
        notes.iter().position(|n| *n == text).unwrap_or_else(|| {
            notes.push(text);
            notes.len() - 1
        })
    }

    /// Removes unused footnotes, and renumbers the others by first use.
    pub(super) fn keep_used_notes(&mut self) {
        let mut kept = Vec::new();
        let old = std::mem::take(&mut self.notes);
        let mut keep = |note: &mut usize| {
            if let Some(text) = old.get(*note) {
                *note = Self::note(&mut kept, text.clone());
            }
        };
        let groups = self.groups.iter_mut();
        groups.flat_map(|group| &mut group.note).for_each(&mut keep);
        for row in &mut self.rows {
            row.note.iter_mut().for_each(&mut keep);
            for cell in &mut row.cells {
                cell.notes.iter_mut().for_each(&mut keep);
            }
        }
        self.notes = kept;
    }
}

/// Letters of a footnote: a, b, …, z, aa, ab, ….
pub fn letter(note: usize) -> String {
    let last = char::from(b'a' + (note % 26) as u8);
    if note < 26 {
        last.into()
    } else {
        format!("{}{last}", letter(note / 26 - 1))
    }
}

/// Letters of footnotes between two marks; empty without footnotes.
fn letters(before: &str, notes: &[usize], after: &str) -> String {
    if notes.is_empty() {
        return String::new();
    }
    let letters: Vec<String> = notes.iter().map(|note| letter(*note)).collect();
    format!("{before}{}{after}", letters.join(","))
}

/// Splits a note into code between backticks and other text: `(is_code, text)`. If the number of backticks is odd, they
/// are plain characters.
fn spans(note: &str) -> Vec<(bool, &str)> {
    if note.matches('`').count() % 2 == 1 {
        return vec![(false, note)];
    }
    let parts = note.split('`').enumerate();
    parts.map(|(i, part)| (i % 2 == 1, part)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn footnotes_count_like_a_spreadsheet() {
        let letters: Vec<_> = [0, 25, 26, 51, 52, 701, 702].map(letter).into();
        assert_eq!(letters, ["a", "z", "aa", "az", "ba", "zz", "aaa"]);
    }
}
