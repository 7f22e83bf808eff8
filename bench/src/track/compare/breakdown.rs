//! Differences by part: the pairs of each dataset by scene, and by bins of camera motion.
//!
//! Descriptive only: the 95 % intervals are not corrected for the number of parts. For significance, see the
//! [rows](super::ScoreChange).

use std::collections::BTreeMap;

use serde::Serialize;
use sharp_metrics::identity::MetricRegion;
use sharp_metrics::{MetricInfo, MetricKey};
use sharp_statistics::infer;

use super::rows::clusters;
use super::{Against, PairChange, RunComparison};
use crate::evaluate::record::Record;
use crate::report::sweep::Motion;
use sharp_plots::scale::Step;

/// Maximum number of bins per measure of motion.
const BINS: usize = 5;

/// How pairs or pixels are divided into parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Division {
    Scene,
    /// [Classes](super::anatomy::PixelClass) of target pixels, which divide the pixels of each pair.
    Pixels,
    #[serde(untagged)]
    Motion(Motion),
}

impl Division {
    /// Divisions of pairs, not of pixels.
    pub fn of_pairs() -> impl Iterator<Item = Self> {
        [Self::Scene]
            .into_iter()
            .chain(Motion::DIVIDING.map(Self::Motion))
    }

    /// Title for headings.
    pub fn title(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Pixels => "pixels of the target",
            Self::Motion(motion) => motion.title(),
        }
    }

    /// A record's motion, as measured by this division; `None` if the motion is unknown or not
    /// finite, or if the division is not by motion.
    fn value(self, record: &Record) -> Option<f64> {
        match self {
            Self::Scene | Self::Pixels => None,
            Self::Motion(motion) => motion.of(record),
        }
    }
}

/// Scores of two methods under one metric, on part of a dataset's pairs or pixels. Differences are
/// B − A; non-finite values are null.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stratum {
    pub dataset: String,
    pub metric: String,
    pub region: MetricRegion,
    pub method_a: String,
    pub method_b: String,
    pub by: Division,
    /// Name of the part: the scene, the bin `low to high` (including its lower end), or the pixel
    /// class.
    pub stratum: String,
    /// Mean share of the class in a pair's scored pixels, 0..1; pairs without pixels of the class
    /// count as 0.
    pub pixel_share: Option<f64>,
    pub n_pairs: usize,
    /// Number of physical scenes.
    pub n_scenes: usize,
    /// Number of pairs with a worse score in B.
    pub n_worse: usize,
    /// Number of pairs with a better score in B.
    pub n_better: usize,
    pub mean_a: f64,
    pub mean_b: f64,
    pub difference: f64,
    pub ci_low: Option<f64>,
    pub ci_high: Option<f64>,
}

impl RunComparison {
    /// Differences between two methods for each part of a dataset, by every division of [`Division::of_pairs`]. Scenes
    /// are in the order of their first pair's id, bins in ascending order. A measure of motion that puts all pairs of a
    /// dataset into one bin is left out.
    pub fn breakdown(&self, against: &Against, metric: &MetricInfo) -> Vec<Stratum> {
        let mut changes = self.sides(against).changes(metric);
        changes.sort_by(|a, b| a.a.pair_id.cmp(&b.a.pair_id));
        let strata = self.results.manifest.datasets.iter().flat_map(|dataset| {
            let of_dataset = changes.iter().filter(|c| c.a.dataset == dataset.name);
            let of_dataset: Vec<&PairChange<'_>> = of_dataset.collect();
            let parts = Division::of_pairs().flat_map(move |by| {
                let parts = parts(by, &of_dataset).into_iter();
                parts.map(move |(name, part)| (by, name, part))
            });
            parts.map(|(by, name, part)| self.stratum(against, metric, by, name, &part))
        });
        strata.collect()
    }

    pub(super) fn stratum(
        &self,
        against: &Against,
        metric: &MetricInfo,
        by: Division,
        name: String,
        part: &[&PairChange<'_>],
    ) -> Stratum {
        let sample = clusters(part.iter().copied());
        let found = infer(&[&sample], self.resampling).ok();
        let end = |end: fn((f64, f64)) -> f64| {
            let end = found.as_ref().map(|found| end(found.interval));
            end.filter(|end| end.is_finite())
        };
        let count = |is: fn(f64) -> bool| part.iter().filter(|change| is(change.loss)).count();
        Stratum {
            dataset: part[0].a.dataset.clone(),
            metric: MetricKey::whole(metric.key.metric()).to_string(),
            region: metric.key.region(),
            method_a: against.a.clone(),
            method_b: against.b.clone(),
            by,
            stratum: name,
            pixel_share: None,
            n_pairs: sample.n_pairs(),
            n_scenes: sample.n_clusters(),
            n_worse: count(|loss| loss > 0.0),
            n_better: count(|loss| loss < 0.0),
            mean_a: sample.mean_a(),
            mean_b: sample.mean_b(),
            difference: sample.mean(),
            ci_low: end(|(low, _)| low),
            ci_high: end(|(_, high)| high),
        }
    }
}

/// The non-empty parts, with their names.
pub(super) fn parts<'c, 'a>(
    by: Division,
    changes: &[&'c PairChange<'a>],
) -> Vec<(String, Vec<&'c PairChange<'a>>)> {
    if by == Division::Scene {
        let mut scenes: Vec<(String, Vec<&PairChange<'a>>)> = Vec::new();
        for change in changes {
            match scenes
                .iter_mut()
                .find(|(scene, _)| *scene == change.a.scene)
            {
                Some((_, part)) => part.push(change),
                None => scenes.push((change.a.scene.clone(), vec![change])),
            }
        }
        return scenes;
    }
    let values: Vec<(f64, &PairChange<'a>)> = changes
        .iter()
        .filter_map(|change| Some((by.value(change.a)?, *change)))
        .collect();
    let all = || values.iter().map(|(value, _)| *value);
    let span = all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min);
    let step = Step::nice(span, BINS);
    let mut bins: BTreeMap<i64, Vec<&PairChange<'a>>> = BTreeMap::new();
    for (value, change) in values {
        bins.entry(step.index(value)).or_default().push(change);
    }
    if bins.len() < 2 {
        return Vec::new();
    }
    let named = bins.into_iter().map(|(index, part)| {
        let (low, high) = (step.text(index), step.text(index.saturating_add(1)));
        (format!("{low} to {high}"), part)
    });
    named.collect()
}
