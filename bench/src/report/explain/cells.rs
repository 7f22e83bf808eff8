//! A published number, and the readings (ways to compute it) that may have produced it.

use std::collections::BTreeMap;

use serde::Serialize;
use sharp_metrics::{Family, MetricKey};

use crate::evaluate::Aggregation;
use crate::evaluate::readings::{PictureReading, Readings};
use crate::evaluate::record::Record;
use crate::report::column::Column;
use crate::report::tables::rank::rounded;

/// Difference below which values count as equal. Smaller differences are only due to the order of computation.
const SAME: f64 = 1e-9;

/// The scenes whose pairs are averaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SceneReading {
    All,
    /// Only the first of several scenes that show one place in different light, exposure or rectification.
    OneAPlace,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Averaging {
    Of(Aggregation),
    /// PSNR of the mean squared error over all pairs.
    PooledError,
}

/// A reading: one way to compute a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Reading {
    pub picture: PictureReading,
    pub scenes: SceneReading,
    pub averaging: Averaging,
    pub key: MetricKey,
}

/// The run's value under a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadingValue {
    pub reading: Reading,
    pub value: f64,
    pub n: usize,
}

/// Whether any reading reproduces a published number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// One reading rounds to the published number.
    Equal,
    /// Several readings with different values round to the published number.
    Ambiguous,
    /// No reading rounds to the published number, but the number lies between the smallest and the largest reading, up
    /// to rounding.
    Inside,
    /// The published number lies outside the range of all readings.
    Outside,
    /// No reading could be computed.
    NotComputed,
}

impl Agreement {
    /// Text for tables.
    pub fn words(self) -> &'static str {
        match self {
            Self::Equal => "equal to rounding",
            Self::Ambiguous => "ambiguous",
            Self::Inside => "inside the protocol's spread",
            Self::Outside => "outside",
            Self::NotComputed => "not computed",
        }
    }
}

/// The explanation of one cell of the paper's table.
#[derive(Debug, Clone, PartialEq)]
pub struct CellExplanation {
    /// Name of the dataset in the run, whereas `column` is the paper's name for it.
    pub dataset: String,
    pub column: &'static str,
    /// The metric as the paper names it.
    pub metric: Column,
    pub published: f64,
    /// The value that the run itself reports: the metric's default variant, averaged over all pairs by the run's own
    /// rule. `None` if it could not be computed.
    pub as_scored: Option<f64>,
    /// Number of pairs in the run. Readings cover only those pairs whose picture was kept.
    pub pairs: usize,
    /// Readings of the metric, the run's own first. Among readings with the same [`SceneReading`], only those over the
    /// largest number of pairs are included.
    pub readings: Vec<ReadingValue>,
    pub verdict: Agreement,
}

impl CellExplanation {
    /// Whether a value, rounded like the published number, equals it.
    pub fn prints(&self, value: f64) -> bool {
        rounded(value, self.metric.decimals) == self.published
    }

    /// Readings that round to the published number; readings with the same value are listed once.
    pub fn candidates(&self) -> Vec<&ReadingValue> {
        let mut candidates: Vec<&ReadingValue> = Vec::new();
        for reading in self
            .readings
            .iter()
            .filter(|reading| self.prints(reading.value))
        {
            let is_known = |known: &&ReadingValue| (known.value - reading.value).abs() < SAME;
            if !candidates.iter().any(is_known) {
                candidates.push(reading);
            }
        }
        candidates
    }

    /// The smallest and the largest value of all readings.
    pub fn spread(&self) -> Option<(f64, f64)> {
        let values = || self.readings.iter().map(|reading| reading.value);
        Some((values().reduce(f64::min)?, values().reduce(f64::max)?))
    }

    fn judged(mut self) -> Self {
        let inside = self.spread().map(|(low, high)| {
            let half = 0.5 * 0.1_f64.powi(self.metric.decimals as i32);
            (low - half..=high + half).contains(&self.published)
        });
        self.verdict = match (self.candidates().len(), inside) {
            (_, None) => Agreement::NotComputed,
            (1, _) => Agreement::Equal,
            (0, Some(true)) => Agreement::Inside,
            (0, Some(false)) => Agreement::Outside,
            _ => Agreement::Ambiguous,
        };
        self
    }
}

