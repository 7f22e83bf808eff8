//! Compares two runs, or two methods of one run, pair by pair, with the significance of each change.

pub mod anatomy;
pub mod breakdown;
pub mod flips;
pub mod page;
mod rows;
pub mod tables;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Serialize;
use sharp_metrics::identity::MetricRegion;
use sharp_metrics::{Direction, Family, MetricInfo, MetricKey};
use sharp_statistics::{NoInference, Resampling, Verdict};

use crate::evaluate::join::{join_results, label_under};
use crate::evaluate::manifest::Manifest;
use crate::evaluate::record::Record;
use crate::evaluate::{Aggregation, EvaluateError, Named, Results};
use crate::io::counts::counted;
use crate::pairs::pair_id::PairName;
use rows::Sides;

/// Name of the row over all datasets, which contains the unweighted mean of the datasets' means.
pub use crate::pairs::dataset::ALL_DATASETS as ALL;

/// Why two runs cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// A run cannot be read, or the two runs were scored under different rules.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// The runs differ in more than the compared methods.
    #[error("{} and {} cannot be compared: {difference}", a.display(), b.display())]
    Unlike {
        a: PathBuf,
        b: PathBuf,
        difference: String,
    },
    /// The methods to compare are ambiguous or do not exist.
    #[error("{0}")]
    Methods(String),
    /// The available weights differ from the weights of the runs.
    #[error("--anatomy: {0}; pass the runs' weights with --weights")]
    Anatomy(String),
}

/// Largest negligible difference of each metric family, in the metric's unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Practical(BTreeMap<Family, f64>);

impl Default for Practical {
    fn default() -> Self {
        let each = [
            (Family::Psnr, 0.05),
            (Family::Ssim, 0.001),
            (Family::Lpips, 0.001),
            (Family::Dists, 0.001),
        ];
        Self(each.into_iter().collect())
    }
}

impl Practical {
    pub fn set(&mut self, family: Family, value: f64) {
        self.0.insert(family, value);
    }

    fn of(&self, key: MetricKey) -> f64 {
        self.0.get(&key.family()).copied().unwrap_or_default()
    }
}

/// Scores of two methods under one metric, on one dataset. Differences are B − A; unknown and
/// non-finite values are null.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScoreChange {
    /// The dataset's name, or [`ALL`].
    pub dataset: String,
    /// Metric key without the region.
    pub metric: String,
    pub region: MetricRegion,
    pub method_a: String,
    pub method_b: String,
    /// Number of pairs with a score in both A and B.
    pub n_pairs: usize,
    /// Number of physical scenes of the pairs with a score in both A and B.
    pub n_scenes: usize,
    /// Number of pairs with an infinite score in A or B.
    pub n_infinite: usize,
    pub mean_a: f64,
    pub mean_b: f64,
    /// Mean of B minus A.
    pub difference: f64,
    /// Lower end of the 95 % confidence interval of the difference.
    pub ci_low: Option<f64>,
    /// Upper end of the 95 % confidence interval of the difference.
    pub ci_high: Option<f64>,
    /// p value of the difference, before Holm's correction.
    pub p: Option<f64>,
    /// p value after Holm's correction over the datasets of a metric, including [`ALL`].
    pub p_holm: Option<f64>,
    /// Minimum detectable effect: the smallest difference that would be detected with 80 % power at
    /// the 5 % level.
    pub mde: Option<f64>,
    /// Outcome of B relative to A.
    #[serde(serialize_with = "word")]
    pub verdict: Verdict,
    /// Number of planned pairs whose score is missing in A or B.
    #[serde(skip)]
    pub left_out: usize,
    /// Number of the dataset's scenes that show the same physical scene as an earlier scene of the
    /// dataset.
    #[serde(skip)]
    pub merged_scenes: usize,
    /// p of the sign-flip test over scenes, only for single datasets; exact for up to 14 scenes.
    pub p_sign_flip: Option<f64>,
    /// Smallest p that the sign-flip test can give with this number of scenes.
    pub p_sign_flip_floor: Option<f64>,
    /// Why confidence interval and p value are missing; `None` if they are not.
    #[serde(skip)]
    pub no_inference: Option<NoInference>,
    /// Number of decimals in tables.
    #[serde(skip)]
    pub decimals: usize,
}

