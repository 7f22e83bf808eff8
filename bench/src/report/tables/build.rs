//! Builds tables from a board.

use crate::report::board::{Board, DatasetBoard};
use crate::report::column::Column;
use crate::report::statistics::{CellStatistics, of_extra, of_metric};

use super::footnotes::{cell_notes, feature_mark, prediction_marks, proxy_mark};
use super::rank::{RankedValue, ranks};
use super::{Cell, Group, Row, Table, remarks};

/// Name of the table of values that methods report.
pub const REPORTED: &str = "reported";

/// Maximum number of value columns in a table, as in the paper's tables.
const MAX_COLUMNS: usize = 12;

/// Tables of a board's scores; empty if there are no metrics. If all scores fit into twelve columns, there is a single
/// table named `scores`. Otherwise, as in the paper, perceptual metrics (DISTS, LPIPS) and pixelwise metrics are in
/// separate tables, several of each kind if needed.
pub fn of_scores(board: &Board<'_>, metrics: &[Column]) -> Vec<Table> {
    if metrics.is_empty() {
        return Vec::new();
    }
    let width = (MAX_COLUMNS / board.datasets.len().max(1)).max(1);
    if metrics.len() <= width {
        return vec![table(board, metrics, "scores", "Scores", of_metric)];
    }
    let is_perceptual = |m: &Column| matches!(m.family(), "lpips" | "dists");
    let (perceptual, pixelwise): (Vec<Column>, Vec<Column>) =
        metrics.iter().cloned().partition(is_perceptual);
    let mut tables = Vec::new();
    for (family, title, members) in [
        ("perceptual", "Perceptual metrics", perceptual),
        ("pixelwise", "Pixelwise metrics", pixelwise),
    ] {
        for (i, part) in members.chunks(width).enumerate() {
            let (mut name, mut title) = (format!("scores-{family}"), title.to_owned());
            if i > 0 {
                name += &format!("-{}", i + 1);
                title += &format!(" ({})", i + 1);
            }
            tables.push(table(board, part, &name, &title, of_metric));
        }
    }
    tables
}

/// Whether a method reports the quantity `extra` for at least one prediction.
fn reports(board: &Board<'_>, method: usize, extra: &Column) -> bool {
    let mut records = board.datasets.iter().flat_map(|d| d.records_of(method));
    records.any(|record| record.reported().contains_key(extra.key.as_str()))
}

/// The quantities that at least one method reports about its predictions.
pub fn extras(board: &Board<'_>) -> Vec<Column> {
    let mut extras = Column::extras();
    extras.retain(|extra| (0..board.methods.len()).any(|method| reports(board, method, extra)));
    extras
}

/// Table of the values that methods report about their predictions, without ranks; `None` if `extras` is empty.
pub fn of_extras(board: &Board<'_>, extras: &[Column]) -> Option<Table> {
    if extras.is_empty() {
        return None;
    }
    let title = "What the methods report about their predictions";
    let mut all = table(board, extras, REPORTED, title, of_extra);
    let mut position = 0..;
    all.rows.retain(|_| {
        let method = position.next().unwrap_or_default();
        extras.iter().any(|extra| reports(board, method, extra))
    });
    for row in &mut all.rows {
        row.note = None;
    }
    all.keep_used_notes();
    Some(all)
}

pub(in crate::report) fn table(
    board: &Board<'_>,
    columns: &[Column],
    name: &str,
    title: &str,
    statistics: fn(&DatasetBoard<'_>, usize, &str) -> CellStatistics,
) -> Table {
    let mut notes = Vec::new();
    let groups = board.datasets.iter().map(|d| Group {
        name: d.dataset.name.clone(),
        title: d.dataset.title().to_owned(),
        pairs: Some(d.pairs.len()),
        note: proxy_mark(&d.dataset).map(|text| Table::note(&mut notes, text)),
    });
    let groups = groups.collect();
    let rows = board.methods.iter().map(|method| Row {
        note: method.unranked.as_ref().map(|reason| {
            let text = format!("{}: shown without a rank, because {reason}.", method.label);
            Table::note(&mut notes, text)
        }),
        ..Row::measured(&method.label, Vec::new())
    });
    let mut rows: Vec<Row> = rows.collect();
    for dataset in &board.datasets {
        for column in columns {
            let cells: Vec<CellStatistics> = (0..rows.len())
                .map(|method| statistics(dataset, method, &column.key))
                .collect();
            let candidates = cells.iter().zip(&board.methods);
            let candidates = candidates.map(|(cell, method)| RankedValue {
                value: cell.mean,
                covers: &cell.scored,
                complete: cell.n == cell.total,
                ranked: method.unranked.is_none(),
            });
            let candidates: Vec<RankedValue<'_>> = candidates.collect();
            let ranks = ranks(&candidates, column.direction, column.decimals);
            for (method, (cell, rank)) in cells.iter().zip(ranks).enumerate() {
                let row = &mut rows[method];
                let mut texts = cell_notes(&row.label, &dataset.dataset, column, cell);
                if column.direction.is_some() && cell.n > 0 {
                    texts.extend(feature_mark(column));
                    texts.extend(prediction_marks(dataset, method, &board.methods[method]));
                }
                let texts = texts.into_iter();
                row.cells.push(Cell {
                    value: cell.mean,
                    printed: None,
                    rank,
                    coverage: Some((cell.n, cell.total)),
                    std: cell.std,
                    spread: cell.spread,
                    infinite: cell.infinite,
                    failed: cell.failures.iter().map(|(_, count)| count).sum(),
                    notes: texts.map(|text| Table::note(&mut notes, text)).collect(),
                });
            }
        }
    }
    let mut table = Table {
        notes,
        ..Table::new(name, title, groups, columns.to_vec(), rows)
    };
    table.keep_used_notes();
    table.remarks = remarks::of_baselines(board, &table);
    table
}
