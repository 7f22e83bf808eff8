//! A comparison as tables: overall differences, and differences by part.

use std::collections::{BTreeMap, BTreeSet};

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

/// Maximum number of losses, and of gains, in [`RunComparison::extremes`].
pub const EXTREMES: usize = 3;

impl RunComparison {
    /// Overall differences: one table of verdicts per pair of methods, metrics as rows and datasets as columns, then
    /// one table per metric and pair of methods. A note that holds for several metrics is shown once.
    pub fn change_grids(&self) -> Vec<TextGrid> {
        let mut grids: Vec<TextGrid> = self
            .against
            .iter()
            .filter_map(|against| self.matrix(against))
            .collect();
        grids.extend(self.metric_grids());
        let mut shown = BTreeSet::new();
        for grid in &mut grids {
            grid.remarks.retain(|remark| shown.insert(remark.clone()));
        }
        grids
    }

    /// Verdicts and differences by metric and dataset; `None` for fewer than two verdicts.
    fn matrix(&self, against: &Against) -> Option<TextGrid> {
        let of = |row: &&ScoreChange| row.method_a == against.a && row.method_b == against.b;
        let rows: Vec<&ScoreChange> = self.rows.iter().filter(of).collect();
        let name = |row: &ScoreChange| format!("{}{}", row.metric, region(row.region));
        let (mut metrics, mut datasets) = (Vec::new(), Vec::new());
        for row in &rows {
            if !metrics.contains(&name(row)) {
                metrics.push(name(row));
            }
            if !datasets.contains(&row.dataset) {
                datasets.push(row.dataset.clone());
            }
        }
        let cell = |metric: &String, dataset: &String| {
            let mut rows = rows.iter();
            let row = rows.find(|row| name(row) == *metric && row.dataset == *dataset);
            GridCell::words(row.map_or_else(String::new, |row| {
                let difference = shown(row.difference, row.decimals + 1);
                let sign = if row.difference > 0.0 { "+" } else { "" };
                format!("{} ({sign}{difference})", verdict_word(row.verdict))
            }))
        };
        let lines = metrics.iter().map(|metric| {
            let cells = datasets.iter().map(|dataset| cell(metric, dataset));
            std::iter::once(GridCell::words(metric))
                .chain(cells)
                .collect()
        });
        let mut heads = vec!["metric"];
        heads.extend(datasets.iter().map(String::as_str));
        let title = format!(
            "{} (B) against {} (A): verdict on B, with the difference B − A",
            against.b, against.a
        );
        (rows.len() > 1).then(|| TextGrid::new(title, &heads, lines))
    }

    /// One table per metric and pair of methods.
    fn metric_grids(&self) -> Vec<TextGrid> {
        let groups = self.rows.chunk_by(|one, other| {
            let key = |row: &ScoreChange| {
                let methods = (row.method_a.clone(), row.method_b.clone());
                (methods, row.metric.clone(), row.region)
            };
            key(one) == key(other)
        });
        let grid = |rows: &[ScoreChange]| {
            let first = &rows[0];
            let methods = [first.method_a.as_str(), &first.method_b];
            let title = title(&first.metric, first.region, methods);
            TextGrid::new(title, &HEADS, rows.iter().map(cells))
                .remarked(rows.iter().flat_map(remarks))
        };
        groups.map(grid).collect()
    }

    /// The pairs with the largest losses and gains; `None` if nothing changed.
    pub fn extremes(&self, against: &Against, metric: &MetricInfo) -> Option<TextGrid> {
        let changes = self.changes(against, metric);
        let rows = most_changed(&changes, EXTREMES);
        let row = |change: &PairChange<'_>| {
            let [a, b] = change.scores;
            let decimals = metric.decimals + 1;
            let number = |value: f64| GridCell::rounded(value, decimals);
            vec![
                GridCell::words(&change.a.pair_id),
                number(a),
                number(b),
                number(if a == b { 0.0 } else { b - a }),
            ]
        };
        let rows: Vec<_> = rows.map(row).collect();
        let key = MetricKey::whole(metric.key.metric()).to_string();
        let title = title(&key, metric.key.region(), [&against.a, &against.b]);
        let what = match [changes.first(), changes.last()].map(|end| end.map(|c| c.loss < 0.0)) {
            [Some(true), _] => "largest gains",
            [_, Some(true)] => "largest losses and gains",
            _ => "largest losses",
        };
        let title = format!("{title}: {what}");
        (!rows.is_empty()).then(|| TextGrid::new(title, &["pair", "A", "B", "B - A"], rows))
    }

    /// Differences by part, one table per metric, pair of methods and [`Division`].
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
            let methods = [first.method_a.as_str(), &first.method_b];
            let title = title(&first.metric, first.region, methods);
            let mut heads = vec!["dataset", first.by.title()];
            heads.extend((first.by == Division::Pixels).then_some("share of pixels"));
            heads.extend([
                "pairs", "scenes", "A", "B", "B - A", "95 %", "worse", "better",
            ]);
            let rows = strata.iter().map(|s| stratum_cells(s, decimals));
            TextGrid::new(format!("{title} by {}", first.by.title()), &heads, rows)
        };
        groups.map(grid).collect()
    }
}

