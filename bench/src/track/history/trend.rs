//! Scores from entry to entry, and the entries at which they changed.
//!
//! # Comparable entries
//! An entry continues a series from an earlier entry: the latest one that has the same photographs and can be
//! [compared](crate::track::compare) on the series' dataset under its metric. If this is not the previous entry, the
//! series is broken at this point and the reason is recorded. An entry that is comparable with no earlier one starts a
//! new part.
//!
//! # Change points
//! Both rules use the test of `compare` on the same pairs, at 0.05 after Holm's correction over the
//! compared datasets:
//! * [`Rule::Step`]: compares an entry with the one that it continues;
//! * [`Rule::Drift`]: if there is no step, compares the entry with the last change point of its part or, if there is
//!   none, with the start of the part. It finds slow changes, none of whose steps is significant, once they have
//!   accumulated.
//!
//! There is no correction over entries, metrics and methods: if scores differ by chance alone,
//! either rule marks one entry in twenty. Bit-identical scores are never a change.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

use serde::Serialize;
use sharp_statistics::{Clusters, Resampling, Verdict, infer};

use super::Entry;
use crate::evaluate::manifest::{MethodRecord, MetricRecord};
use crate::evaluate::record::Score;
use crate::evaluate::{EvaluateError, Results};
use crate::pairs::pair_id::PairName;
use crate::report::Column;
use crate::track::compare::{CompareError, Practical, ScoreChange, compare_results};

/// Number of hexadecimal digits shown of the weights' SHA-256.
const WEIGHTS_DIGITS: usize = 12;

/// Scores of one method on one dataset under one metric, over all entries.
#[derive(Debug, Clone)]
pub struct Series {
    /// Label of the method.
    pub method: String,
    pub dataset: String,
    pub metric: Column,
    /// The points in ascending order, one for each entry with a value.
    pub points: Vec<Point>,
}

/// A series' values at one entry of the history. Unknown and non-finite values are serialised as null.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    pub entry: u32,
    /// Label of the method.
    pub method: String,
    pub dataset: String,
    /// Metric key with variant and region.
    pub metric: String,
    /// Number of pairs with a score.
    pub n_pairs: usize,
    /// Number of planned pairs.
    pub n_planned: usize,
    /// Number of pairs with a failed prediction.
    pub n_failed: usize,
    /// Number of physical scenes of the pairs with a score.
    pub n_scenes: usize,
    /// Mean over the pairs with a score; `None` if no pair has a score.
    pub mean: Option<f64>,
    /// Lower end of the 95 % confidence interval of the mean, with scenes as the sample.
    pub ci_low: Option<f64>,
    /// Upper end of the 95 % confidence interval of the mean.
    pub ci_high: Option<f64>,
    /// First digits of the SHA-256 of the method's weights; empty without weights.
    pub weights: String,
    /// The method's identity as text: its kind and everything else that determines its predictions.
    pub identity: String,
    /// Number of the entry that this point is compared with; `None` at the start of a part of the series.
    pub follows: Option<u32>,
    /// Why the point is not comparable with the previous entry.
    pub broken: Option<String>,
    /// How the scores changed, if the entry is a change point; otherwise `None`.
    pub change: Option<Mark>,
}

/// A change point: an entry that is better or worse than an earlier one, by one of the rules.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mark {
    /// Whether the entry is better or worse than `against`.
    #[serde(serialize_with = "crate::track::compare::word")]
    pub verdict: Verdict,
    pub rule: Rule,
    /// Number of the entry that this entry is compared with.
    pub against: u32,
    /// Mean difference of this entry minus `against`, over pairs with a score in both.
    pub difference: f64,
    /// p after Holm's correction.
    pub p: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    Step,
    Drift,
}

/// A series under construction.
#[derive(Debug)]
struct Growing {
    series: Series,
    /// Parts of the series in the order of their first entries.
    parts: Vec<Stretch>,
}

/// A part of a series whose entries can be compared with each other.
#[derive(Debug)]
struct Stretch {
    last: Arc<Entry>,
    /// The part's last change point or, without one, its first entry.
    reference: Arc<Entry>,
}

