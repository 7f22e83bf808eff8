//! Selects pairs for a page that cannot show all of them.

use sharp_metrics::Direction;

use super::board::{Board, PairBoard};
use super::column::Column;

/// Chooses at most `limit` pairs, each with the index of its dataset. Datasets share the limit equally; a dataset with
/// fewer pairs than its share leaves the rest to the other datasets. Half of each share goes to the pairs with the
/// largest `badness`. If `evenly`, the other half is spread over the remaining pairs; otherwise it goes to those with
/// the smallest `badness`.
pub(super) fn choose<'a>(
    board: &'a Board<'a>,
    limit: usize,
    evenly: bool,
    badness: impl Fn(&PairBoard<'a>) -> f64,
) -> Vec<(usize, &'a PairBoard<'a>)> {
    let mut shares = vec![0; board.datasets.len()];
    let mut left = limit;
    while left > 0 {
        let mut given = 0;
        for (share, dataset) in shares.iter_mut().zip(&board.datasets) {
            if *share < dataset.pairs.len() && given < left {
                *share += 1;
                given += 1;
            }
        }
        if given == 0 {
            break;
        }
        left -= given;
    }
    let mut chosen = Vec::new();
    for (d, (share, dataset)) in shares.into_iter().zip(&board.datasets).enumerate() {
        if share == dataset.pairs.len() {
            chosen.extend(dataset.pairs.iter().map(|pair| (d, pair)));
            continue;
        }
        let worst_first = worst_first(&dataset.pairs, &badness);
        let worst = share.div_ceil(2);
        let rest = worst_first.len() - worst;
        let others = share - worst;
        let other = |i: usize| {
            if evenly {
                worst + (2 * i + 1) * rest / (2 * others)
            } else {
                worst_first.len() - others + i
            }
        };
        let mut picked: Vec<&PairBoard<'a>> = (0..worst)
            .chain((0..others).map(other))
            .filter_map(|i| worst_first.get(i).copied())
            .collect();
        picked.sort_by(|a, b| a.facts.pair_id.cmp(&b.facts.pair_id));
        chosen.extend(picked.into_iter().map(|pair| (d, pair)));
    }
    chosen
}

/// The pairs of a dataset, sorted from worst to best score, then by id.
pub(super) fn by_badness<'a>(
    board: &Board<'a>,
    pairs: &'a [PairBoard<'a>],
    metrics: &[Column],
) -> Vec<&'a PairBoard<'a>> {
    worst_first(pairs, &|pair| badness(board, pair, metrics))
}

fn worst_first<'a>(
    pairs: &'a [PairBoard<'a>],
    badness: &dyn Fn(&PairBoard<'a>) -> f64,
) -> Vec<&'a PairBoard<'a>> {
    let order = pairs.iter().map(|pair| (pair, badness(pair)));
    let mut order: Vec<(&PairBoard<'a>, f64)> = order.collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    order.into_iter().map(|(pair, _)| pair).collect()
}

/// The pairs on which `method` is worse than `other` in the first ranked metric, the largest difference first, then by
/// id.
pub(super) fn most_lost<'a>(
    pairs: &'a [PairBoard<'a>],
    metrics: &[Column],
    method: usize,
    other: usize,
) -> Vec<&'a PairBoard<'a>> {
    let ranked = metrics.iter().find_map(|m| Some((m, m.direction?)));
    let lost = |pair: &PairBoard<'a>| {
        let (metric, direction) = ranked?;
        let score = |at: usize| pair.by_method[at]?.scores.get(&metric.key)?.value();
        let gain = score(method)? - score(other)?;
        let lost = match direction {
            Direction::Higher => -gain,
            Direction::Lower => gain,
        };
        (lost > 0.0).then_some(lost)
    };
    let mut worst_first = worst_first(pairs, &|pair| lost(pair).unwrap_or(0.0));
    worst_first.retain(|pair| lost(pair).is_some());
    worst_first
}

/// Mean score of the ranked methods in the first metric that has finite scores, negated if higher is better, so that
/// larger is worse.
pub(super) fn badness(board: &Board<'_>, pair: &PairBoard<'_>, metrics: &[Column]) -> f64 {
    let mean_of = |metric: &Column| {
        let sign = match metric.direction? {
            Direction::Higher => -1.0,
            Direction::Lower => 1.0,
        };
        let records = pair.by_method.iter().zip(&board.methods);
        let ranked = records.filter(|(_, method)| method.unranked.is_none());
        let values: Vec<f64> = ranked
            .filter_map(|(record, _)| (*record)?.scores.get(&metric.key)?.value())
            .filter(|v| v.is_finite())
            .collect();
        Some(sign * sharp_statistics::mean(&values)?)
    };
    metrics.iter().find_map(mean_of).unwrap_or(0.0)
}
