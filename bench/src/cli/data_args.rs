//! Options that several commands share: datasets, metrics.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, bail, ensure};
use clap::Args;
use sharp_datasets::{DatasetSpec, Scene};
use sharp_metrics::weights::cache_folder;
use sharp_metrics::{Backbone, Device, Region, ScorerOptions, Selection, Unavailable, Weights};

use super::usage::UsageError;
use crate::methods::scale_sweep::ScaleChooser;
use crate::protocol::options::paper::PROXY;
use crate::runs::plan::Scoring;

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
        if let Some(key) = selection.keys().find(|key| key.region() == Region::Given) {
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
        for metric in &scoring.metrics {
            let lacks =
                Backbone::of(metric.key.metric()).filter(|_| metric.weights.ends_with("=absent"));
            if let Some(backbone) = lacks.filter(|_| selection.is_explicit(metric.key)) {
                bail!(
                    "--metrics {}: {}",
                    metric.key,
                    Unavailable::NoWeights { backbone }
                );
            }
        }
        Ok(scoring)
    }

    /// What `--scale-sweep` chooses by.
    pub(super) fn scale_chooser(&self) -> anyhow::Result<Arc<ScaleChooser>> {
        let dists = Selection::parse("dists")?;
        let scoring = Scoring::with_options(&dists, &self.weights()?, self.options()?)?;
        let Some(metric) = scoring.metrics.first() else {
            bail!("--scale-sweep: no metric to choose by");
        };
        if metric.weights.ends_with("=absent") {
            bail!(
                "--scale-sweep chooses by DISTS, whose network's weights are not at hand: give --weights vgg16=FILE, or \
                 see `weights list`"
            );
        }
        let identity = format!("{} {}", metric.key, metric.weights);
        Ok(Arc::new(ScaleChooser {
            scorer: scoring.scorer,
            identity,
        }))
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
    /// A dataset, [NAME:]FORMAT=PATH; repeatable
    #[arg(long = "dataset", value_name = "SPEC", required = true)]
    pub(super) datasets: Vec<String>,
    /// Only scenes whose id matches; `*` and `?` are wildcards
    #[arg(long, value_name = "GLOB")]
    pub(super) scenes: Option<String>,
}

/// A dataset with what was found in it.
pub(super) struct OpenDataset {
    pub(super) name: String,
    pub(super) spec: String,
    /// The dataset's folder; `None` for a procedural one.
    pub(super) root: Option<PathBuf>,
    /// The reader and its settings, whatever the folder.
    pub(super) settings: String,
    /// Readings of the paper that the dataset's settings stand for.
    readings: Vec<String>,
    pub(super) scenes: Vec<Scene>,
}

impl OpenDataset {
    /// The settings in force, `key=value` by commas.
    pub(super) fn readings(&self) -> String {
        self.readings.join(",")
    }

    /// What the reader chose, assumed or left out, for the manifest.
    pub(super) fn notes(&self) -> Vec<String> {
        let of_scenes = self.scenes.iter().flat_map(|scene| {
            scene
                .notes
                .iter()
                .map(|note| format!("{}: {note}", scene.id))
        });
        self.readings.iter().cloned().chain(of_scenes).collect()
    }
}

/// Opens datasets; names must be unique, because they are columns.
pub(super) fn open(specs: &[String], scenes: Option<&str>) -> anyhow::Result<Vec<OpenDataset>> {
    let mut open: Vec<OpenDataset> = Vec::new();
    for text in specs {
        let spec = DatasetSpec::parse(text)?;
        if open.iter().any(|other| other.name == spec.name) {
            bail!(
                "--dataset {text}: the name '{}' is taken; give this one NAME:",
                spec.name
            );
        }
        let mut found = sharp_datasets::open(&spec)?;
        if let Some(pattern) = scenes {
            found.retain(|scene| matches(pattern, &scene.id));
        }
        let readings = spec.readings().into_iter().map(|reading| {
            if reading.proxy {
                format!("{reading} ({PROXY})")
            } else {
                reading.to_string()
            }
        });
        open.push(OpenDataset {
            settings: format!("{} {:?}", spec.entry.format, spec.settings),
            readings: readings.collect(),
            root: (!spec.path.as_os_str().is_empty()).then(|| spec.path.clone()),
            name: spec.name,
            spec: text.clone(),
            scenes: found,
        });
    }
    if open.iter().all(|dataset| dataset.scenes.is_empty()) {
        bail!("no scene matches --scenes {}", scenes.unwrap_or("*"));
    }
    Ok(open)
}

/// `*` stands for any run of characters, `?` for one.
fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) =
        (pattern.chars().collect(), text.chars().collect());
    let (mut p, mut t) = (0, 0);
    // Where to go on after a mismatch: the last star, and the text it has swallowed so far.
    let mut retry = None;
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                retry = Some((p + 1, t));
                p += 1;
            }
            Some(&c) if c == '?' || c == text[t] => {
                p += 1;
                t += 1;
            }
            _ => match retry {
                Some((after_star, swallowed)) => {
                    retry = Some((after_star, swallowed + 1));
                    (p, t) = (after_star, swallowed + 1);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|&c| c == '*')
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards() {
        for (pattern, text, expected) in [
            ("*", "", true),
            ("Moto*", "Motorcycle", true),
            ("*cycle", "Motorcycle", true),
            ("M?t*c*e", "Motorcycle", true),
            ("Moto", "Motorcycle", false),
            ("*x*", "Motorcycle", false),
            ("a*b*c", "axxbyybc", true),
        ] {
            assert_eq!(matches(pattern, text), expected, "{pattern} {text}");
        }
    }
}
