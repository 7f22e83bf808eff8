//! Writes a comparison to a folder: the report of both runs, with the changes by part and by pair.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use serde_json::{Value, json};
use sharp_datasets::Scene;
use sharp_metrics::MetricKey;
use sharp_statistics::mean;

use super::anatomy::Anatomy;
use super::breakdown::Stratum;
use super::flips::Flips;
use super::tables::most_changed;
use super::{Against, RunComparison};
use crate::evaluate::Shown;
use crate::evaluate::record::finite_or_text;
use crate::report::tables::csv::csv_of;
use crate::report::{
    PublishedNumbers, ReportComparison, ReportError, ReportFiles, ReportOptions, report,
};

/// A pair with a score in both A and B, as written to files.
#[derive(Debug, Clone, Serialize)]
pub struct PairLine<'a> {
    pub pair_id: &'a str,
    pub dataset: &'a str,
    pub scene: &'a str,
    pub metric: String,
    pub method_a: &'a str,
    pub method_b: &'a str,
    #[serde(with = "finite_or_text")]
    pub a: f64,
    #[serde(with = "finite_or_text")]
    pub b: f64,
    /// How much worse B is than A, in the metric's unit.
    #[serde(with = "finite_or_text")]
    pub loss: f64,
}

impl RunComparison {
    /// All strata: the [`RunComparison::breakdown`] of every method and metric, and the strata of `anatomy`, in the
    /// order of the tables.
    pub fn strata(&self, anatomy: &[Anatomy]) -> Vec<Stratum> {
        let mut strata = Vec::new();
        for against in &self.against {
            for metric in &self.results.manifest.metrics {
                strata.extend(self.breakdown(against, &metric.info));
            }
        }
        strata.extend(anatomy.iter().flat_map(|anatomy| anatomy.strata.clone()));
        // Keep the tables of one metric and division together.
        strata.sort_by(|one, other| {
            let key = |s: &Stratum| (s.method_a.clone(), s.method_b.clone(), self.place(s), s.by);
            key(one).cmp(&key(other))
        });
        strata
    }

    /// Index of the stratum's metric in the runs.
    fn place(&self, stratum: &Stratum) -> Option<usize> {
        self.results.manifest.metrics.iter().position(|metric| {
            let key = metric.info.key;
            MetricKey::whole(key.metric()).to_string() == stratum.metric
                && key.region() == stratum.region
        })
    }

    /// The output of `compare --json`: the comparison with its [strata](Self::strata) and the
    /// `flips`, if not empty.
    pub fn json(&self, strata: &[Stratum], flips: &[Flips<'_>]) -> Value {
        let mut json = json!({
            "schema": 1,
            "a": self.a.display().to_string(),
            "b": self.b.display().to_string(),
            "seed": self.resampling.seed,
            "resamples": self.resampling.count,
            "rows": self.rows,
            "breakdown": strata,
            "pairs": self.pair_lines(Some(10)),
        });
        if !flips.is_empty() {
            json["flips"] = flips.iter().map(Flips::json).collect();
        }
        json
    }

    /// The pairs of each method and metric, largest loss first. `of_either_end` limits the pairs to
    /// that number of the largest losses and the same number of the largest gains.
    pub fn pair_lines(&self, of_either_end: Option<usize>) -> Vec<PairLine<'_>> {
        let mut lines = Vec::new();
        for against in &self.against {
            for metric in &self.results.manifest.metrics {
                let mut changes = self.changes(against, &metric.info);
                if let Some(count) = of_either_end {
                    changes = most_changed(&changes, count).copied().collect();
                }
                lines.extend(changes.into_iter().map(|change| PairLine {
                    pair_id: &change.a.pair_id,
                    dataset: &change.a.dataset,
                    scene: &change.a.scene,
                    metric: metric.info.key.to_string(),
                    method_a: &against.a,
                    method_b: &against.b,
                    a: change.scores[0],
                    b: change.scores[1],
                    loss: change.loss,
                }));
            }
        }
        lines
    }

    fn lead(&self) -> String {
        let sides = |side: &str, run: &Path, label: fn(&Against) -> &String| {
            let labels: Vec<&str> = self.against.iter().map(|a| label(a).as_str()).collect();
            format!("{side}: {} of {}.", labels.join(", "), run.display())
        };
        let (a, b) = (sides("A", &self.a, |a| &a.a), sides("B", &self.b, |a| &a.b));
        format!("{a} {b} {HOW_TO_READ}")
    }

    /// Writes `index.html`, `report.md` and, as CSV, `tables/comparison.csv` (the rows), `tables/breakdown.csv` (the
    /// strata) and `tables/pairs.csv`. `scenes` provide the source and target pictures; `flips` are listed on the page.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(
        &self,
        strata: &[Stratum],
        flips: &[Flips<'_>],
        scenes: &[Scene],
        out: &Path,
    ) -> Result<ReportFiles, ReportError> {
        let metrics = || self.results.manifest.metrics.iter().map(|m| &m.info);
        let pairs = self.pair_lines(None);
        let mut losses: BTreeMap<String, BTreeMap<String, Vec<f64>>> = BTreeMap::new();
        for line in &pairs {
            let of_pair = losses.entry(line.pair_id.to_owned()).or_default();
            of_pair
                .entry(line.metric.clone())
                .or_default()
                .push(line.loss);
        }
        let mut details = Vec::new();
        for against in &self.against {
            details.extend(metrics().filter_map(|metric| self.extremes(against, metric)));
        }
        details.extend(flips.iter().map(Flips::grid));
        details.extend(self.where_grids(strata));
        let losses = losses.into_iter().map(|(pair_id, of_pair)| {
            let of_pair = of_pair.into_iter();
            (
                pair_id,
                of_pair
                    .filter_map(|(key, losses)| Some((key, mean(&losses)?)))
                    .collect(),
            )
        });
        let comparison = ReportComparison {
            lead: self.lead(),
            against: self
                .against
                .iter()
                .map(|against| against.joined.clone())
                .collect(),
            grids: self.change_grids(),
            details,
            losses: losses.collect(),
            files: vec![
                ("tables/comparison.csv".to_owned(), csv_of(&self.rows)?),
                ("tables/breakdown.csv".to_owned(), csv_of(strata)?),
                ("tables/pairs.csv".to_owned(), csv_of(&pairs)?),
            ],
        };
        let labels = self.against.iter().flat_map(|against| &against.joined);
        let compared = Shown {
            methods: labels.cloned().collect(),
            ..Shown::default()
        };
        let results = compared.chosen(self.results.clone());
        let options = ReportOptions {
            published: PublishedNumbers::Never,
            comparison: Some(comparison),
            ..ReportOptions::default()
        };
        report(&results, scenes, out, &options)
    }
}

const HOW_TO_READ: &str = "Differences are B − A over the same pairs; significance is computed over scenes. B is better or worse \
                    if p < 0.05 after Holm's correction over the datasets of a metric. Otherwise the verdict is “none” if both \
                    are equal or every difference in the interval is too small to matter, and “inconclusive” if not.";
