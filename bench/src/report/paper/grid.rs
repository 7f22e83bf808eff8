//! Published rows and the user's own rows in one table.

use serde::Serialize;
use sharp_metrics::MetricKey;

use crate::report::board::{Board, DatasetBoard, ReportDataset};
use crate::report::column::Column;
use crate::report::statistics::of_metric;
use crate::report::tables::{Cell, Group, Origin, Row, Table, build};

use super::checklist::{ChecklistInput, checklist};
use super::column;
use super::published::PublishedTable;
use super::rows::{OwnRow, OwnRows, RowError};

/// The user's rows for a table of the paper, and the columns to show.
#[derive(Debug, Clone, Default)]
pub struct Beside {
    pub rows: Vec<OwnRow>,
    /// The variants to show, at most one per metric. Other metrics are shown in their default variant if all rows have
    /// it, otherwise in the first variant that all rows have.
    pub metrics: Vec<MetricKey>,
    /// Whether to omit datasets for which the user has no number.
    pub only_measured: bool,
    /// The datasets to show, by name in any case; empty for all.
    pub datasets: Vec<String>,
}

impl Beside {
    fn shows(&self, dataset: &str) -> bool {
        let mut listed = self.datasets.iter();
        self.datasets.is_empty() || listed.any(|name| name.eq_ignore_ascii_case(dataset))
    }
}

/// A table of the paper with the user's rows below the published ones. Published and own rows are ranked separately.
///
/// # Errors
/// If a row cannot be read, two rows contradict each other, or two datasets belong to one column of the paper.
pub fn paper_table(paper: &PublishedTable, beside: &Beside) -> Result<Table, RowError> {
    if beside.rows.is_empty() {
        let all = 0..paper.datasets.len();
        let shown: Vec<usize> = all.filter(|d| beside.shows(paper.datasets[*d])).collect();
        return Ok(paper.table(&shown));
    }
    with_rows(paper, OwnRows::read(paper, &beside.rows)?, beside)
}

/// Like [`paper_table`], with rows that have already been read.
pub(super) fn with_rows(
    paper: &PublishedTable,
    rows: OwnRows,
    beside: &Beside,
) -> Result<Table, RowError> {
    let listed = (0..paper.datasets.len()).filter(|d| beside.shows(paper.datasets[*d]));
    match rows {
        OwnRows::Scores(results) => {
            let board = Board::of(&results)?;
            let columns = columns(paper, &board, &beside.metrics);
            let mut shown = placed(paper, board)?;
            let is_kept = |d: &DatasetBoard<'_>| !beside.only_measured || !d.pairs.is_empty();
            let kept = listed.filter(|d| is_kept(&shown.datasets[*d]));
            let kept: Vec<usize> = kept.collect();
            let mut names = paper.datasets.iter();
            shown.datasets.retain(|dataset| {
                let name = names
                    .next()
                    .map_or(dataset.dataset.name.as_str(), |name| *name);
                is_kept(dataset) && beside.shows(name)
            });
            let mut own = build::table(&shown, &columns, paper.name, paper.title, of_metric);
            let compared = ChecklistInput {
                paper,
                manifest: &results.manifest,
                missing: results.missing.len(),
                board: &shown,
                columns: &columns,
            };
            own.checklist = checklist(&compared);
            let doubts = shown.methods.iter();
            let doubts =
                doubts.filter_map(|m| Some(format!("{}: {}.", m.label, m.doubt.as_ref()?)));
            own.remarks.extend(doubts);
            Ok(below(paper.table(&kept), own))
        }
        OwnRows::Measured {
            datasets,
            columns,
            rows,
        } => {
            let width = columns.len();
            let others = (paper.datasets.len()..).zip(&datasets);
            let others: Vec<(usize, &String)> =
                others.filter(|(_, name)| beside.shows(name)).collect();
            let of = |row: &Row, d: usize| row.cells[d * width..(d + 1) * width].to_vec();
            let has = |row: &Row, d: usize| of(row, d).iter().any(|cell| cell.value.is_some());
            let kept = |d: &usize| !beside.only_measured || rows.iter().any(|row| has(row, *d));
            let kept: Vec<usize> = listed.filter(kept).collect();
            let shown = || kept.iter().chain(others.iter().map(|(d, _)| d));
            let narrowed = rows.iter().map(|row| Row {
                cells: shown().flat_map(|d| of(row, *d)).collect(),
                ..row.clone()
            });
            let published = paper.table(&kept);
            let mut own = Table {
                rows: narrowed.collect(),
                remarks: Vec::new(),
                ..published.clone()
            };
            let decimals: Vec<usize> = own.columns.iter().map(|column| column.decimals).collect();
            own.columns = columns;
            let others = others.iter().map(|(_, name)| Group::titled(name));
            own.groups.extend(others);
            for (column, decimals) in own.columns.iter_mut().zip(decimals) {
                column.decimals = decimals;
            }
            Ok(below(published, own))
        }
    }
}