pub fn verdict_word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Better => "better",
        Verdict::Worse => "worse",
        Verdict::None => "none",
        Verdict::Inconclusive => "inconclusive",
    }
}

pub(super) fn word<S: serde::Serializer>(
    verdict: &Verdict,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(verdict_word(*verdict))
}

/// A method of A and the method of B to compare with it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Against {
    pub a: String,
    pub b: String,
    /// Labels of the two methods in [`RunComparison::results`].
    pub joined: [String; 2],
}

#[derive(Debug, Clone)]
pub struct RunComparison {
    /// Path of run A, a folder or a bundle.
    pub a: PathBuf,
    pub b: PathBuf,
    pub against: Vec<Against>,
    /// Rows by methods, metric and dataset, in the order of the runs.
    pub rows: Vec<ScoreChange>,
    /// Notes that do not prevent the comparison, one line each.
    pub notes: Vec<String>,
    /// Seed and number of the resamples behind intervals and p values.
    pub resampling: Resampling,
    /// The results of both runs, joined.
    pub results: Results,
    pub manifests: [Manifest; 2],
}

/// A pair with a score in both A and B.
#[derive(Debug, Clone, Copy)]
pub struct PairChange<'a> {
    /// The pair's record in A.
    pub a: &'a Record,
    pub scores: [f64; 2],
    /// How much worse B is than A, in the metric's unit; negative if B is better, zero if both
    /// scores are the same infinity.
    pub loss: f64,
}

impl<'a> PairChange<'a> {
    fn new(metric: &MetricInfo, a: &'a Record, scores: [f64; 2]) -> Self {
        let [before, after] = scores;
        let loss = match metric.direction {
            _ if before == after => 0.0,
            Direction::Higher => before - after,
            Direction::Lower => after - before,
        };
        Self { a, scores, loss }
    }
}

impl RunComparison {
    /// The pairs with a score of a metric in both A and B, largest loss first, then by id. NaN counts as worse than any
    /// number.
    pub fn changes(&self, against: &Against, metric: &MetricInfo) -> Vec<PairChange<'_>> {
        let mut changes = self.sides(against).changes(metric);
        order_by_loss(&mut changes);
        changes
    }

    /// Whether any compared pair has pictures kept in both A and B.
    pub fn has_pictures(&self) -> bool {
        let is_kept = |record: &Record| self.results.kept_picture(record).is_some();
        let mut sides = self.against.iter().map(|against| self.sides(against));
        sides.any(|sides| sides.both().any(|(a, b)| is_kept(a) && is_kept(b)))
    }

    fn sides(&self, against: &Against) -> Sides<'_> {
        let [a, b] = &against.joined;
        Sides {
            a: of_method(&self.results, a),
            b: of_method(&self.results, b),
        }
    }
}

/// Sorts by loss, largest first; NaN comes first, regardless of its sign.
fn order_by_loss(changes: &mut [PairChange<'_>]) {
    let rank = |change: &PairChange<'_>| {
        if change.loss.is_nan() {
            f64::NAN.abs()
        } else {
            change.loss
        }
    };
    changes.sort_by(|one, other| {
        let by_loss = rank(other).total_cmp(&rank(one));
        by_loss.then_with(|| one.a.pair_id.cmp(&other.a.pair_id))
    });
}

/// Compares run B with run A. `methods` are pairs of labels `(in A, in B)`. If `methods` is empty,
/// compares methods with the same label or, if each run has only one method, these two.
///
/// # Errors
/// If a run cannot be read, or the runs differ in anything but the methods: metrics, scoring rules,
/// pairs, scored parts, renderer.
pub fn compare(
    a: &Path,
    b: &Path,
    methods: &[(String, String)],
    practical: &Practical,
) -> Result<RunComparison, CompareError> {
    let [of_a, of_b] = both_sides(a, b)?;
    compare_results([(a, of_a), (b, of_b)], methods, practical)
}

/// Reads runs A and B; if both paths are equal, reads the run once.
///
/// # Errors
/// If a run cannot be read.
pub fn both_sides(a: &Path, b: &Path) -> Result<[Results; 2], EvaluateError> {
    let of_a = Results::read(a)?;
    let of_b = if a == b {
        of_a.clone()
    } else {
        Results::read(b)?
    };
    Ok([of_a, of_b])
}

