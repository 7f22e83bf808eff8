//! A comparison as tables: the changes, and their parts.

use std::collections::BTreeMap;

use sharp_metrics::identity::MetricRegion;
use sharp_metrics::{MetricInfo, MetricKey};
use sharp_statistics::NoInference;

use super::breakdown::{Division, Stratum};
use super::{ALL, Against, PairChange, RunComparison, ScoreChange, verdict_word};
use crate::io::counts::counted;
use crate::report::tables::grid::{GridCell, TextGrid};
use crate::report::tables::shown;

const HEADS: [&str; 11] = [
    "dataset",
    "pairs",
    "scenes",
    "A",
    "B",
    "B - A",
    "95 %",
    "p",
    "p Holm",
    "detectable",
    "B is",
];

/// Most lost and most won pairs in [`RunComparison::extremes`].
pub const EXTREMES: usize = 3;

impl RunComparison {
    /// One table a metric and method: what changed.
    pub fn change_grids(&self) -> Vec<TextGrid> {
        let groups = self.rows.chunk_by(|one, other| {
            let key = |row: &ScoreChange| {
                let methods = (row.method_a.clone(), row.method_b.clone());
                (methods, row.metric.clone(), row.region)
            };
            key(one) == key(other)
        });
        let grid = |rows: &[ScoreChange]| {
            let first = &rows[0];
            TextGrid {
                title: title(
                    &first.metric,
                    first.region,
                    [&first.method_a, &first.method_b],
                ),
                heads: HEADS.map(str::to_owned).to_vec(),
                rows: rows.iter().map(cells).collect(),
                remarks: rows.iter().flat_map(remarks).collect(),
            }
        };
        groups.map(grid).collect()
    }

    /// One table a metric: the pairs that lost most and those that won most. None where nothing changed.
    pub fn extremes(&self, against: &Against, metric: &MetricInfo) -> Option<TextGrid> {
        let changes = self.changes(against, metric);
        let rows = most_changed(&changes, EXTREMES);
        let row = |change: &PairChange<'_>| {
            let [a, b] = change.scores;
            let decimals = metric.decimals + 1;
            let number = |value: f64| GridCell::number(shown(value, decimals), value);
            vec![
                GridCell::words(&change.a.pair_id),
                number(a),
                number(b),
                number(if a == b { 0.0 } else { b - a }),
            ]
        };
        let rows: Vec<_> = rows.map(row).collect();
        let key = MetricKey::whole(metric.key.metric()).to_string();
        (!rows.is_empty()).then(|| TextGrid {
            title: format!(
                "{}: most lost and most won",
                title(&key, metric.key.region(), [&against.a, &against.b])
            ),
            heads: ["pair", "A", "B", "B - A"].map(str::to_owned).to_vec(),
            rows,
            remarks: Vec::new(),
        })
    }

    /// One table a metric, method and [`Division`]: where it changed.
    pub fn where_grids(&self, strata: &[Stratum]) -> Vec<TextGrid> {
        let decimals: BTreeMap<String, usize> = self
            .results
            .manifest
            .metrics
            .iter()
            .map(|m| (m.info.key.to_string(), m.info.decimals + 1))
            .collect();
        let groups = strata.chunk_by(|one, other| {
            let key = |s: &Stratum| {
                let methods = (s.method_a.clone(), s.method_b.clone());
                (methods, s.metric.clone(), s.region, s.by)
            };
            key(one) == key(other)
        });
        let grid = |strata: &[Stratum]| {
            let first = &strata[0];
            let key = format!("{}{}", first.metric, region(first.region));
            let decimals = decimals.get(&key).copied().unwrap_or(3);
            let of_pixels = first.by == Division::Pixels;
            let title = title(
                &first.metric,
                first.region,
                [&first.method_a, &first.method_b],
            );
            TextGrid {
                title: format!("{title} by {}", first.by.title()),
                heads: ["dataset", first.by.title()]
                    .into_iter()
                    .chain(of_pixels.then_some("share of pixels"))
                    .chain([
                        "pairs", "scenes", "A", "B", "B - A", "95 %", "worse", "better",
                    ])
                    .map(str::to_owned)
                    .collect(),
                rows: strata.iter().map(|s| stratum_cells(s, decimals)).collect(),
                remarks: Vec::new(),
            }
        };
        groups.map(grid).collect()
    }
}

/// Up to `count` of the largest losses and as many of the largest gains, in the order of [`RunComparison::changes`].
pub(super) fn most_changed<'c, 'a>(
    changes: &'c [PairChange<'a>],
    count: usize,
) -> impl Iterator<Item = &'c PairChange<'a>> {
    let lost = changes
        .iter()
        .filter(|change| change.loss > 0.0 || change.loss.is_nan())
        .count();
    let won = changes.iter().filter(|change| change.loss < 0.0).count();
    let lost = &changes[..lost.min(count)];
    lost.iter()
        .chain(&changes[changes.len() - won.min(count)..])
}

