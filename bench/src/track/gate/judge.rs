//! Applies the limits of a gate to a comparison.

use std::collections::BTreeMap;
use std::path::Path;

use sharp_metrics::{Direction, MetricInfo, MetricKey};
use sharp_statistics::{ALPHA, NoInference};

use super::config::{Limit, MetricName, Scope};
use super::cost::costs_of;
use super::{Check, CheckState, GateConfig, GateError, GateReport, WorsePair, fired};
use crate::evaluate::bundle::timings;
use crate::evaluate::record::{Record, Score, Status};
use crate::io::counts::counted;
use crate::track::compare::breakdown::Division;
use crate::track::compare::{ALL, Against, RunComparison, ScoreChange};

/// Maximum number of worsened pairs shown.
const WORST: usize = 3;

/// Judges a comparison of run B with run A, whose folders are `a` and `b`: coverage, limits on scores, limits on costs.
///
/// # Errors
/// If a limit names a metric or a dataset that the runs do not have, or times cannot be read.
pub(super) fn judge(
    comparison: &RunComparison,
    config: &GateConfig,
    [a, b]: [&Path; 2],
) -> Result<GateReport, GateError> {
    let judge = Judge::new(comparison, config)?;
    let coverage = comparison.against.iter().flat_map(|a| judge.coverage(a));
    let mut judged: Vec<Judged<'_>> = coverage.map(|check| (check, None)).collect();
    judged.extend(judge.scores());
    let of_costs = |limit: &Limit| matches!(limit, Limit::Cost { .. });
    if config.fail_if.iter().any(of_costs) {
        for against in &comparison.against {
            let sides = [timings(a, &against.a)?, timings(b, &against.b)?];
            let checks = costs_of(comparison, config, against, &sides);
            judged.extend(checks.into_iter().map(|check| (check, None)));
        }
    }
    let (worst_of, worst) = judge.worst_pairs(&judged);
    let checks: Vec<Check> = judged.into_iter().map(|(check, _)| check).collect();
    let states = checks.iter().map(|check| check.state);
    let severe = states.filter(|state| *state >= CheckState::Inconclusive);
    Ok(GateReport {
        a: a.to_owned(),
        b: b.to_owned(),
        state: severe.max().unwrap_or(CheckState::Passed),
        checks,
        worst_of,
        worst,
        notes: notes_of(comparison),
    })
}

/// A check, and the subject of the check if it concerns a metric.
type Judged<'a> = (Check, Option<Subject<'a>>);

struct Judge<'a> {
    comparison: &'a RunComparison,
    config: &'a GateConfig,
    /// Metrics that both runs have.
    metrics: Vec<&'a MetricInfo>,
    datasets: Vec<&'a str>,
}

/// What a limit on a metric is applied to: two methods and one variant of the metric.
#[derive(Clone, Copy)]
struct Subject<'a> {
    limit: &'a Limit,
    against: &'a Against,
    info: &'a MetricInfo,
    bound: f64,
    either_way: bool,
}

impl Subject<'_> {
    /// How much worse B is for this limit: positive if B is worse or, if improvements also count,
    /// the size of the difference.
    fn loss(&self, difference: f64) -> f64 {
        match self.info.direction {
            _ if self.either_way => difference.abs(),
            Direction::Higher => -difference,
            Direction::Lower => difference,
        }
    }

    /// Whether a difference exceeds the bound; true for NaN.
    fn is_beyond(&self, difference: f64) -> bool {
        difference.is_nan() || self.loss(difference) > self.bound
    }

    fn check(&self, dataset: &str) -> Check {
        let key = self.info.key.to_string();
        Check::of(self.limit.to_string(), &key, self.against, dataset)
    }

    /// One decimal more than for single scores, because means of many pairs are compared here.
    fn decimals(&self) -> usize {
        self.info.decimals + 1
    }
}

impl<'a> Judge<'a> {
    /// Checks that the limits fit the runs.
    ///
    /// # Errors
    /// If a limit names a metric or a dataset that the runs do not have.
    fn new(comparison: &'a RunComparison, config: &'a GateConfig) -> Result<Self, GateError> {
        let [a, b] = &comparison.manifests;
        let of_both = a.metrics.iter().map(|metric| &metric.info);
        let of_both = of_both.filter(|info| b.metrics.iter().any(|m| m.info.key == info.key));
        let datasets = comparison.results.manifest.datasets.iter();
        let judge = Self {
            comparison,
            config,
            metrics: of_both.collect(),
            datasets: datasets.map(|dataset| dataset.name.as_str()).collect(),
        };
        judge.check_names().map_err(GateError::Limits)?;
        Ok(judge)
    }

