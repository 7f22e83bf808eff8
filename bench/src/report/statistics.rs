//! Mean, spread and coverage of one metric over the pairs of one dataset, from the raw records.

use std::collections::BTreeMap;

use sharp_statistics::distributions::t_critical;
use sharp_statistics::{ALPHA, Clusters, Jackknife, mean, sample_std};

use crate::evaluate::record::{Record, Score, Status};

use super::board::DatasetBoard;

#[derive(Debug, Clone, Default, PartialEq)]
pub struct CellStatistics {
    /// Number of pairs with a score.
    pub n: usize,
    /// Number of pairs in the dataset.
    pub total: usize,
    /// Mean over the pairs with a score (added up in the order of their ids), by the dataset's
    /// [`Aggregation`](crate::evaluate::Aggregation). Infinite if any score is infinite; `None` if there are no scores.
    pub mean: Option<f64>,
    /// Sample standard deviation over pairs (divisor n − 1). `None` for fewer than two scores, or if a score is
    /// infinite.
    pub std: Option<f64>,
    /// Mean score of each physical scene, in the order of the scenes' names.
    pub scenes: Vec<f64>,
    /// Spread over scenes. `None` if there is only one scene or a score is infinite.
    pub spread: Option<Spread>,
    pub infinite: usize,
    /// Mean over the finite scores; `None` if there are none.
    pub finite_mean: Option<f64>,
    /// Reasons for failed predictions with their counts, in the order of their first occurrence.
    pub failures: Vec<(String, usize)>,
    /// Reasons for missing scores of successful predictions, with their counts, in the order of their first occurrence.
    pub absences: Vec<(String, usize)>,
    /// Indices of the pairs with a score in the dataset's list of pairs.
    pub scored: Vec<usize>,
}

/// Uncertainty shown as ± after a mean. It is computed over scenes rather than pairs, as in `compare`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Uncertainty {
    /// Standard deviation of the scenes' means
    Sd,
    /// Standard error of the mean
    Se,
    /// Half the width of the mean's 95 % confidence interval
    Ci95,
}

impl Uncertainty {
    /// Heading of a CSV column.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sd => "sd_scenes",
            Self::Se => "se",
            Self::Ci95 => "ci95",
        }
    }

    /// The sentence that explains the uncertainty below a table.
    pub fn sentence(self) -> &'static str {
        match self {
            Self::Sd => {
                "±: standard deviation (n − 1) of the scenes' means; absent for a single scene."
            }
            Self::Se => {
                "±: standard error of the mean, with scenes as the sample (cluster jackknife CV3); absent for a single \
                 scene."
            }
            Self::Ci95 => {
                "±: half the width of the mean's 95 % confidence interval, with scenes as the sample (Student's t over \
                 the cluster jackknife CV3); absent for a single scene."
            }
        }
    }
}

/// Spread of a mean over physical scenes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Number of physical scenes.
    pub scenes: usize,
    sd: f64,
    se: f64,
    ci95: f64,
}

impl Spread {
    pub fn of(&self, uncertainty: Uncertainty) -> f64 {
        match uncertainty {
            Uncertainty::Sd => self.sd,
            Uncertainty::Se => self.se,
            Uncertainty::Ci95 => self.ci95,
        }
    }

    /// Computes the spread of the unweighted mean of `units`, each given with its scene; `scenes` are the scenes'
    /// means. `None` if there are fewer than two scenes or a value is not finite.
    fn new(units: &[(&str, f64)], scenes: &[f64]) -> Option<Self> {
        let sd = sample_std(scenes)?;
        let clusters = Clusters::new(units.iter().map(|(scene, value)| (*scene, [0.0, *value])));
        let jackknife = Jackknife::new(&clusters);
        let se = jackknife.variance.sqrt();
        let reach = if se > 0.0 {
            t_critical(ALPHA, jackknife.degrees_of_freedom)
        } else {
            0.0
        };
        Some(Self {
            scenes: scenes.len(),
            sd,
            se,
            ci95: se * reach,
        })
    }
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
                let reasons = if failed {
                    &mut cell.failures
                } else {
                    &mut cell.absences
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
    let units = aggregation.units(values.iter().copied()).into_iter();
    let units: Vec<(&str, f64)> = units
        .map(|(record, value)| (record.cluster.as_str(), value))
        .collect();
    let mut scenes: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (scene, value) in &units {
        scenes.entry(scene).or_default().push(*value);
    }
    cell.scenes = scenes.values().filter_map(|values| mean(values)).collect();
    cell.spread = Spread::new(&units, &cell.scenes);
    cell.finite_mean = aggregation.of(values.into_iter().filter(|(_, v)| v.is_finite()));
    cell
}
