//! The metrics of a run, with the weights that determine their values.

use sharp_metrics::{
    Backbone, MetricInfo, MetricKey, MetricRegion, Scorer, ScorerOptions, Selection, Weights,
    WeightsError,
};

use super::rules::ScoringRules;
use crate::io::fingerprints;
use crate::io::hash::StableHasher;

/// The metrics of a run with everything that determines their values.
#[derive(Debug)]
pub struct Scoring {
    /// Computes all of [`Self::metrics`].
    pub scorer: Scorer,
    /// The columns, in the order of the selection.
    pub metrics: Vec<ScoredMetric>,
    /// Rules that select the compared pixels.
    pub rules: ScoringRules,
}

/// A metric of a run, one column of the tables.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoredMetric {
    pub key: MetricKey,
    /// Description of the metric, including its weights.
    pub info: MetricInfo,
    /// Hash of convention, weights, arithmetic and code. Values with different identities are never
    /// in the same column of a run folder.
    pub identity: String,
}

impl Scoring {
    /// Loads the metrics of a selection.
    ///
    /// # Errors
    /// If a weights file cannot be read or has the wrong content.
    pub fn new(selection: &Selection, weights: &Weights) -> Result<Self, WeightsError> {
        Self::with_options(selection, weights, ScorerOptions::default())
    }

    /// Like [`new`](Self::new), with options for the scorer.
    ///
    /// # Errors
    /// Those of [`new`](Self::new).
    pub fn with_options(
        selection: &Selection,
        weights: &Weights,
        options: ScorerOptions,
    ) -> Result<Self, WeightsError> {
        let scorer = Scorer::with_options(selection, weights, options)?;
        let metric = |&key: &MetricKey| {
            let info = MetricInfo::new(key, scorer.weights());
            let weights = info.backbone.as_ref().map(ToString::to_string);
            let mut identity = StableHasher::default();
            identity
                .add("metric", &key.to_string())
                .add("weights", &weights.unwrap_or_default())
                .add("sources", fingerprints::of_metric(key.family()))
                .add("kernels", options.simd.instruction_set().name());
            if Backbone::of(key.metric()).is_some() {
                identity.add("networks", &options.arithmetic().to_string());
            }
            ScoredMetric {
                key,
                identity: identity.finish(),
                info,
            }
        };
        Ok(Self {
            metrics: scorer.keys().iter().map(metric).collect(),
            scorer,
            rules: ScoringRules::default(),
        })
    }

    /// These metrics under other scoring rules. The result shares the loaded networks.
    #[must_use]
    pub fn under(&self, rules: ScoringRules) -> Self {
        let of = |metric: &ScoredMetric| {
            let mut identity = StableHasher::default();
            identity.add("metric", &metric.identity);
            let usual = ScoringRules::default();
            if rules.border != usual.border {
                identity.add("border", &rules.border.to_string());
            }
            if metric.key.region() == MetricRegion::Given && rules.mask != usual.mask {
                identity.add("mask", &rules.mask.to_string());
            }
            ScoredMetric {
                identity: identity.finish(),
                ..metric.clone()
            }
        };
        let metrics = if rules == self.rules {
            self.metrics.clone()
        } else {
            self.metrics.iter().map(of).collect()
        };
        Self {
            scorer: self.scorer.restricted(self.scorer.keys()),
            metrics,
            rules,
        }
    }

    /// Whether any metric is restricted to `region`.
    pub fn needs(&self, region: MetricRegion) -> bool {
        self.metrics
            .iter()
            .any(|metric| metric.key.region() == region)
    }
}