    fn check_names(&self) -> Result<(), String> {
        for limit in &self.config.fail_if {
            let Limit::Score { metric, scope, .. } = limit else {
                continue;
            };
            if self.named(*metric).next().is_none() {
                let have: Vec<&str> = self.metrics.iter().map(|m| m.alias.as_str()).collect();
                let have = have.join(", ");
                return Err(format!(
                    "'{limit}' needs a metric that both runs have: {have}"
                ));
            }
            let known = |name: &str| name == ALL || self.datasets.contains(&name);
            if let Some(name) = scope.dataset().filter(|name| !known(name)) {
                let have = self.datasets.join(", ");
                return Err(format!(
                    "'{limit}': the runs have no dataset '{name}'; expected {have} or {ALL}"
                ));
            }
        }
        for (name, required) in &self.config.require_power {
            if !(required.is_finite() && *required > 0.0) {
                return Err(format!(
                    "require_power for {name} is {required}, but must be a number above 0"
                ));
            }
            let is_tested = |limit: &Limit| match limit {
                Limit::Score { metric, scope, .. } => {
                    !matches!(scope, Scope::PerScene(_))
                        && self.named(*metric).any(|info| name.names(info))
                }
                Limit::Cost { .. } => false,
            };
            if !self.config.fail_if.iter().any(is_tested) {
                return Err(format!(
                    "require_power is set for {name}, but no limit on {name} tests significance"
                ));
            }
        }
        Ok(())
    }

