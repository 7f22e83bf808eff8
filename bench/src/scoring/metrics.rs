//! The metrics of a run, with the weights that decide their values.

use sharp_metrics::{
    Backbone, MetricInfo, MetricKey, Scorer, ScorerOptions, Selection, Weights, WeightsError,
};

use crate::io::fingerprints;
use crate::io::hash::StableHasher;

/// Metrics with everything that decides their values.
#[derive(Debug)]
pub struct Scoring {
    /// Computes all of [`Self::metrics`].
    pub scorer: Scorer,
    /// The columns, in the order given.
    pub metrics: Vec<ScoredMetric>,
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoredMetric {
    /// Its convention.
    pub key: MetricKey,
    /// What it is, with its weights.
    pub info: MetricInfo,
    /// Hash of convention, weights, arithmetic and code: values of two identities never share a column of a folder.
    pub identity: String,
}

impl Scoring {
    /// Prepares the metrics of a selection.
    ///
    /// # Errors
    /// When a weights file cannot be read or is not what it should be.
    pub fn new(selection: &Selection, weights: &Weights) -> Result<Self, WeightsError> {
        Self::with_options(selection, weights, ScorerOptions::default())
    }

    /// As [`new`](Self::new), with a choice of kernels.
    ///
    /// # Errors
    /// As [`new`](Self::new).
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
        })
    }

    /// The keys as text, in order.
    pub fn keys(&self) -> Vec<String> {
        self.metrics.iter().map(|m| m.key.to_string()).collect()
    }

    /// True if a metric needs the view-frustum mask of a pair.
    pub fn needs_mask(&self) -> bool {
        self.metrics.iter().any(|metric| metric.key.is_masked())
    }
}