/// All series, updated entry by entry. An entry is kept in memory only as long as later entries may be compared with
/// it.
#[derive(Debug, Default)]
pub(super) struct Trend(Vec<Growing>);

impl Trend {
    pub(super) fn add(&mut self, entry: Entry) {
        let entry = Arc::new(entry);
        let manifest = &entry.bundle.results.manifest;
        for method in &manifest.methods {
            for metric in &manifest.metrics {
                self.add_scores(&entry, method, metric);
            }
        }
    }

    /// The finished series, sorted by metric, dataset and method.
    pub(super) fn into_series(self) -> Vec<Series> {
        let place = |name: fn(&Series) -> &str| {
            let mut places = BTreeMap::new();
            for growing in &self.0 {
                let next = places.len();
                places
                    .entry(name(&growing.series).to_owned())
                    .or_insert(next);
            }
            places
        };
        let metrics = place(|series| &series.metric.key);
        let (datasets, methods) = (place(|s| &s.dataset), place(|s| &s.method));
        let mut series: Vec<Series> = self.0.into_iter().map(|growing| growing.series).collect();
        series.sort_by_key(|s| {
            (
                metrics[&s.metric.key],
                datasets[&s.dataset],
                methods[&s.method],
            )
        });
        series
    }

    /// Adds the scores of a method under a metric on all datasets, which are tested together.
    fn add_scores(&mut self, entry: &Arc<Entry>, method: &MethodRecord, metric: &MetricRecord) {
        let scope = MethodMetric { method, metric };
        let datasets = entry.bundle.results.manifest.datasets.iter();
        let points = datasets.filter_map(|dataset| scope.point(entry, &dataset.name));
        let mut points: BTreeMap<usize, Point> = points
            .map(|point| (self.series_of(&point, metric), point))
            .collect();
        let mut open: BTreeSet<usize> = points.keys().copied().collect();
        // A point without a score neither changes nor interrupts a series.
        open.retain(|at| points[at].n_pairs > 0);
        // For each point, the index of the part of its series that the point continues.
        let mut continued: BTreeMap<usize, usize> = BTreeMap::new();
        let mut earlier: BTreeMap<u32, Arc<Entry>> = BTreeMap::new();
        for part in open.iter().flat_map(|at| &self.0[*at].parts) {
            earlier.insert(part.last.number, Arc::clone(&part.last));
        }
        for (number, before) in earlier.into_iter().rev() {
            let ends = |part: &Stretch| part.last.number == number;
            let parts = open.iter().filter_map(|at| {
                let part = self.0[*at].parts.iter().position(ends)?;
                Some((*at, part))
            });
            let parts: BTreeMap<usize, usize> = parts.collect();
            let found = scope.compare(&before, entry, &self.names(parts.keys()));
            for (at, part) in parts {
                let Some(point) = points.get_mut(&at) else {
                    continue;
                };
                if let Some(reason) = found.broken.get(&self.0[at].series.dataset) {
                    let broken = format!("not comparable with entry {number}: {reason}");
                    point.broken.get_or_insert(broken);
                    continue;
                }
                point.follows = Some(number);
                point.change = found.mark(&self.0[at].series.dataset, Rule::Step, number);
                open.remove(&at);
                continued.insert(at, part);
            }
        }
        self.find_drift(&scope, entry, &continued, &mut points);
        for (at, point) in points {
            let part = Stretch {
                last: Arc::clone(entry),
                reference: Arc::clone(entry),
            };
            let Growing { series, parts } = &mut self.0[at];
            match continued.get(&at) {
                Some(&before) if point.change.is_none() => parts[before].last = part.last,
                Some(&before) => parts[before] = part,
                None if point.n_pairs > 0 => parts.push(part),
                None => {}
            }
            series.points.push(point);
        }
    }