fn region(region: MetricRegion) -> &'static str {
    match region {
        MetricRegion::Whole => "",
        region => region.suffix(),
    }
}

fn title(metric: &str, of: MetricRegion, [a, b]: [&str; 2]) -> String {
    format!("{metric}{}: {a} (A), {b} (B)", region(of))
}

pub(in crate::track) fn count(n: usize) -> GridCell {
    GridCell::number(n.to_string(), n as f64)
}

pub(in crate::track) fn p_text(p: f64) -> String {
    match p < 0.0001 {
        true => "<0.0001".to_owned(),
        false => format!("{p:.4}"),
    }
}

pub(in crate::track) fn optional(value: Option<f64>, text: impl Fn(f64) -> String) -> GridCell {
    // Numbers to sort by, last.
    value.map_or_else(
        || GridCell::number("-", f64::NAN),
        |value| GridCell::number(text(value), value),
    )
}

pub(in crate::track) fn interval(low: Option<f64>, high: Option<f64>, decimals: usize) -> GridCell {
    let end = |end: Option<f64>| end.map_or_else(|| "-".to_owned(), |end| shown(end, decimals));
    match (low, high) {
        (None, None) => GridCell::number("-", f64::NAN),
        (low, high) => {
            let text = format!("{} .. {}", end(low), end(high));
            GridCell::number(text, low.unwrap_or(f64::NEG_INFINITY))
        }
    }
}

fn cells(row: &ScoreChange) -> Vec<GridCell> {
    // One decimal more than single scores: means of many are compared.
    let decimals = row.decimals + 1;
    let number = |value: f64| GridCell::number(shown(value, decimals), value);
    let p = |value: Option<f64>| optional(value, p_text);
    vec![
        GridCell::words(&row.dataset),
        count(row.n_pairs),
        count(row.n_scenes),
        number(row.mean_a),
        number(row.mean_b),
        number(row.difference),
        interval(row.ci_low, row.ci_high, decimals),
        p(row.p),
        p(row.p_holm),
        optional(row.mde, |mde| shown(mde, decimals)),
        GridCell::words(verdict_word(row.verdict)),
    ]
}

fn stratum_cells(stratum: &Stratum, decimals: usize) -> Vec<GridCell> {
    let number = |value: f64| GridCell::number(shown(value, decimals), value);
    let share = stratum.pixel_share;
    let share = share.map(|share| GridCell::number(format!("{:.1} %", share * 100.0), share));
    [
        GridCell::words(&stratum.dataset),
        GridCell::words(&stratum.stratum),
    ]
    .into_iter()
    .chain(share)
    .chain([
        count(stratum.n_pairs),
        count(stratum.n_scenes),
        number(stratum.mean_a),
        number(stratum.mean_b),
        number(stratum.difference),
        interval(stratum.ci_low, stratum.ci_high, decimals),
        count(stratum.n_worse),
        count(stratum.n_better),
    ])
    .collect()
}

/// Notes on a row.
fn remarks(row: &ScoreChange) -> Vec<String> {
    let mut remarks = Vec::new();
    let dataset = &row.dataset;
    if let (Some(p), Some(floor), 2..) = (row.p_sign_flip, row.p_sign_flip_floor, row.n_scenes) {
        remarks.push(format!(
            "{dataset}: by the signs of {} scenes alone p = {p:.4}, at least {floor:.4} with so many",
            row.n_scenes
        ));
    }
    match row.no_inference {
        None => {}
        Some(NoInference::OneCluster) => remarks.push(format!(
            "{dataset}: no interval and no p, because one scene does not show how scenes vary"
        )),
        Some(NoInference::NoPairs) if dataset != ALL => remarks.push(format!(
            "{dataset}: nothing to compare, because no pair has a score on both sides"
        )),
        Some(NoInference::NoPairs) => remarks.push(format!(
            "{ALL}: no mean, because a dataset has nothing to compare"
        )),
        Some(reason) => remarks.push(format!("{dataset}: no interval and no p, because {reason}")),
    }
    if row.merged_scenes > 0 {
        remarks.push(format!(
            "{dataset}: its {} scenes show {} physical ones, of which several exposures or lightings are one",
            row.n_scenes + row.merged_scenes,
            row.n_scenes
        ));
    }
    if row.left_out > 0 {
        let pairs = counted(row.left_out, "pair");
        remarks.push(format!(
            "{dataset}: {pairs} without a score on both sides left out"
        ));
    }
    if row.n_infinite > 0 {
        let pairs = counted(row.n_infinite, "pair");
        remarks.push(format!("{dataset}: {pairs} with an infinite score"));
    }
    remarks
}