/// Compares the readings of a dataset with a published number in a column of the paper. `aggregation` is the run's own
/// rule.
pub(super) fn cell(
    readings: &Readings,
    dataset: &str,
    column: &'static str,
    metric: &Column,
    published: f64,
    aggregation: Aggregation,
) -> CellExplanation {
    let of_metric = |key: &MetricKey| key.family().name() == metric.family();
    let records: Vec<(usize, &Record)> = readings
        .records
        .iter()
        .enumerate()
        .filter(|(_, r)| r.dataset == dataset)
        .collect();
    let first = first_scenes(&records);
    let mut values = Vec::new();
    for ((picture, key), scores) in readings
        .scores
        .iter()
        .filter(|((_, key), _)| of_metric(key))
    {
        for scenes in [SceneReading::All, SceneReading::OneAPlace] {
            let counts = |record: &Record| {
                scenes == SceneReading::All
                    || first.get(record.cluster.as_str()) == Some(&record.scene.as_str())
            };
            let chosen = records.iter().filter(|(_, record)| counts(record));
            let chosen = chosen.filter_map(|(at, record)| Some((*record, scores[*at]?)));
            let chosen: Vec<(&Record, f64)> = chosen.collect();
            let all = scores.iter().zip(&readings.records);
            let all = all
                .filter(|(score, record)| score.is_some() && record.dataset == dataset)
                .count();
            if scenes == SceneReading::OneAPlace && chosen.len() == all {
                continue;
            }
            let mut averagings = Aggregation::ALL.map(Averaging::Of).to_vec();
            if key.family() == Family::Psnr {
                averagings.push(Averaging::PooledError);
            }
            for averaging in averagings {
                let value = match averaging {
                    Averaging::Of(aggregation) => aggregation.of(chosen.iter().copied()),
                    Averaging::PooledError => pooled(&chosen),
                };
                if let Some(value) = value {
                    let reading = Reading {
                        picture: *picture,
                        scenes,
                        averaging,
                        key: *key,
                    };
                    values.push(ReadingValue {
                        reading,
                        value,
                        n: chosen.len(),
                    });
                }
            }
        }
    }
    // Drop values that cover fewer pairs than other values, because they are not comparable with them.
    for scenes in [SceneReading::All, SceneReading::OneAPlace] {
        let of_scenes = values.iter().filter(|value| value.reading.scenes == scenes);
        let most = of_scenes.map(|value| value.n).max();
        values.retain(|value| value.reading.scenes != scenes || Some(value.n) == most);
    }
    // The run's own reading (default variant) comes first, followed by the others in the order of their definitions.
    let default: Option<MetricKey> = metric.family().parse().ok();
    let own_mean = Averaging::Of(aggregation);
    values.sort_by_key(|value| {
        let reading = value.reading;
        let foreign = (Some(reading.key) != default, reading.averaging != own_mean);
        (foreign, reading)
    });
    let own = values.first().filter(|value| {
        let reading = value.reading;
        Some(reading.key) == default && reading.picture == PictureReading::AsScored
    });
    CellExplanation {
        dataset: dataset.to_owned(),
        column,
        metric: metric.clone(),
        published,
        as_scored: own.map(|value| value.value),
        pairs: readings.units.get(dataset).copied().unwrap_or_default(),
        readings: values,
        verdict: Agreement::NotComputed,
    }
    .judged()
}

/// The first scene by name of each physical place, keyed by place.
fn first_scenes<'a>(records: &[(usize, &'a Record)]) -> BTreeMap<&'a str, &'a str> {
    let mut first: BTreeMap<&str, &str> = BTreeMap::new();
    for (_, record) in records {
        let scene = first.entry(&record.cluster).or_insert(&record.scene);
        if record.scene.as_str() < *scene {
            *scene = &record.scene;
        }
    }
    first
}

/// PSNR of the mean squared error.
fn pooled(values: &[(&Record, f64)]) -> Option<f64> {
    let errors = values.iter().map(|(_, psnr)| 10_f64.powf(-psnr / 10.0));
    let mean = errors.sum::<f64>() / values.len() as f64;
    (!values.is_empty()).then(|| -10.0 * mean.log10())
}

impl Reading {
    /// The reading as text, without the metric's variant: `as scored, all scenes, mean over pairs`.
    pub fn words(&self) -> String {
        format!(
            "{}, {}, {}",
            self.picture.name(),
            self.scenes.name(),
            self.averaging.name()
        )
    }
}

impl SceneReading {
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all scenes",
            Self::OneAPlace => "one scene a place",
        }
    }
}

impl Averaging {
    pub fn name(self) -> String {
        match self {
            Self::Of(aggregation) => aggregation.to_string(),
            Self::PooledError => "PSNR of the mean squared error".to_owned(),
        }
    }
}