    fn named(&self, name: MetricName) -> impl Iterator<Item = &'a MetricInfo> {
        let metrics = self.metrics.iter().copied();
        metrics.filter(move |info| name.names(info))
    }

    /// Applies all limits on scores.
    fn scores(&self) -> Vec<Judged<'a>> {
        let mut judged = Vec::new();
        for limit in &self.config.fail_if {
            let Limit::Score {
                metric,
                bound,
                either_way,
                scope,
            } = limit
            else {
                continue;
            };
            for against in &self.comparison.against {
                for info in self.named(*metric) {
                    let subject = Subject {
                        limit,
                        against,
                        info,
                        bound: *bound,
                        either_way: *either_way,
                    };
                    let checks = match scope {
                        Scope::PerScene(_) => self.scenes(subject, scope.dataset()),
                        _ => self.rows(subject, scope.dataset()),
                    };
                    judged.extend(checks.into_iter().map(|check| (check, Some(subject))));
                }
            }
        }
        judged
    }

    /// Checks each dataset for pairs that have a score in A but none, or NaN, in B.
    fn coverage(&self, against: &Against) -> Vec<Check> {
        let [a, b] = against.joined.each_ref().map(|label| {
            let records = self.comparison.results.records.iter();
            let own = records.filter(move |record| record.method == *label);
            own.map(|record| (record.pair_id.as_str(), record))
                .collect::<BTreeMap<_, _>>()
        });
        let mut checks = Vec::new();
        for &dataset in &self.datasets {
            let (mut scored, mut lost) = (0_usize, Vec::new());
            for (pair_id, record) in &a {
                let mut keys = self.metrics.iter().map(|info| info.key.to_string());
                let has = |key: &String| number(record, key).is_some();
                if record.dataset != dataset || !keys.clone().any(|key| has(&key)) {
                    continue;
                }
                scored += 1;
                let now = b.get(pair_id);
                let without = keys
                    .find(|key| has(key) && now.and_then(|record| number(record, key)).is_none());
                if let Some(key) = without {
                    lost.push(format!("{pair_id}: {}", why_absent(now.copied(), &key)));
                }
            }
            if scored == 0 {
                continue;
            }
            let reason = lost.first().map_or_else(String::new, |first| {
                let pairs = counted(lost.len(), "pair");
                format!("{pairs} with a score in A but not in B; the first is {first}")
            });
            let allowed = self.config.missing_pairs;
            let limit = format!("missing_pairs > {allowed}");
            let kept = (scored - lost.len()) as f64;
            let check = Check::of(limit, "missing_pairs", against, dataset)
                .measured(scored as f64, kept, 0.0 - lost.len() as f64, 0)
                .decided(fired(lost.len() > allowed), reason);
            checks.push(check);
        }
        checks
    }

    /// Applies a limit to datasets' means.
    fn rows(&self, subject: Subject<'_>, dataset: Option<&str>) -> Vec<Check> {
        let Subject { against, info, .. } = subject;
        let is_one = self.datasets.len() == 1;
        let places = self.datasets.iter().copied();
        let places = places.chain((!is_one).then_some(ALL));
        let places = places.filter(|place| match dataset {
            Some(name) => name == *place || (is_one && name == ALL),
            None => true,
        });
        let metric = MetricKey::whole(info.key.metric()).to_string();
        let of_metric = |row: &&ScoreChange| {
            (&row.method_a, &row.method_b) == (&against.a, &against.b)
                && (&row.metric, row.region) == (&metric, info.region)
        };
        let checks = places.filter_map(|place| {
            let check = subject.check(place);
            let rows = self.comparison.rows.iter().filter(of_metric);
            let mut rows = rows.filter(|row| row.no_inference != Some(NoInference::NoPairs));
            let Some(row) = rows.find(|row| row.dataset == place) else {
                // Methods need not cover the same datasets, so scores are required only where A has
                // scores.
                let is_asked =
                    dataset.is_some() || self.has_scores(&against.joined[0], info, place);
                return is_asked.then(|| unscored(check));
            };
            let (state, reason) = if !subject.is_beyond(row.difference) {
                (CheckState::Passed, String::new())
            } else if !row.difference.is_finite() {
                (CheckState::Fired, not_finite(row.difference))
            } else if row.p_holm.is_some_and(|p| p < ALPHA) {
                (CheckState::Fired, String::new())
            } else {
                (CheckState::NotSignificant, why_not_significant(row))
            };
            let (state, reason) = match self.lacks_power(info, row) {
                Some(reason) if state != CheckState::Fired => (CheckState::Inconclusive, reason),
                _ => (state, reason),
            };
            let check = check
                .measured(row.mean_a, row.mean_b, row.difference, subject.decimals())
                .decided(state, reason);
            Some(Check {
                ci_low: row.ci_low,
                ci_high: row.ci_high,
                p_holm: row.p_holm,
                mde: row.mde,
                ..check
            })
        });
        let checks: Vec<Check> = checks.collect();
        if checks.is_empty() {
            vec![unscored(subject.check(ALL))]
        } else {
            checks
        }
    }

    fn has_scores(&self, label: &str, info: &MetricInfo, dataset: &str) -> bool {
        let key = info.key.to_string();
        self.comparison.results.records.iter().any(|record| {
            record.method == label && record.dataset == dataset && number(record, &key).is_some()
        })
    }

    /// Why a row's data do not suffice for `require_power`, that is, to detect a difference of the required size.
    /// `None` if the data suffice, if no power is required, or if A and B are equal, because there is nothing to
    /// detect.
    fn lacks_power(&self, info: &MetricInfo, row: &ScoreChange) -> Option<String> {
        let required = self.config.require_power.iter();
        let required = required.filter(|(name, _)| name.names(info));
        let required = required.map(|(_, d)| *d).fold(f64::INFINITY, f64::min);
        let is_equal = row.difference == 0.0 && row.p == Some(1.0) && row.ci_low == row.ci_high;
        if is_equal || required.is_infinite() {
            return None;
        }
        let scenes = counted(row.n_scenes, "scene");
        match row.mde {
            Some(mde) if mde <= required => None,
            Some(mde) => {
                let decimals = info.decimals + 1;
                Some(format!(
                    "{scenes} can detect {mde:.decimals$}, not the required {required}"
                ))
            }
            None => Some(format!(
                "the detectable difference of {scenes} is unknown; {required} is required"
            )),
        }
    }

    /// Applies a limit to each scene. Returns all checks that fired or, if none did, the check that came closest to
    /// firing.
    fn scenes(&self, subject: Subject<'_>, dataset: Option<&str>) -> Vec<Check> {
        let place = dataset.unwrap_or(ALL);
        let strata = self.comparison.breakdown(subject.against, subject.info);
        let scenes = strata
            .into_iter()
            .filter(|part| part.by == Division::Scene && (place == ALL || part.dataset == place));
        let checks = scenes.map(|scene| {
            let reason = if scene.difference.is_finite() {
                String::new()
            } else {
                not_finite(scene.difference)
            };
            let check = subject
                .check(&scene.dataset)
                .measured(
                    scene.mean_a,
                    scene.mean_b,
                    scene.difference,
                    subject.decimals(),
                )
                .decided(fired(subject.is_beyond(scene.difference)), reason);
            Check {
                scene: Some(scene.stratum),
                ..check
            }
        });
        let mut checks: Vec<Check> = checks.collect();
        if checks.is_empty() {
            return vec![unscored(subject.check(place))];
        }
        let loss = |check: &Check| subject.loss(check.difference.unwrap_or_default());
        checks.sort_by(|one, other| loss(other).total_cmp(&loss(one)));
        let is_fired = |check: &&Check| check.state == CheckState::Fired;
        let fired = checks.iter().filter(is_fired).count();
        let scenes = counted(checks.len(), "scene");
        checks.truncate(fired.max(1));
        if fired == 0 {
            checks[0].reason = format!("the worst of {scenes}");
        }
        checks
    }

    /// The pairs with the largest losses, for the first fired check on a metric; if none fired, for
    /// the first check on a metric.
    fn worst_pairs(&self, judged: &[Judged<'_>]) -> (Option<usize>, Vec<WorsePair>) {
        let on_metrics = judged.iter().enumerate();
        let mut on_metrics =
            on_metrics.filter_map(|(at, (check, subject))| Some((at, check, (*subject)?)));
        let first = on_metrics.clone().next();
        let fired = on_metrics.find(|(_, check, _)| check.state == CheckState::Fired);
        let Some((at, check, subject)) = fired.or(first) else {
            return (None, Vec::new());
        };
        let size = |loss: f64| if subject.either_way { loss.abs() } else { loss };
        let mut changes = self.comparison.changes(subject.against, subject.info);
        changes.retain(|change| {
            (check.dataset == ALL || check.dataset == change.a.dataset)
                && check.scene.as_ref().is_none_or(|s| *s == change.a.scene)
                && (size(change.loss) > 0.0 || change.loss.is_nan())
        });
        changes.sort_by(|one, other| size(other.loss).total_cmp(&size(one.loss)));
        let worst = changes.into_iter().take(WORST).map(|change| WorsePair {
            pair_id: change.a.pair_id.clone(),
            a: change.scores[0],
            b: change.scores[1],
            loss: change.loss,
        });
        (Some(at), worst.collect())
    }
}

