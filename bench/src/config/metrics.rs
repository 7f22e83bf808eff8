use std::sync::Arc;

use clap::Args;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sharp_metrics::{Device, Scorer, ScorerOptions, Selection, Unavailable, Weights};

use super::error::ConfigError;
use crate::scoring::{ScaleChooser, Scoring};

/// Metrics, their weights, and the device that computes them.
#[derive(Debug, Clone, Default, PartialEq, Args, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", default)]
pub struct MetricConfig {
    /// Metrics to compute, comma-separated: names of metrics; ssim, lpips or dists for the default variant; ssim-all,
    /// lpips-all or dists-all for all variants; `paper` for dists, lpips, psnr and ssim; or `all` [default: paper]
    #[arg(long, value_name = "LIST")]
    pub metrics: Option<String>,
    /// Weights file of a network that LPIPS or DISTS uses: alexnet=FILE, vgg16=FILE or squeezenet1_1=FILE; repeatable
    #[arg(long, value_name = "NAME=FILE")]
    pub weights: Vec<String>,
    /// Device that computes LPIPS and DISTS: cpu, cuda or metal (if built in; metal is untested), or candle-cpu (runs
    /// the GPU code on the CPU, slowly) [default: cpu]
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<Device>,
}

impl MetricConfig {
    pub fn selection(&self) -> Result<Selection, ConfigError> {
        Ok(self.asked()?.unwrap_or_default())
    }

    /// The requested metrics; `None` if no metrics were requested.
    pub fn asked(&self) -> Result<Option<Selection>, ConfigError> {
        let parsed = self.metrics.as_ref().map(|list| {
            Selection::parse(list).map_err(|error| ConfigError::Selection {
                list: list.clone(),
                error,
            })
        });
        parsed.transpose()
    }

    /// Creates the scorer for this configuration.
    pub fn scoring(&self) -> Result<Scoring, ConfigError> {
        self.scoring_of(&self.selection()?)
    }

    fn scoring_of(&self, selection: &Selection) -> Result<Scoring, ConfigError> {
        let (weights, options) = (self.weights()?, self.options()?);
        Ok(Scoring::with_options(selection, &weights, options)?)
    }

    /// Like [`scoring`](Self::scoring), but fails at once if an explicitly named metric has no
    /// weights, instead of leaving the metric's column empty.
    pub fn complete_scoring(&self, selection: &Selection) -> Result<Scoring, ConfigError> {
        let scoring = self.scoring_of(selection)?;
        demand_weights(selection, &scoring.scorer)?;
        Ok(scoring)
    }

    /// Scorer options with the chosen device and defaults for everything else.
    pub fn options(&self) -> Result<ScorerOptions, ConfigError> {
        let device = self.device.unwrap_or_default();
        if !device.is_built() {
            return Err(ConfigError::NoDevice(device));
        }
        Ok(ScorerOptions {
            device,
            ..ScorerOptions::default()
        })
    }

    pub fn scale_chooser(&self) -> Result<Arc<ScaleChooser>, ConfigError> {
        let chooser = ScaleChooser::dists(&self.weights()?, self.options()?)?;
        Ok(Arc::new(chooser.ok_or(ConfigError::NoChooser)?))
    }

    pub fn weights(&self) -> Result<Weights, ConfigError> {
        weights(&self.weights)
    }
}

/// Loads weights given as `NAME=FILE`; searches for the weights of all other networks.
pub fn weights(files: &[String]) -> Result<Weights, ConfigError> {
    let mut weights = Weights::at_hand();
    for spec in files {
        let Some((name, file)) = spec.split_once('=') else {
            return Err(ConfigError::Usage(format!(
                "--weights {spec}: expected NAME=FILE, such as vgg16=vgg16-397923af.pth"
            )));
        };
        weights = weights.with_file(name.parse()?, file);
    }
    Ok(weights)
}

/// Fails if an explicitly named metric has no weights.
pub fn demand_weights(selection: &Selection, scorer: &Scorer) -> Result<(), ConfigError> {
    let mut missing = scorer.missing_weights();
    match missing.find(|(key, _)| selection.is_explicit(*key)) {
        None => Ok(()),
        Some((key, backbone)) => Err(ConfigError::Unavailable {
            key: key.to_string(),
            reason: Unavailable::NoWeights { backbone },
        }),
    }
}
