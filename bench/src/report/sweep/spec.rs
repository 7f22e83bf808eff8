//! Options of a sweep.

use std::str::FromStr;

use sharp_metrics::MetricKey;

use super::Motion;
use sharp_plots::bins::Binning;

/// Meaning of the shaded band around a mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Band {
    /// One sample standard deviation of the pairs, as in the paper
    #[default]
    Sd,
    /// The 95 % interval of the mean, over scenes
    Ci95,
    /// No band
    None,
}

/// Criterion that divides lines into panels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Split {
    /// One panel per dataset, one line per method, as in the paper
    #[default]
    Dataset,
    /// One panel per method, one line per dataset
    Method,
    /// Like dataset, but with separate panels for methods that use the source's true depth or the scale of that depth
    Privileged,
}

/// A value of a metric. The sweep reports the camera motion beyond which a method's mean is worse than it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Threshold {
    pub metric: MetricKey,
    pub value: f64,
}

impl FromStr for Threshold {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = text.split_once('=').ok_or("expected METRIC=VALUE")?;
        let metric: MetricKey = name.parse().map_err(|error| format!("{error}"))?;
        // All metrics' scores are in this range, and an axis must be able to show both scores and threshold.
        let value = value.parse().ok();
        let value = value.filter(|v| (-1000.0..=1000.0).contains(v));
        let value = value.ok_or("expected a number from -1000 to 1000")?;
        Ok(Self { metric, value })
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct SweepSpec {
    pub x: Motion,
    pub binning: Binning,
    pub band: Band,
    pub split: Split,
    /// Metrics to show; all if empty.
    pub metrics: Vec<MetricKey>,
    /// `Some(true)` shows only methods that use the source's true depth or the scale of that depth, `Some(false)` only
    /// the other methods.
    pub privileged: Option<bool>,
    pub thresholds: Vec<Threshold>,
    /// The method that all other methods are compared with.
    pub against: Option<String>,
}

impl Default for SweepSpec {
    /// All metrics and methods against the camera baseline in at most ten bins, with standard deviations, one panel per
    /// dataset.
    fn default() -> Self {
        Self {
            x: Motion::default(),
            binning: Binning::Round(10),
            band: Band::default(),
            split: Split::default(),
            metrics: Vec::new(),
            privileged: None,
            thresholds: Vec::new(),
            against: None,
        }
    }
}
