//! Options that several commands share: datasets, metrics.

use std::sync::Arc;

use anyhow::{Context, bail, ensure};
use clap::Args;
use sharp_metrics::weights::cache_folder;
use sharp_metrics::{Device, MetricRegion, ScorerOptions, Selection, Unavailable, Weights};

use super::usage::UsageError;
use crate::pairs::{OpenDataset, PairError};
use crate::scoring::{ScaleChooser, Scoring};

/// Which metrics, with which weights.
#[derive(Debug, Args)]
pub(super) struct MetricArgs {
    /// Metric keys, aliases, families (ssim, lpips, dists), or `paper` or `all`; comma-separated
    #[arg(long, value_name = "LIST", default_value = "paper")]
    pub(super) metrics: String,
    /// A backbone's weights file: alexnet=FILE, vgg16=FILE or squeezenet1_1=FILE; repeatable
    #[arg(long, value_name = "NAME=FILE")]
    pub(super) weights: Vec<String>,
    /// Where the networks behind LPIPS and DISTS are computed: cpu; cuda or metal in a build that has them (untested on
    /// real GPUs); candle-cpu (slow) to try on the CPU what GPUs run
    #[arg(long, value_name = "DEVICE", default_value_t)]
    pub(super) device: Device,
}

impl MetricArgs {
    pub(super) fn selection(&self) -> anyhow::Result<Selection> {
        Selection::parse(&self.metrics).with_context(|| format!("--metrics {}", self.metrics))
    }

    /// The metrics of a run. Its mask is the view-frustum mask of a pair.
    pub(super) fn scoring(&self) -> anyhow::Result<Scoring> {
        let selection = self.selection()?;
        if let Some(key) = selection
            .keys()
            .find(|key| key.region() == MetricRegion::Given)
        {
            bail!("--metrics {key}: masks are handed in with `sharp-bench metrics --mask` only");
        }
        let (weights, options) = (self.weights()?, self.options()?);
        Ok(Scoring::with_options(&selection, &weights, options)?)
    }

    /// How the networks are computed: by default, but for the device.
    pub(super) fn options(&self) -> anyhow::Result<ScorerOptions> {
        let device = self.device;
        ensure!(
            device.is_built(),
            "--device {device}: this build has no {device}: build with `--features {device}`"
        );
        Ok(ScorerOptions {
            device,
            ..ScorerOptions::default()
        })
    }

    /// As [`scoring`](Self::scoring), for work that takes long: a metric named itself whose weights lack is an error
    /// before anything is computed, not an empty column after hours.
    pub(super) fn complete_scoring(&self) -> anyhow::Result<Scoring> {
        let (selection, scoring) = (self.selection()?, self.scoring()?);
        for (key, backbone) in scoring.missing_weights() {
            if selection.is_explicit(key) {
                bail!("--metrics {key}: {}", Unavailable::NoWeights { backbone });
            }
        }
        Ok(scoring)
    }

    /// What `--scale-sweep` chooses by.
    pub(super) fn scale_chooser(&self) -> anyhow::Result<Arc<ScaleChooser>> {
        match ScaleChooser::dists(&self.weights()?, self.options()?)? {
            Some(chooser) => Ok(Arc::new(chooser)),
            None => bail!(
                "--scale-sweep chooses by DISTS, whose network's weights are missing: give --weights vgg16=FILE, or see \
                 `weights list`"
            ),
        }
    }

    /// The files given, then what was fetched earlier.
    pub(super) fn weights(&self) -> anyhow::Result<Weights> {
        let mut weights = Weights::none();
        for spec in &self.weights {
            let Some((name, file)) = spec.split_once('=') else {
                let reason = "NAME=FILE is needed, as in vgg16=vgg16-397923af.pth";
                return Err(UsageError(format!("--weights {spec}: {reason}")).into());
            };
            weights = weights.with_file(name.parse()?, file);
        }
        Ok(match cache_folder() {
            Some(cache) => weights.with_cache(&cache),
            None => weights,
        })
    }
}

/// Which datasets, and which of their scenes.
#[derive(Debug, Args)]
pub(super) struct DatasetArgs {
    /// A dataset, [NAME:]FORMAT=PATH[,key=value…]; repeatable
    #[arg(long = "dataset", value_name = "SPEC", required = true)]
    pub(super) datasets: Vec<String>,
    /// Only scenes whose id matches; `*` and `?` are wildcards
    #[arg(long, value_name = "GLOB")]
    pub(super) scenes: Option<String>,
}

impl DatasetArgs {
    /// Opens them.
    pub(super) fn open(&self) -> Result<Vec<OpenDataset>, PairError> {
        OpenDataset::open_all(&self.datasets, self.scenes.as_deref())
    }
}

/// The formats of `--dataset` with their settings, for `--help`.
pub(super) fn formats_help() -> String {
    let mut text = "Datasets, [NAME:]FORMAT=PATH[,key=value…]:\n".to_owned();
    for entry in sharp_datasets::entry::ENTRIES {
        text += &format!("  {:<18} {}: {}\n", entry.format, entry.title, entry.layout);
        for setting in entry.settings {
            text += &format!(
                "    {}={}  {}\n",
                setting.key, setting.default, setting.meaning
            );
        }
    }
    text
}
