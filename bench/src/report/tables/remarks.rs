//! Remarks on a whole table: missing metrics, and baselines that methods do not beat.

use std::collections::{BTreeMap, BTreeSet};

use sharp_metrics::Direction;

use crate::evaluate::record::{Record, Score};
use crate::report::board::{Board, ReportMethod};
use crate::report::column::Column;
use crate::report::statistics::of_extra;

use super::Table;
use super::rank::rounded;

/// If a method scores worse than a baseline, its holes are mentioned if they cover at least this share of the pixels on
/// average.
const MIN_HOLE_SHARE: f64 = 0.01;

/// The metrics that have a score in at least one record, and a sentence on why the remaining metrics, if any, have
/// none. If no metric has a score, returns all metrics without a sentence, because the cells then state the reason.
pub(in crate::report) fn scored(
    records: &[Record],
    metrics: &[Column],
) -> (Vec<Column>, Option<String>) {
    let has_number = |metric: &Column| {
        let mut scores = records.iter().filter_map(|r| r.scores.get(&metric.key));
        scores.any(|score| score.value().is_some())
    };
    let (shown, missing): (Vec<Column>, Vec<Column>) =
        metrics.iter().cloned().partition(has_number);
    if shown.is_empty() || missing.is_empty() {
        return (metrics.to_vec(), None);
    }
    let mut by_reason: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for metric in &missing {
        let reasons = records
            .iter()
            .filter_map(|r| match r.scores.get(&metric.key)? {
                Score::Unavailable { unavailable } => Some(unavailable.as_str()),
                Score::Value(_) => None,
            });
        let reasons: BTreeSet<&str> = reasons.collect();
        let reason = if reasons.is_empty() {
            "not computed in this run".to_owned()
        } else {
            Vec::from_iter(reasons).join("; ")
        };
        let name = format!("{} (`{}`)", metric.label, metric.key);
        by_reason.entry(reason).or_default().push(name);
    }
    let parts = by_reason.into_iter();
    let parts = parts.map(|(reason, names)| format!("{}: {reason}", names.join(", ")));
    let parts: Vec<String> = parts.collect();
    let text = format!(
        "Metrics not shown, because they have no number: {}.",
        parts.join("; ")
    );
    (shown, Some(text))
}

/// A number in the comparison of methods with baselines, from a ranked row that covers every pair.
struct Entrant<'a> {
    method: usize,
    /// The number as displayed, negated if higher is better, so that smaller values are better.
    badness: f64,
    /// Label and number.
    text: String,
    facts: &'a ReportMethod,
}

/// Remarks, for each dataset, on the metrics in which a baseline has a better mean than every other method, or than a
/// method with holes. `table` must have a row for each method of the board.
pub(super) fn of_baselines(board: &Board<'_>, table: &Table) -> Vec<String> {
    let names = Column::names(&table.columns);
    let mut remarks = Vec::new();
    for (d, dataset) in board.datasets.iter().enumerate() {
        let mut ahead_of_all = Vec::new();
        let mut behind_one = Vec::new();
        // For each method that is behind a baseline, the metrics in which it is behind without being the best method.
        let mut behind: BTreeMap<usize, Vec<String>> = BTreeMap::new();
        for (c, name) in names.iter().enumerate() {
            let (baselines, others): (Vec<Entrant<'_>>, Vec<Entrant<'_>>) =
                entrants(board, table, d, c)
                    .into_iter()
                    .partition(|entrant| entrant.facts.is_baseline);
            let Some(baseline) = baselines.first() else {
                continue;
            };
            if let Some(best) = others.first().filter(|one| one.badness < baseline.badness) {
                behind_one.push(format!("{name} ({}; {})", best.text, baseline.text));
            }
            for (place, other) in others.iter().enumerate() {
                if other.badness > baseline.badness {
                    let text = format!("{name} ({}; {})", baseline.text, other.text);
                    let columns = behind.entry(other.method).or_default();
                    let list = if place == 0 {
                        &mut ahead_of_all
                    } else {
                        columns
                    };
                    list.push(text);
                }
            }
        }
        let mut text = String::new();
        if !ahead_of_all.is_empty() {
            text = format!(
                " a baseline has a better mean than every other method in {}",
                ahead_of_all.join(", ")
            );
            if !behind_one.is_empty() {
                text += &format!(
                    "; a method is ahead of all baselines in {}",
                    behind_one.join(", ")
                );
            }
            text.push('.');
        }
        for (method, columns) in behind {
            let share = of_extra(dataset, method, "hole_share").mean.unwrap_or(0.0);
            if share < MIN_HOLE_SHARE {
                continue;
            }
            text += &format!(
                " {} leaves {:.1} % of a picture empty on average, and these holes are scored like \
                 any other pixels",
                board.methods[method].label,
                100.0 * share
            );
            if !columns.is_empty() {
                text += &format!("; a baseline has a better mean in {}", columns.join(", "));
            }
            text.push('.');
        }
        if !text.is_empty() {
            remarks.push(format!("{}:{text}", dataset.dataset.title()));
        }
    }
    remarks
}

/// The entrants for one column of a dataset, from best to worst.
fn entrants<'a>(
    board: &'a Board<'_>,
    table: &Table,
    dataset: usize,
    column: usize,
) -> Vec<Entrant<'a>> {
    let metric = &table.columns[column];
    let sign = match metric.direction {
        Some(Direction::Higher) => -1.0,
        Some(Direction::Lower) => 1.0,
        None => return Vec::new(),
    };
    let at = dataset * table.columns.len() + column;
    let rows = table.rows.iter().zip(&board.methods).enumerate();
    let entrants = rows.filter_map(|(method, (row, facts))| {
        let cell = &row.cells[at];
        let value = cell.value.filter(|v| !v.is_nan())?;
        (facts.unranked.is_none() && cell.partial().is_none()).then(|| Entrant {
            method,
            badness: sign * rounded(value, metric.decimals),
            text: format!("{} {}", row.label, metric.shown(value)),
            facts,
        })
    });
    let mut entrants: Vec<Entrant<'_>> = entrants.collect();
    entrants.sort_by(|a, b| a.badness.total_cmp(&b.badness));
    entrants
}
