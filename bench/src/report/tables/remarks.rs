//! What a reader must know about a whole table: metrics that it lacks, and baselines that methods do not surpass.

use std::collections::{BTreeMap, BTreeSet};

use sharp_metrics::Direction;

use crate::evaluate::record::{Record, Score};
use crate::report::board::Board;
use crate::report::input::Column;
use crate::report::statistics::of_extra;

use super::Table;
use super::rank::rounded;

/// Share of empty pixels from which a method behind a baseline is said to have holes.
const HOLES: f64 = 0.01;

/// The metrics that have a number in some record, and a sentence on why the others have none. All metrics where none
/// has a number: then the cells themselves say why.
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
        let reason = match reasons.is_empty() {
            true => "not computed in this run".to_owned(),
            false => Vec::from_iter(reasons).join("; "),
        };
        let name = format!("{} (`{}`)", metric.label, metric.key);
        by_reason.entry(reason).or_default().push(name);
    }
    let parts = by_reason.into_iter();
    let parts = parts.map(|(reason, names)| format!("{}: {reason}", names.join(", ")));
    let parts: Vec<String> = parts.collect();
    let text = format!(
        "Without any number, and so not shown: {}.",
        parts.join("; ")
    );
    (shown, Some(text))
}

/// A row in the contest for a column: it is ranked and covers every pair.
struct Entrant {
    method: usize,
    /// As shown; smaller is better.
    badness: f64,
    shown: String,
}

/// For each dataset, where a baseline is ahead of every method that is none, and where it is ahead of a method with
/// holes. `table` has a row for each method of the board.
pub(super) fn of_baselines(board: &Board<'_>, table: &Table) -> Vec<String> {
    let remarks = board.datasets.iter().enumerate().map(|(d, dataset)| {
        let (ahead_of_all, behind) = against_baselines(board, table, d);
        let mut sentences = Vec::new();
        if !ahead_of_all.is_empty() {
            sentences.push(format!(
                "a baseline is better than every method that is not one in {}.",
                ahead_of_all.join(", ")
            ));
        }
        for (method, columns) in behind {
            let holes = of_extra(dataset, method, "hole_share").mean;
            let Some(share) = holes.filter(|share| *share >= HOLES) else {
                continue;
            };
            let mut sentence = format!(
                "{} leaves on average {:.1} % of a picture empty, and these holes are scored like any other pixel",
                board.methods[method].label,
                100.0 * share
            );
            if !columns.is_empty() {
                sentence += &format!("; a baseline is better in {}", columns.join(", "));
            }
            sentences.push(sentence + ".");
        }
        let text = sentences.join(" ");
        (!text.is_empty()).then(|| format!("{}: {text}", dataset.dataset.title()))
    });
    remarks.flatten().collect()
}

/// For one dataset, the columns in which a baseline is ahead of every other method, with the best of these; and by
/// method those in which it alone is behind one, which may be none besides.
fn against_baselines(
    board: &Board<'_>,
    table: &Table,
    dataset: usize,
) -> (Vec<String>, BTreeMap<usize, Vec<String>>) {
    let (mut ahead_of_all, mut behind) = (Vec::new(), BTreeMap::<usize, Vec<String>>::new());
    for (c, name) in Column::names(&table.columns).into_iter().enumerate() {
        let mut entrants = entrants(board, table, dataset, c);
        entrants.sort_by(|a, b| a.badness.total_cmp(&b.badness));
        let (baselines, others): (Vec<&Entrant>, Vec<&Entrant>) = entrants
            .iter()
            .partition(|entrant| board.methods[entrant.method].is_baseline);
        let Some(baseline) = baselines.first() else {
            continue;
        };
        for (i, other) in others.iter().enumerate() {
            if other.badness <= baseline.badness {
                continue;
            }
            let [ahead, after] =
                [baseline, other].map(|e| format!("{} {}", board.methods[e.method].label, e.shown));
            let text = format!("{name} ({ahead}; {after})");
            let columns = behind.entry(other.method).or_default();
            if i == 0 {
                ahead_of_all.push(text);
            } else {
                columns.push(text);
            }
        }
    }
    (ahead_of_all, behind)
}

fn entrants(board: &Board<'_>, table: &Table, dataset: usize, column: usize) -> Vec<Entrant> {
    let metric = &table.columns[column];
    let sign = match metric.direction {
        Some(Direction::Higher) => -1.0,
        Some(Direction::Lower) => 1.0,
        None => return Vec::new(),
    };
    let at = dataset * table.columns.len() + column;
    let rows = table.rows.iter().zip(&board.methods).enumerate();
    let ranked = rows.filter(|(_, (_, method))| method.unranked.is_none());
    let entrants = ranked.filter_map(|(method, (row, _))| {
        let cell = &row.cells[at];
        let value = cell
            .value
            .filter(|v| !v.is_nan() && cell.partial().is_none())?;
        Some(Entrant {
            method,
            badness: sign * rounded(value, metric.decimals),
            shown: metric.shown(value),
        })
    });
    entrants.collect()
}