/// Puts the user's rows below the published ones. Columns state the metric variants of the user's rows; datasets that
/// are not in the paper's table come last.
fn below(mut published: Table, own: Table) -> Table {
    let mut table = own;
    let none = Cell::dash();
    let cells = table.groups.len() * table.columns.len();
    for row in &mut published.rows {
        row.cells.resize(cells, none.clone());
    }
    let groups = table.groups.iter_mut().zip(published.groups);
    for (group, published) in groups {
        (group.name, group.title) = (published.name, published.title);
    }
    table.row_head = published.row_head;
    let mut rows = published.rows;
    rows.append(&mut table.rows);
    table.rows = rows;
    let caveats = published
        .remarks
        .into_iter()
        .map(|caveat| format!("† {caveat}"));
    for row in table
        .rows
        .iter_mut()
        .filter(|row| row.origin == Origin::Measured)
    {
        for (at, cell) in row.cells.iter_mut().enumerate() {
            if table.groups[at / table.columns.len()].pairs == Some(0) {
                *cell = none.clone();
            }
        }
    }
    for group in table
        .groups
        .iter_mut()
        .filter(|group| group.pairs == Some(0))
    {
        group.pairs = None;
    }
    table.keep_used_notes();
    table.remarks = caveats.chain(table.remarks).collect();
    table
}

/// For each of the paper's metrics, the variant to show in its column.
fn columns(paper: &PublishedTable, board: &Board<'_>, wanted: &[MetricKey]) -> Vec<Column> {
    let scored = &board.metrics;
    let methods = 0..board.methods.len();
    let has = |column: &Column, method: usize| {
        let mut records = board.datasets.iter().flat_map(|d| d.records_of(method));
        records.any(|r| {
            r.scores
                .get(&column.key)
                .is_some_and(|score| score.value().is_some())
        })
    };
    let columns = paper.columns().into_iter().zip(&paper.metrics);
    let columns = columns.map(|(published, name)| {
        let is_family = |key: &MetricKey| key.family().name().eq_ignore_ascii_case(name);
        let named = wanted.iter().find(|key| is_family(key));
        let by_name: Option<MetricKey> = name.to_lowercase().parse().ok();
        let candidates = scored.iter().filter(|column| {
            column.family().eq_ignore_ascii_case(name) && !column.key.contains('@')
        });
        let default = by_name.map(|key| key.to_string());
        let mut candidates: Vec<&Column> = candidates.collect();
        candidates.sort_by_key(|column| Some(&column.key) != default.as_ref());
        let common = candidates
            .iter()
            .find(|column| methods.clone().all(|m| has(column, m)));
        let found = match named {
            Some(key) => scored
                .iter()
                .find(|column| column.key == key.to_string())
                .cloned()
                .or(Some((*key).into())),
            None => common
                .or(candidates.first())
                .map(|column| (*column).clone()),
        };
        let column = found
            .or(by_name.map(Column::from))
            .unwrap_or_else(|| published.clone());
        Column {
            decimals: published.decimals,
            ..column
        }
    });
    columns.collect()
}

/// The user's datasets in the order of the paper's, followed by datasets that are not in the paper's table. A dataset
/// of the paper is empty if no row has it.
fn placed<'a>(paper: &PublishedTable, mut board: Board<'a>) -> Result<Board<'a>, RowError> {
    let mut by_column: Vec<Vec<DatasetBoard<'a>>> =
        paper.datasets.iter().map(|_| Vec::new()).collect();
    let mut others = Vec::new();
    for dataset in board.datasets.drain(..) {
        let at = column(&dataset.dataset)
            .and_then(|column| paper.datasets.iter().position(|name| *name == column));
        match at {
            Some(at) => by_column[at].push(dataset),
            None => others.push(dataset),
        }
    }
    let mut datasets = Vec::new();
    for (&column, mut found) in paper.datasets.iter().zip(by_column) {
        if found.len() > 1 {
            return Err(RowError::Ambiguous {
                column,
                names: found
                    .iter()
                    .map(|d| format!("'{}'", d.dataset.name))
                    .collect(),
            });
        }
        datasets.push(found.pop().unwrap_or_else(|| DatasetBoard {
            dataset: ReportDataset::of(column, ""),
            pairs: Vec::new(),
        }));
    }
    datasets.append(&mut others);
    Ok(Board { datasets, ..board })
}

/// A cell with its row, dataset and metric, as written to a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Number<'a> {
    pub row: &'a str,
    pub origin: &'static str,
    pub dataset: &'a str,
    /// The key of the metric; `[unstated]` for published numbers.
    pub metric: String,
    #[serde(with = "optional")]
    pub value: Option<f64>,
    pub n: Option<usize>,
    pub total: Option<usize>,
    pub rank: Option<u8>,
}

/// Every cell of a table, row by row.
pub fn numbers<'a>(paper: &PublishedTable, table: &'a Table) -> Vec<Number<'a>> {
    let unstated = paper.columns();
    let mut numbers = Vec::new();
    for row in &table.rows {
        for (at, cell) in row.cells.iter().enumerate() {
            let m = at % table.columns.len();
            let dataset = table.groups[at / table.columns.len()].name.as_str();
            if row.origin == Origin::Published && !paper.datasets.contains(&dataset) {
                continue;
            }
            let column = match row.origin {
                Origin::Measured => &table.columns[m],
                Origin::Published => &unstated[m],
            };
            numbers.push(Number {
                row: &row.label,
                origin: row.origin.name(),
                dataset,
                metric: column.key.clone(),
                value: cell.value,
                n: cell.coverage.map(|c| c.0),
                total: cell.coverage.map(|c| c.1),
                rank: cell.rank,
            });
        }
    }
    numbers
}

/// Serialises an optional number; infinities as text.
mod optional {
    use serde::Serializer;

    use crate::evaluate::record::finite_or_text;

    #[expect(clippy::ref_option, reason = "serde hands fields by reference")]
    pub(super) fn serialize<S: Serializer>(value: &Option<f64>, s: S) -> Result<S::Ok, S::Error> {
        match value {
            Some(value) => finite_or_text::serialize(value, s),
            None => s.serialize_none(),
        }
    }
}
