//! What a run evaluates: pairs whose views are known to exist, methods, metrics.

use std::collections::BTreeMap;

use sharp_metrics::{MetricKey, Scorer, ScorerOptions, Selection, Weights, WeightsError};

use super::metric_facts::weights_text;
use crate::methods::Method;
use crate::protocol::pair_list::ResolvedPair;
use crate::rendering::SharedRenderer;

/// Everything that [`execute`](super::execute::execute) does.
pub struct RunPlan<'a> {
    /// In the order of their ids.
    pub pairs: Vec<ResolvedPair<'a>>,
    /// In the order given; labels are unique.
    pub methods: &'a [Box<dyn Method>],
    /// The settings in force of each dataset, by name: the same files mean other views under others.
    pub readings: BTreeMap<&'a str, String>,
    /// Computes the metrics.
    pub scoring: &'a Scoring,
    /// Renders for the methods; its backend is part of every unit's key.
    pub renderer: &'a SharedRenderer,
    /// Which predictions to keep.
    pub keep: Keep,
    /// Score all methods on what all of them predict of a pair's target, instead of each on all that it predicts.
    pub common_region: bool,
}

/// Metrics with everything that decides their values.
#[derive(Debug)]
pub struct Scoring {
    /// Computes all of [`Self::metrics`].
    pub scorer: Scorer,
    /// The columns, in the order given.
    pub metrics: Vec<ScoredMetric>,
}

/// One column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ScoredMetric {
    /// Its convention.
    pub key: MetricKey,
    /// The weights by hash; see [`weights_text`].
    pub weights: String,
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
        let metric = |&key: &MetricKey| ScoredMetric {
            key,
            weights: weights_text(key, scorer.weights()),
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
}

/// Which predictions stay in the run folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Keep {
    /// All of them, as 8-bit PNG
    #[default]
    All,
    /// None
    None,
}