fn notes_of(comparison: &RunComparison) -> Vec<String> {
    let damaged = comparison.results.damaged.iter().map(|path| {
        let path = path.display();
        format!(
            "{path} is damaged, so its result (one method on one pair) counts as missing; `run` with the same options recomputes it"
        )
    });
    comparison.notes.iter().cloned().chain(damaged).collect()
}

fn unscored(check: Check) -> Check {
    check.decided(
        CheckState::Inconclusive,
        "no pair has a score in both A and B",
    )
}

fn not_finite(difference: f64) -> String {
    if difference.is_nan() {
        "scores are NaN, or infinite differences cancel, so the mean is not a number".to_owned()
    } else {
        "a score is infinite on one side only".to_owned()
    }
}

fn why_not_significant(row: &ScoreChange) -> String {
    match row.no_inference {
        Some(NoInference::OneCluster) if row.n_scenes > 1 => {
            "beyond the limit, but a dataset has a single scene, which does not show how scenes vary"
                .to_owned()
        }
        Some(NoInference::OneCluster) => {
            "beyond the limit, but one scene does not show how scenes vary".to_owned()
        }
        Some(reason) => format!("beyond the limit, but without p: {reason}"),
        None => {
            let scenes = counted(row.n_scenes, "scene");
            format!("beyond the limit, but with {scenes} this may be chance")
        }
    }
}

/// The score of a record under `key`; `None` if it is missing or NaN.
fn number(record: &Record, key: &str) -> Option<f64> {
    let value = record.scores.get(key).and_then(Score::value);
    value.filter(|value| !value.is_nan())
}

fn why_absent(record: Option<&Record>, key: &str) -> String {
    match record {
        None => "not evaluated".to_owned(),
        Some(record) => match (&record.status, record.scores.get(key)) {
            (Status::Failed { reason }, _) => reason.clone(),
            (_, Some(Score::Unavailable { unavailable })) => format!("{key}: {unavailable}"),
            (_, Some(Score::Value(value))) => format!("{key} is {value}"),
            (_, None) => format!("no {key}"),
        },
    }
}