/// Compares results in memory by the rules of [`compare`]; the paths are only used in errors.
///
/// # Errors
/// If the results differ in anything but the methods.
pub fn compare_results(
    [(a, of_a), (b, of_b)]: [(&Path, Results); 2],
    methods: &[(String, String)],
    practical: &Practical,
) -> Result<RunComparison, CompareError> {
    let unlike = |difference: String| CompareError::Unlike {
        a: a.to_owned(),
        b: b.to_owned(),
        difference,
    };
    let manifests = [of_a.manifest.clone(), of_b.manifest.clone()];
    if let Some(difference) = backend_difference(&manifests) {
        return Err(unlike(difference));
    }
    let named = |name: &str, path: &Path| Named {
        name: Some(name.to_owned()),
        path: path.to_owned(),
    };
    // Fails if the results were scored under different rules.
    let joined = join_results([(named("A", a), of_a), (named("B", b), of_b)]);
    let results = joined.map_err(|error| match error {
        EvaluateError::Conflict { difference, .. } => unlike(difference),
        other => other.into(),
    })?;
    let [labels_a, labels_b] = [("A", &manifests[0]), ("B", &manifests[1])].map(side_labels);
    let against = chosen_methods(methods, &labels_a, &labels_b)?;
    let mut comparison = RunComparison {
        a: a.to_owned(),
        b: b.to_owned(),
        against,
        rows: Vec::new(),
        notes: notes(&manifests),
        resampling: Resampling::default(),
        results,
        manifests,
    };
    for against in comparison.against.clone() {
        let (rows, notes) = rows(&comparison, &against, practical).map_err(unlike)?;
        comparison.rows.extend(rows);
        comparison.notes.extend(notes);
    }
    Ok(comparison)
}

/// Rows and notes for two methods. The error is a difference that makes the methods incomparable.
fn rows(
    comparison: &RunComparison,
    against: &Against,
    practical: &Practical,
) -> Result<(Vec<ScoreChange>, Vec<String>), String> {
    let manifest = &comparison.results.manifest;
    let sides = comparison.sides(against);
    let [a, b] = &against.joined;
    let planned = [a, b].map(|label| planned_pairs(&comparison.results, label));
    if let Some(difference) = pair_difference(&planned) {
        return Err(difference);
    }
    if let Some(difference) = sides.region_difference() {
        return Err(difference);
    }
    let mut of_dataset: BTreeMap<String, usize> = BTreeMap::new();
    for id in &planned[0] {
        let record = sides.a.get(id).or_else(|| sides.b.get(id));
        let dataset = match record {
            Some(record) => Some(record.dataset.clone()),
            None => PairName::decode(id).ok().map(|name| name.dataset),
        };
        if let Some(dataset) = dataset {
            *of_dataset.entry(dataset).or_default() += 1;
        }
    }
    let datasets = manifest
        .datasets
        .iter()
        .map(|dataset| dataset.name.as_str());
    let datasets = datasets.filter_map(|name| Some((name, *of_dataset.get(name)?)));
    let datasets: Vec<(&str, usize)> = datasets.collect();
    let (mut rows, mut notes) = (Vec::new(), Vec::new());
    for metric in &manifest.metrics {
        let key = metric.info.key;
        let scores = |manifest: &Manifest| manifest.metrics.iter().any(|m| m.info.key == key);
        if !comparison.manifests.iter().all(scores) {
            notes.push(format!(
                "{key} is in only one of the runs and is not compared"
            ));
            continue;
        }
        let of_metric = sides.rows(&datasets, &metric.info, practical, comparison.resampling);
        rows.extend(of_metric.into_iter().map(|row| ScoreChange {
            method_a: against.a.clone(),
            method_b: against.b.clone(),
            ..row
        }));
    }
    Ok((rows, notes))
}

/// Describes a difference between the runs' rendering backends; `None` if there is no difference.
/// CPU backends count as equal, because their kernels change no visible digit of a score. All other
/// settings are compared when the results are joined.
fn backend_difference([a, b]: &[Manifest; 2]) -> Option<String> {
    let kind = |manifest: &Manifest| {
        if manifest.renderer.backend.starts_with("cpu-") {
            "cpu".to_owned()
        } else {
            manifest.renderer.backend.clone()
        }
    };
    let (a, b) = (kind(a), kind(b));
    (a != b).then(|| format!("the renderer is \"{a}\" in the first run and \"{b}\" in the second"))
}