    /// Marks points that are not a step but differ from the reference of their part of the series.
    fn find_drift(
        &self,
        scope: &MethodMetric<'_>,
        entry: &Entry,
        continued: &BTreeMap<usize, usize>,
        points: &mut BTreeMap<usize, Point>,
    ) {
        let mut references: BTreeMap<u32, (Arc<Entry>, Vec<usize>)> = BTreeMap::new();
        for (at, part) in continued {
            let Stretch { last, reference } = &self.0[*at].parts[*part];
            if points[at].change.is_none() && reference.number != last.number {
                let group = references.entry(reference.number);
                let group = group.or_insert_with(|| (Arc::clone(reference), Vec::new()));
                group.1.push(*at);
            }
        }
        for (number, (reference, group)) in references {
            let found = scope.compare(&reference, entry, &self.names(&group));
            for at in group {
                if let Some(point) = points.get_mut(&at) {
                    point.change = found.mark(&self.0[at].series.dataset, Rule::Drift, number);
                }
            }
        }
    }

    fn names<'a>(&self, series: impl IntoIterator<Item = &'a usize>) -> Vec<&str> {
        let series = series.into_iter();
        series
            .map(|at| self.0[*at].series.dataset.as_str())
            .collect()
    }

    /// Index of a point's series, which is created if needed.
    fn series_of(&mut self, point: &Point, metric: &MetricRecord) -> usize {
        let known = self.0.iter().position(|Growing { series, .. }| {
            (&series.method, &series.dataset, &series.metric.key)
                == (&point.method, &point.dataset, &point.metric)
        });
        known.unwrap_or_else(|| {
            let series = Series {
                method: point.method.clone(),
                dataset: point.dataset.clone(),
                metric: Column::from(&metric.info),
                points: Vec::new(),
            };
            self.0.push(Growing {
                series,
                parts: Vec::new(),
            });
            self.0.len() - 1
        })
    }
}

/// A method and a metric, whose scores are looked up in the entries.
struct MethodMetric<'a> {
    method: &'a MethodRecord,
    metric: &'a MetricRecord,
}

/// Comparison of two entries: score changes, or the reasons why datasets cannot be compared.
#[derive(Default)]
struct Compared {
    rows: Vec<ScoreChange>,
    /// Reasons why datasets cannot be compared, by dataset.
    broken: BTreeMap<String, String>,
}

impl Compared {
    fn mark(&self, dataset: &str, rule: Rule, against: u32) -> Option<Mark> {
        let row = self.rows.iter().find(|row| row.dataset == dataset)?;
        let changed = matches!(row.verdict, Verdict::Better | Verdict::Worse);
        changed.then_some(Mark {
            verdict: row.verdict,
            rule,
            against,
            difference: row.difference,
            p: row.p_holm,
        })
    }
}

