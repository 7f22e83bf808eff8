//! Mean, spread and coverage of one metric over the pairs of one dataset, from the raw records.

use sharp_statistics::sample_std;

use crate::evaluate::record::{Record, Score, Status};

use super::board::DatasetBoard;

/// Statistics of a table cell.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CellStatistics {
    /// Number of pairs with a score.
    pub n: usize,
    /// Number of pairs in the dataset.
    pub total: usize,
    /// Mean over the pairs with a score, in the order of their ids, under the dataset's
    /// [`Aggregation`](crate::evaluate::Aggregation); infinite if any score is.
    pub mean: Option<f64>,
    /// Sample standard deviation over pairs (divisor n − 1); `None` for fewer than two scores or an infinite one.
    pub std: Option<f64>,
    /// Number of infinite scores.
    pub infinite: usize,
    /// Mean over the finite scores; `None` if there are none.
    pub finite_mean: Option<f64>,
    /// Reasons for failed predictions with their counts, in the order encountered.
    pub failures: Vec<(String, usize)>,
    /// Reasons why other scores are missing, with their counts, in the order encountered.
    pub absences: Vec<(String, usize)>,
    /// For each pair with a score, its index in the dataset.
    pub scored: Vec<usize>,
}

/// Statistics of the metric `key` for method number `method`.
pub fn of_metric(dataset: &DatasetBoard<'_>, method: usize, key: &str) -> CellStatistics {
    gather(dataset, method, |record| match record.scores.get(key) {
        Some(Score::Value(value)) => Ok(*value),
        Some(Score::Unavailable { unavailable }) => Err(unavailable.clone()),
        None => Err("not computed in this run".into()),
    })
}

/// Statistics of the quantity `name` that method number `method` reports.
pub fn of_extra(dataset: &DatasetBoard<'_>, method: usize, name: &str) -> CellStatistics {
    gather(dataset, method, |record| {
        record
            .reported()
            .get(name)
            .copied()
            .ok_or_else(|| "this method does not report it".into())
    })
}

fn gather(
    dataset: &DatasetBoard<'_>,
    method: usize,
    value: impl Fn(&Record) -> Result<f64, String>,
) -> CellStatistics {
    let mut cell = CellStatistics {
        total: dataset.pairs.len(),
        ..CellStatistics::default()
    };
    let mut values = Vec::new();
    for (position, pair) in dataset.pairs.iter().enumerate() {
        let outcome = match pair.by_method.get(method).copied().flatten() {
            None => Err((false, "no record of this pair".to_owned())),
            Some(record) => match &record.status {
                Status::Failed { reason } => Err((true, reason.clone())),
                Status::Ok => match value(record) {
                    Ok(value) => Ok((record, value)),
                    Err(reason) => Err((false, reason)),
                },
            },
        };
        match outcome {
            Ok(v) => {
                values.push(v);
                cell.scored.push(position);
            }
            Err((failed, reason)) => {
                let reasons = match failed {
                    true => &mut cell.failures,
                    false => &mut cell.absences,
                };
                match reasons.iter_mut().find(|(known, _)| *known == reason) {
                    Some((_, n)) => *n += 1,
                    None => reasons.push((reason, 1)),
                }
            }
        }
    }
    cell.n = values.len();
    let aggregation = dataset.dataset.aggregation;
    cell.infinite = values.iter().filter(|(_, v)| v.is_infinite()).count();
    cell.mean = aggregation.of(values.iter().copied());
    let numbers: Vec<f64> = values.iter().map(|(_, v)| *v).collect();
    cell.std = sample_std(&numbers);
    cell.finite_mean = aggregation.of(values.into_iter().filter(|(_, v)| v.is_finite()));
    cell
}