fn notes([a, b]: &[Manifest; 2]) -> Vec<String> {
    let mut notes = Vec::new();
    if a.kernels != b.kernels {
        let (a, b) = (a.kernels.name(), b.kernels.name());
        notes.push(format!("the class of CPU kernels is {a} in A and {b} in B"));
    }
    if a.version != b.version {
        notes.push(format!(
            "A was made by version {} and B by {}",
            a.version, b.version
        ));
    } else if a.sources != b.sources {
        notes.push("A and B were made by builds of different source code".to_owned());
    }
    if a.aggregation != Aggregation::default() {
        let (here, there) = (Aggregation::default(), a.aggregation);
        notes.push(format!(
            "this comparison uses the {here}; the runs' own tables use the {there}"
        ));
    }
    notes
}

/// Labels in the joined results, keyed by the labels in the run.
fn side_labels((side, manifest): (&str, &Manifest)) -> BTreeMap<String, String> {
    let methods = &manifest.methods;
    let labels = methods.iter().map(|method| method.label.clone());
    labels
        .map(|own| (own.clone(), label_under(side, &own, methods.len())))
        .collect()
}

fn chosen_methods(
    asked: &[(String, String)],
    a: &BTreeMap<String, String>,
    b: &BTreeMap<String, String>,
) -> Result<Vec<Against>, CompareError> {
    let against = |old: &str, new: &str| Against {
        a: old.to_owned(),
        b: new.to_owned(),
        joined: [a[old].clone(), b[new].clone()],
    };
    let known = |labels: &BTreeMap<String, String>| {
        let labels: Vec<&str> = labels.keys().map(String::as_str).collect();
        labels.join(", ")
    };
    let sides = || format!("run A has {}; run B has {}", known(a), known(b));
    if let Some((old, new)) = asked
        .iter()
        .find(|(old, new)| !a.contains_key(old) || !b.contains_key(new))
    {
        let reason = format!(
            "--method {old}={new}: run A must have {old}, and run B must have {new}; {}",
            sides()
        );
        return Err(CompareError::Methods(reason));
    }
    if !asked.is_empty() {
        let mut chosen: Vec<Against> = Vec::new();
        for (old, new) in asked {
            let one = against(old, new);
            if !chosen.contains(&one) {
                chosen.push(one);
            }
        }
        return Ok(chosen);
    }
    let common = a.keys().filter(|label| b.contains_key(*label));
    let mut chosen: Vec<_> = common.map(|label| against(label, label)).collect();
    if let (true, Some(old), Some(new)) = (chosen.is_empty(), only(a), only(b)) {
        chosen.push(against(old, new));
    }
    if chosen.is_empty() {
        let reason = format!(
            "no method is in both runs ({}); pair two methods with --method OLD=NEW",
            sides()
        );
        return Err(CompareError::Methods(reason));
    }
    Ok(chosen)
}

fn only(labels: &BTreeMap<String, String>) -> Option<&String> {
    labels.keys().next().filter(|_| labels.len() == 1)
}

fn of_method<'a>(results: &'a Results, label: &str) -> BTreeMap<&'a str, &'a Record> {
    let records = results
        .records
        .iter()
        .filter(|record| record.method == label);
    records
        .map(|record| (record.pair_id.as_str(), record))
        .collect()
}

/// Ids of all planned pairs, done or not.
fn planned_pairs<'a>(results: &'a Results, label: &str) -> BTreeSet<&'a str> {
    let missing = results.missing.iter().filter(|(_, method)| method == label);
    let missing = missing.map(|(pair_id, _)| pair_id.as_str());
    of_method(results, label)
        .into_keys()
        .chain(missing)
        .collect()
}

fn pair_difference([a, b]: &[BTreeSet<&str>; 2]) -> Option<String> {
    let (only_a, only_b) = (a.difference(b).count(), b.difference(a).count());
    let first = a.symmetric_difference(b).next()?;
    // A run stores the whole list of pairs, even if `--limit` was used.
    let hint = match (only_a, only_b) {
        (0, _) | (_, 0) => "; if one run used --limit, run the other with the same limit",
        _ => "",
    };
    Some(format!(
        "their pairs differ ({} only in A, {} only in B; the first is {first}){hint}",
        counted(only_a, "pair"),
        only_b
    ))
}

#[cfg(test)]
mod tests;
