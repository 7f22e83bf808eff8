//! Tables from a board.

use crate::report::input::{Better, Metric};
use crate::report::records::{Board, DatasetBoard};
use crate::report::summary::{Summary, of_extra, of_metric};

use super::marks::{marks, proxy_mark};
use super::rank::{Candidate, ranks};
use super::{Cell, Group, Row, Table, shown};

/// Value columns of a table at most: as many as the paper's own tables have.
const MAX_COLUMNS: usize = 12;

/// The scores of a board; nothing without a metric. One table named `scores` if it has at most twelve columns; otherwise, as in the
/// paper, the perceptual metrics (DISTS, LPIPS) apart from the pixelwise ones, in as many tables as needed.
pub fn of_scores(board: &Board<'_>, metrics: &[Metric]) -> Vec<Table> {
    if metrics.is_empty() {
        return Vec::new();
    }
    let groups = board.datasets.len().max(1);
    let width = (MAX_COLUMNS / groups).max(1);
    if metrics.len() <= width {
        let name = "scores".to_owned();
        return vec![table(board, metrics, name, "Scores".into(), of_metric)];
    }
    let (perceptual, pixelwise): (Vec<Metric>, Vec<Metric>) =
        metrics.iter().cloned().partition(|m| is_perceptual(&m.key));
    let mut tables = Vec::new();
    for (family, title, members) in [
        ("perceptual", "Perceptual metrics", perceptual),
        ("pixelwise", "Pixelwise metrics", pixelwise),
    ] {
        for (i, part) in members.chunks(width).enumerate() {
            let (name, title) = if i == 0 {
                (format!("scores-{family}"), title.to_owned())
            } else {
                (
                    format!("scores-{family}-{}", i + 1),
                    format!("{title} ({})", i + 1),
                )
            };
            tables.push(table(board, part, name, title, of_metric));
        }
    }
    tables
}

/// What the methods report about their own predictions, for those that report anything; nothing is ranked.
/// `None` if nobody does.
pub fn of_extras(board: &Board<'_>, extras: &[Metric]) -> Option<Table> {
    let reported = |method: usize, key: &str| {
        let pairs = board.datasets.iter().flat_map(|d| &d.pairs);
        let mut records = pairs.filter_map(|pair| pair.by_method.get(method).copied().flatten());
        records.any(|record| record.reported().contains_key(key))
    };
    let methods = 0..board.methods.len();
    let present: Vec<Metric> = extras
        .iter()
        .filter(|extra| methods.clone().any(|m| reported(m, &extra.key)))
        .cloned()
        .collect();
    if present.is_empty() {
        return None;
    }
    let title = "What the methods report about their predictions".to_owned();
    let mut all = table(board, &present, "reported".into(), title, of_extra);
    let mut position = 0..;
    all.rows.retain(|_| {
        let method = position.next().unwrap_or_default();
        present.iter().any(|extra| reported(method, &extra.key))
    });
    for row in &mut all.rows {
        row.note = None;
    }
    all.keep_used_notes();
    Some(all)
}

fn is_perceptual(key: &str) -> bool {
    key.starts_with("lpips") || key.starts_with("dists")
}

type Summarise = fn(&DatasetBoard<'_>, usize, &str) -> Summary;

fn table(
    board: &Board<'_>,
    metrics: &[Metric],
    name: String,
    title: String,
    summarise: Summarise,
) -> Table {
    let mut notes = Vec::new();
    let groups = board
        .datasets
        .iter()
        .map(|d| Group {
            title: d.dataset.name.clone(),
            pairs: Some(d.total()),
            note: proxy_mark(&d.dataset).map(|text| Table::note(&mut notes, text)),
        })
        .collect();
    let mut rows: Vec<Row> = board
        .methods
        .iter()
        .map(|method| Row {
            label: method.label.clone(),
            note: method.unranked.as_ref().map(|reason| {
                let text = format!("{}: shown without a rank, {reason}.", method.label);
                Table::note(&mut notes, text)
            }),
            cells: Vec::new(),
        })
        .collect();
    for dataset in &board.datasets {
        for metric in metrics {
            let column: Vec<Summary> = (0..rows.len())
                .map(|method| summarise(dataset, method, &metric.key))
                .collect();
            let candidates: Vec<Candidate<'_>> = column
                .iter()
                .zip(&board.methods)
                .map(|(s, method)| Candidate {
                    value: s.mean,
                    covers: &s.scored,
                    complete: s.n == s.total,
                    ranked: method.unranked.is_none(),
                })
                .collect();
            let ranks = ranks(&candidates, metric.better, metric.decimals);
            for (method, ((row, summary), rank)) in
                rows.iter_mut().zip(&column).zip(ranks).enumerate()
            {
                let mut texts = cell_notes(&row.label, &dataset.dataset.name, metric, summary);
                if metric.better != Better::Neither && summary.n > 0 {
                    texts.extend(marks(dataset, method, &board.methods[method]));
                }
                row.cells.push(Cell {
                    value: summary.mean,
                    rank,
                    coverage: Some((summary.n, summary.total)),
                    std: summary.std,
                    infinite: summary.infinite,
                    failed: summary.failed,
                    notes: texts
                        .into_iter()
                        .map(|text| Table::note(&mut notes, text))
                        .collect(),
                });
            }
        }
    }
    let mut table = Table {
        name,
        title,
        row_head: "method",
        groups,
        metrics: metrics.to_vec(),
        rows,
        notes,
    };
    table.keep_used_notes();
    table
}

/// What a reader must know about a cell besides its number.
fn cell_notes(method: &str, dataset: &str, metric: &Metric, summary: &Summary) -> Vec<String> {
    let Summary { n, total, .. } = *summary;
    let mut notes = Vec::new();
    if total == 0 {
        notes.push(format!("{dataset} has no pairs."));
    } else if n == 0 {
        notes.push(match summary.absences.as_slice() {
            // The same for every method and dataset: one footnote for all of them.
            [(reason, _)] => format!("No {} (`{}`): {reason}.", metric.label, metric.key),
            absences => format!(
                "{method} on {dataset}: no number for any of {total} pairs: {}.",
                listed(&[&summary.failures, absences].concat())
            ),
        });
    } else if n < total {
        notes.push(format!(
            "{method} on {dataset}: mean over {n} of {total} pairs, not ranked against rows that cover other pairs. \
             Missing: {}.",
            listed(&[summary.failures.as_slice(), &summary.absences].concat())
        ));
    }
    if summary.infinite > 0 {
        let mut note = if summary.infinite == n {
            "Infinite for every pair, and so is the mean".to_owned()
        } else {
            let infinite = summary.infinite;
            format!("Infinite for {infinite} of {n} pairs, and so is the mean")
        };
        if let Some(mean) = summary.finite_mean {
            note += &format!("; mean of the others {}", shown(mean, metric.decimals));
        }
        notes.push(note + ".");
    }
    notes
}

/// The first three reasons with their counts.
fn listed(reasons: &[(String, usize)]) -> String {
    let mut parts: Vec<String> = reasons
        .iter()
        .take(3)
        .map(|(reason, count)| format!("{reason} ({count}×)"))
        .collect();
    if reasons.len() > 3 {
        parts.push(format!("and {} more reasons", reasons.len() - 3));
    }
    parts.join("; ")
}