/// Up to `count` of the largest losses and up to `count` of the largest gains, in the order of
/// [`RunComparison::changes`].
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

pub(in crate::track) fn p_text(p: f64) -> String {
    if p < 0.0001 {
        "<0.0001".to_owned()
    } else {
        format!("{p:.4}")
    }
}

fn cells(row: &ScoreChange) -> Vec<GridCell> {
    // One decimal more than for single scores, because means of many pairs are compared here.
    let decimals = row.decimals + 1;
    let number = |value: f64| GridCell::rounded(value, decimals);
    let p = |value: Option<f64>| GridCell::optional(value, p_text);
    vec![
        GridCell::words(&row.dataset),
        GridCell::count(row.n_pairs),
        GridCell::count(row.n_scenes),
        number(row.mean_a),
        number(row.mean_b),
        number(row.difference),
        GridCell::interval(row.ci_low, row.ci_high, decimals),
        p(row.p),
        p(row.p_holm),
        GridCell::optional(row.mde, |mde| shown(mde, decimals)),
        GridCell::words(verdict_word(row.verdict)),
    ]
}

fn stratum_cells(stratum: &Stratum, decimals: usize) -> Vec<GridCell> {
    let number = |value: f64| GridCell::rounded(value, decimals);
    let share = stratum.pixel_share;
    let share = share.map(|share| GridCell::number(format!("{:.1} %", share * 100.0), share));
    [
        GridCell::words(&stratum.dataset),
        GridCell::words(&stratum.stratum),
    ]
    .into_iter()
    .chain(share)
    .chain([
        GridCell::count(stratum.n_pairs),
        GridCell::count(stratum.n_scenes),
        number(stratum.mean_a),
        number(stratum.mean_b),
        number(stratum.difference),
        GridCell::interval(stratum.ci_low, stratum.ci_high, decimals),
        GridCell::count(stratum.n_worse),
        GridCell::count(stratum.n_better),
    ])
    .collect()
}

fn remarks(row: &ScoreChange) -> Vec<String> {
    let mut remarks = Vec::new();
    let dataset = &row.dataset;
    if let (Some(p), Some(floor), 2..) = (row.p_sign_flip, row.p_sign_flip_floor, row.n_scenes) {
        remarks.push(format!(
            "{dataset}: p = {p:.4} by a permutation test that swaps A and B in whole scenes; with {} scenes, p \
             cannot be below {floor:.4}",
            row.n_scenes
        ));
    }
    match row.no_inference {
        None => {}
        Some(NoInference::OneCluster) if dataset == ALL && row.n_scenes > 1 => {
            remarks.push(format!(
                "{ALL}: no interval and no p, because a dataset has a single scene, which does not show how scenes vary"
            ));
        }
        Some(NoInference::OneCluster) => remarks.push(format!(
            "{dataset}: no interval and no p, because one scene does not show how scenes vary"
        )),
        Some(NoInference::NoPairs) if dataset != ALL => remarks.push(format!(
            "{dataset}: nothing to compare, because no pair has a score in both A and B"
        )),
        Some(NoInference::NoPairs) => remarks.push(format!(
            "{ALL}: no mean, because a dataset has nothing to compare"
        )),
        Some(reason) => remarks.push(format!("{dataset}: no interval and no p, because {reason}")),
    }
    if row.merged_scenes > 0 {
        remarks.push(format!(
            "{dataset}: its {} scenes show {} physical scenes; several exposures or lightings of a scene count as one",
            row.n_scenes + row.merged_scenes,
            row.n_scenes
        ));
    }
    if row.left_out > 0 {
        let pairs = counted(row.left_out, "pair");
        remarks.push(format!(
            "{dataset}: {pairs} left out, because A or B has no score"
        ));
    }
    if row.n_infinite > 0 {
        let pairs = counted(row.n_infinite, "pair");
        remarks.push(format!("{dataset}: {pairs} with an infinite score"));
    }
    remarks
}
