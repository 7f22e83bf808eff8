//! The rows of a metric, one per dataset and one over all datasets, and their samples.

use std::collections::{BTreeMap, BTreeSet};

use sharp_metrics::{Direction, MetricInfo, MetricKey};
use sharp_statistics::{Clusters, Resampling, holm, infer, verdict};

use super::{ALL, PairChange, Practical, ScoreChange};
use crate::evaluate::record::{Record, Score};

/// Groups pairs by physical scene, the unit of the sample.
pub(super) fn clusters<'c, 'a: 'c>(changes: impl Iterator<Item = &'c PairChange<'a>>) -> Clusters {
    Clusters::new(changes.map(|change| (change.a.cluster.as_str(), change.scores)))
}

/// Records of two methods, keyed by pair.
pub(super) struct Sides<'a> {
    pub(super) a: BTreeMap<&'a str, &'a Record>,
    pub(super) b: BTreeMap<&'a str, &'a Record>,
}

impl<'a> Sides<'a> {
    pub(super) fn both(&self) -> impl Iterator<Item = (&'a Record, &'a Record)> {
        let pairs = self.a.iter();
        pairs.filter_map(|(pair_id, a)| Some((*a, *self.b.get(pair_id)?)))
    }

    pub(super) fn region_difference(&self) -> Option<String> {
        let (a, _) = self.both().find(|(a, b)| a.crop != b.crop)?;
        Some(format!(
            "different parts of the target of {} are scored",
            a.pair_id
        ))
    }

    /// The pairs with a score in both A and B, sorted by id.
    pub(super) fn changes(&self, metric: &MetricInfo) -> Vec<PairChange<'a>> {
        let key = metric.key.to_string();
        let score = |record: &Record| record.scores.get(&key).and_then(Score::value);
        let scored = self
            .both()
            .filter_map(|(a, b)| Some(PairChange::new(metric, a, [score(a)?, score(b)?])));
        scored.collect()
    }

    /// One row per dataset with planned pairs and, if there are several datasets, one row over all.
    /// If a dataset has no scores on one side, neither its row nor the row over all has numbers.
    /// `datasets` are the datasets' names with their numbers of planned pairs.
    pub(super) fn rows(
        &self,
        datasets: &[(&'a str, usize)],
        metric: &MetricInfo,
        practical: &Practical,
        resampling: Resampling,
    ) -> Vec<ScoreChange> {
        let changes = self.changes(metric);
        let datasets = datasets.iter().map(|&(name, planned)| {
            let of_dataset = || {
                changes
                    .iter()
                    .filter(move |change| change.a.dataset == name)
            };
            let ids: BTreeSet<&str> = of_dataset().map(|change| change.a.scene.as_str()).collect();
            let clusters = clusters(of_dataset());
            let merged = ids.len().saturating_sub(clusters.n_clusters());
            (
                name,
                planned.saturating_sub(clusters.n_pairs()),
                merged,
                clusters,
            )
        });
        let datasets: Vec<(&str, usize, usize, Clusters)> = datasets.collect();
        let mut groups: Vec<(&str, usize, usize, Vec<&Clusters>)> = datasets
            .iter()
            .map(|(name, left_out, merged, clusters)| (*name, *left_out, *merged, vec![clusters]))
            .collect();
        if datasets.len() > 1 {
            let left_out = datasets.iter().map(|(_, left_out, ..)| left_out).sum();
            let all = datasets.iter().map(|(.., clusters)| clusters);
            groups.push((ALL, left_out, 0, all.collect()));
        }
        let inferences: Vec<_> = groups
            .iter()
            .map(|(.., group)| infer(group, resampling))
            .collect();
        let p: Vec<_> = inferences
            .iter()
            .map(|inference| inference.as_ref().ok().map(|found| found.p))
            .collect();
        let rows = groups.iter().zip(&inferences).zip(p.iter().zip(holm(&p)));
        let rows = rows.map(
            |(((name, left_out, merged, group), inference), (p, p_holm))| {
                let mean = |of: fn(&Clusters) -> f64| {
                    group.iter().map(|c| of(c)).sum::<f64>() / group.len() as f64
                };
                let count = |of: fn(&Clusters) -> usize| group.iter().map(|c| of(c)).sum();
                let found = inference.as_ref().ok();
                let finite = |value: Option<f64>| value.filter(|value| value.is_finite());
                ScoreChange {
                    dataset: (*name).to_owned(),
                    metric: MetricKey::whole(metric.key.metric()).to_string(),
                    region: metric.key.region(),
                    method_a: String::new(),
                    method_b: String::new(),
                    n_pairs: count(Clusters::n_pairs),
                    n_scenes: count(Clusters::n_clusters),
                    n_infinite: count(Clusters::n_infinite),
                    mean_a: mean(Clusters::mean_a),
                    mean_b: mean(Clusters::mean_b),
                    difference: mean(Clusters::mean),
                    ci_low: finite(found.map(|found| found.interval.0)),
                    ci_high: finite(found.map(|found| found.interval.1)),
                    p: *p,
                    p_holm,
                    mde: finite(found.map(|found| found.detectable())),
                    verdict: verdict(
                        found,
                        p_holm,
                        group.iter().all(|c| c.all_equal() && c.n_pairs() > 0),
                        metric.direction == Direction::Higher,
                        practical.of(metric.key),
                    ),
                    left_out: *left_out,
                    merged_scenes: *merged,
                    p_sign_flip: found.and_then(|found| Some(found.sign_flip.as_ref()?.p)),
                    p_sign_flip_floor: found
                        .and_then(|found| Some(found.sign_flip.as_ref()?.floor)),
                    no_inference: inference.as_ref().err().copied(),
                    decimals: metric.decimals,
                }
            },
        );
        rows.collect()
    }
}