impl MethodMetric<'_> {
    /// The point of a dataset; `None` if the method has no pair in it.
    fn point(&self, entry: &Entry, dataset: &str) -> Option<Point> {
        let key = self.metric.info.key.to_string();
        let of_dataset = self.of(&entry.bundle.results, &[dataset]);
        let records = of_dataset.records.iter();
        let scores = records.filter_map(|record| {
            let value = record.scores.get(&key).and_then(Score::value)?;
            Some((record.cluster.as_str(), [0.0, value]))
        });
        // The mean is treated as a difference from zero.
        let sample = Clusters::new(scores);
        let interval = infer(&[&sample], Resampling::default()).map(|found| found.interval);
        let (low, high) = interval.unwrap_or((f64::NAN, f64::NAN));
        let finite = |value: f64| Some(value).filter(|value| value.is_finite());
        let identity = &self.method.identity;
        let is_sha256 =
            |text: &&String| text.len() == 64 && text.bytes().all(|c| c.is_ascii_hexdigit());
        let weights = identity.settings.values().filter(is_sha256);
        let weights: Vec<&str> = weights.map(|hash| &hash[..WEIGHTS_DIGITS]).collect();
        let point = Point {
            entry: entry.number,
            method: self.method.label.clone(),
            dataset: dataset.to_owned(),
            n_pairs: sample.n_pairs(),
            n_planned: of_dataset.records.len() + of_dataset.missing.len(),
            n_failed: of_dataset.failures(),
            n_scenes: sample.n_clusters(),
            mean: (sample.n_pairs() > 0).then(|| sample.mean()),
            ci_low: finite(low),
            ci_high: finite(high),
            weights: weights.join(" "),
            identity: identity.to_string(),
            metric: key,
            follows: None,
            broken: None,
            change: None,
        };
        (point.n_planned > 0).then_some(point)
    }

    /// The part of `all` that has results of this method and metric on `datasets`.
    fn of(&self, all: &Results, datasets: &[&str]) -> Results {
        let is_ours = |dataset: &str, method: &str| {
            method == self.method.label && datasets.contains(&dataset)
        };
        let mut manifest = all.manifest.clone();
        manifest.methods.retain(|m| m.label == self.method.label);
        let key = self.metric.info.key;
        manifest.metrics.retain(|metric| metric.info.key == key);
        manifest
            .datasets
            .retain(|dataset| datasets.contains(&dataset.name.as_str()));
        let records = all.records.iter();
        let missing = all.missing.iter().filter(|(pair, method)| {
            PairName::decode(pair).is_ok_and(|name| is_ours(&name.dataset, method))
        });
        Results {
            manifest,
            records: records
                .filter(|record| is_ours(&record.dataset, &record.method))
                .cloned()
                .collect(),
            missing: missing.cloned().collect(),
            pictures: Vec::new(),
            damaged: Vec::new(),
            methods_listed: true,
        }
    }

    /// Compares entry `b` with `a` on common datasets. A dataset that cannot be compared does not
    /// affect other datasets.
    fn compare(&self, a: &Entry, b: &Entry, datasets: &[&str]) -> Compared {
        let compared = |datasets: &[&str]| -> Result<Vec<ScoreChange>, String> {
            if let Some(pair) = other_photographs(a, b, datasets) {
                return Err(format!("the photographs of {pair} differ"));
            }
            let path = |entry: &Entry| PathBuf::from(format!("entry {}", entry.number));
            let [of_a, of_b] = [a, b].map(|entry| self.of(&entry.bundle.results, datasets));
            let runs = [(&*path(a), of_a), (&*path(b), of_b)];
            match compare_results(runs, &[], &Practical::default()) {
                Ok(comparison) => Ok(comparison.rows),
                Err(
                    CompareError::Unlike { difference, .. }
                    | CompareError::Evaluate(EvaluateError::Conflict { difference, .. }),
                ) => Err(difference),
                Err(other) => Err(other.to_string()),
            }
        };
        let mut found = Compared::default();
        if datasets.is_empty() {
            return found;
        }
        let reason = match compared(datasets) {
            Ok(rows) => {
                found.rows = rows;
                return found;
            }
            Err(reason) => reason,
        };
        if let [dataset] = datasets {
            found.broken.insert((*dataset).to_owned(), reason);
            return found;
        }
        let mut rest = Vec::new();
        for dataset in datasets {
            match compared(&[dataset]) {
                Ok(_) => rest.push(*dataset),
                Err(reason) => {
                    found.broken.insert((*dataset).to_owned(), reason);
                }
            }
        }
        if let Ok(rows) = compared(&rest) {
            found.rows = rows;
        }
        found
    }
}

/// The first pair in `datasets` whose photographs differ between the entries.
fn other_photographs<'a>(a: &'a Entry, b: &Entry, datasets: &[&str]) -> Option<&'a str> {
    let (a, b) = (&a.bundle.pairs, &b.bundle.pairs);
    if a.sha256 == b.sha256 {
        return None;
    }
    let now: BTreeMap<&str, _> = b.pairs.iter().map(|p| (p.pair_id.as_str(), p)).collect();
    let differ = |one: &str, other: &str| !one.is_empty() && !other.is_empty() && one != other;
    let other = a.pairs.iter().find(|pair| {
        let now = now.get(pair.pair_id.as_str());
        datasets.contains(&pair.dataset.as_str())
            && now.is_some_and(|now| {
                differ(&pair.source_sha256, &now.source_sha256)
                    || differ(&pair.target_sha256, &now.target_sha256)
            })
    });
    other.map(|pair| pair.pair_id.as_str())
}
