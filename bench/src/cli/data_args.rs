//! Options that several commands share: datasets, pairs, metrics, the backend.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, bail, ensure};
use clap::Args;
use sharp::render::Backend;
use sharp_datasets::DatasetError;
use sharp_datasets::entry::{ENTRIES, PICTURES};
use sharp_metrics::{Device, Scorer, ScorerOptions, Selection, Unavailable, Weights};

use super::outcome::UsageError;
use super::output;
use crate::config::DatasetConfig;
use crate::evaluate::PairOrigin;
use crate::io::counts::counted;
use crate::pairs::frame::Frame;
use crate::pairs::{OpenDataset, OverlapCache, PairError, PairOptions, PairRecipe, SceneChecks};
use crate::scoring::{ScaleChooser, Scoring};

/// Metrics and their weights.
#[derive(Debug, Args)]
pub(super) struct MetricArgs {
    /// Metrics, comma-separated: keys or aliases; ssim, lpips, dists (their default variants) or ssim-all, lpips-all,
    /// dists-all; `paper` (dists, lpips, psnr, ssim) or `all` [default: paper]
    #[arg(long, value_name = "LIST")]
    pub(super) metrics: Option<String>,
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
        Ok(self.asked()?.unwrap_or_default())
    }

    /// The metrics that were asked for; `None` where none were.
    pub(super) fn asked(&self) -> anyhow::Result<Option<Selection>> {
        let list = self.metrics.as_ref();
        let parsed =
            list.map(|list| Selection::parse(list).with_context(|| format!("--metrics {list}")));
        parsed.transpose()
    }

    /// The metrics of a run.
    pub(super) fn scoring(&self) -> anyhow::Result<Scoring> {
        self.scoring_of(&self.selection()?)
    }

    fn scoring_of(&self, selection: &Selection) -> anyhow::Result<Scoring> {
        let (weights, options) = (self.weights()?, self.options()?);
        Ok(Scoring::with_options(selection, &weights, options)?)
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

    /// As [`scoring`](Self::scoring), for long-running work: missing weights of a metric that was named explicitly are an error
    /// before anything is computed, not an empty column after hours.
    pub(super) fn complete_scoring(&self, selection: &Selection) -> anyhow::Result<Scoring> {
        let scoring = self.scoring_of(selection)?;
        demand_weights(selection, &scoring.scorer)?;
        Ok(scoring)
    }

    pub(super) fn scale_chooser(&self) -> anyhow::Result<Arc<ScaleChooser>> {
        match ScaleChooser::dists(&self.weights()?, self.options()?)? {
            Some(chooser) => Ok(Arc::new(chooser)),
            None => bail!(
                "--scale-sweep chooses by DISTS, whose network's weights are missing: give --weights vgg16=FILE, or see \
                 `weights list`"
            ),
        }
    }

    pub(super) fn weights(&self) -> anyhow::Result<Weights> {
        weights(&self.weights)
    }
}

/// Weights from files given as `NAME=FILE`; other networks' weights are looked for.
pub(super) fn weights(files: &[String]) -> anyhow::Result<Weights> {
    let mut weights = Weights::at_hand();
    for spec in files {
        let Some((name, file)) = spec.split_once('=') else {
            let reason = "NAME=FILE is needed, as in vgg16=vgg16-397923af.pth";
            return Err(UsageError(format!("--weights {spec}: {reason}")).into());
        };
        weights = weights.with_file(name.parse()?, file);
    }
    Ok(weights)
}

/// Refuses missing weights of metrics that were named explicitly.
pub(super) fn demand_weights(selection: &Selection, scorer: &Scorer) -> anyhow::Result<()> {
    for (key, backbone) in scorer.missing_weights() {
        if selection.is_explicit(key) {
            bail!("--metrics {key}: {}", Unavailable::NoWeights { backbone });
        }
    }
    Ok(())
}

/// A dataset's spec. The error is the bare reason: clap quotes the spec.
pub(super) fn dataset(text: &str) -> Result<DatasetConfig, String> {
    text.parse().map_err(|error| match error {
        PairError::DatasetSpec { reason, .. }
        | PairError::Dataset(DatasetError::Spec { reason, .. }) => reason,
        error => error.to_string(),
    })
}

/// Datasets, and a choice of their scenes.
#[derive(Debug, Args)]
pub(super) struct DatasetArgs {
    /// A dataset, [NAME:]FORMAT=PATH[,key=value…]; repeatable
    #[arg(long = "dataset", value_name = "SPEC", required = true, value_parser = dataset)]
    pub(super) datasets: Vec<DatasetConfig>,
    /// Only scenes whose id matches; `*` and `?` are wildcards
    #[arg(long, value_name = "GLOB")]
    pub(super) scenes: Option<String>,
}

impl DatasetArgs {
    /// Opens them and says which scenes are left out.
    pub(super) fn open(&self) -> Result<Vec<OpenDataset>, PairError> {
        self.open_specs(&self.datasets)
    }

    /// As [`open`](Self::open), of specs that a protocol changed.
    pub(super) fn open_specs(
        &self,
        specs: &[DatasetConfig],
    ) -> Result<Vec<OpenDataset>, PairError> {
        let datasets = OpenDataset::open_all(specs, self.scenes.as_deref())?;
        for dataset in &datasets {
            for group in &dataset.left_out {
                let kind = if group.by_choice { "note" } else { "warning" };
                output::remark(format!("{kind}: {}: {group}", dataset.name));
            }
            say_notes(dataset);
            for warning in dataset.warnings() {
                output::remark(format!("warning: {warning}"));
            }
        }
        Ok(datasets)
    }
}

/// Most notes of a dataset that are printed.
const NOTES: usize = 6;

/// Prints the readers' notes, each with the first of the scenes that have it.
fn say_notes(dataset: &OpenDataset) {
    let mut notes: Vec<(&str, &str, usize)> = Vec::new();
    for scene in &dataset.scenes {
        for note in &scene.notes {
            match notes.iter_mut().find(|(known, ..)| known == note) {
                Some((_, _, count)) => *count += 1,
                None => notes.push((note, &scene.id, 1)),
            }
        }
    }
    for (note, scene, count) in notes.iter().take(NOTES) {
        let others = match count {
            1 => String::new(),
            _ => format!(" and {} more", count - 1),
        };
        output::remark(format!("note: {}/{scene}{others}: {note}", dataset.name));
    }
    if notes.len() > NOTES {
        let more = counted(notes.len() - NOTES, "note");
        let name = &dataset.name;
        output::remark(format!(
            "note: {name}: {more} more (`datasets check` prints them)"
        ));
    }
}

/// Source of the depth that decides overlap, and the cache of measured overlaps.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct OverlapArgs {
    /// Depth maps by anyone that decide overlap, DIR/<dataset>/<scene>/<view>.npy|npz|exr|pfm|png; scaled to the
    /// dataset's own depth by the median of ratios (overlap=given)
    #[arg(long, value_name = "DIR")]
    overlap_depth: Option<PathBuf>,
    /// The checkpoint of overlap=sharp-release, or mini; where the release keeps it without this
    #[arg(long, value_name = "FILE")]
    overlap_checkpoint: Option<PathBuf>,
    /// Its architecture, where it is not the release's: FILE.json#NAME
    #[arg(long, value_name = "FILE[#NAME]", requires = "overlap_checkpoint")]
    overlap_config: Option<String>,
    /// Where measured overlaps are kept, by content; the user's cache without this
    #[arg(long, value_name = "DIR", conflicts_with = "no_cache")]
    cache: Option<PathBuf>,
    /// Measure every overlap anew and keep none
    #[arg(long)]
    no_cache: bool,
    /// Do not look at a few views of each scene first for what contradicts itself: units, focal lengths, poses of other
    /// pictures, exchanged stereo pairs (`datasets check` looks at more)
    #[arg(long)]
    no_check: bool,
}

impl OverlapArgs {
    /// The choices joined with the files that they need.
    pub(super) fn recipe(&self, options: &PairOptions) -> anyhow::Result<PairRecipe> {
        let recipe = PairRecipe {
            options: options.clone(),
            overlap_depth: self.overlap_depth.clone(),
            overlap_checkpoint: self.overlap_checkpoint.clone(),
            overlap_config: self.overlap_config.clone(),
        };
        Ok(recipe.checked()?)
    }

    /// The quick check of datasets, cached beside measured overlaps; `None` with `--no-check`.
    pub(super) fn checks(&self) -> Option<SceneChecks> {
        let folder = self.cache.clone().or_else(OverlapCache::users_folder);
        let folder = folder.filter(|_| !self.no_cache);
        (!self.no_check).then(|| SceneChecks::new(folder))
    }

    pub(super) fn cache(&self) -> Option<OverlapCache> {
        if self.no_cache {
            return None;
        }
        let folder = self.cache.clone();
        let folder = folder.or_else(OverlapCache::users_folder);
        folder.map(OverlapCache::in_folder)
    }
}

/// Pairs: a list, or the choices that build one.
#[derive(Debug, Args)]
pub(super) struct PairArgs {
    /// Evaluate the pairs of this list (CSV as written by `pairs`) instead of building one
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["pair_options", "overlap_depth", "overlap_checkpoint", "cache", "no_cache"]
    )]
    pub(super) pairs: Option<PathBuf>,
    /// Choices that the paper leaves open, key=value,…; see `pairs --help-all`. A dataset changes them for itself by
    /// --dataset SPEC,pairs.key=value
    #[arg(long, value_name = "LIST")]
    pub(super) pair_options: Option<PairOptions>,
    #[command(flatten)]
    pub(super) overlap: OverlapArgs,
}

impl PairArgs {
    pub(super) fn origin(&self) -> anyhow::Result<PairOrigin> {
        Ok(match &self.pairs {
            Some(path) => PairOrigin::Given(path.clone()),
            None => {
                let options = self.pair_options.clone().unwrap_or_default();
                PairOrigin::Built {
                    recipe: Box::new(self.overlap.recipe(&options)?),
                    cache: self.overlap.cache(),
                }
            }
        })
    }
}

/// The backend for `--backend` and `--adapter`. Naming an adapter means wgpu.
pub(super) fn backend(backend: &Backend, adapter: Option<&str>) -> anyhow::Result<Backend> {
    match (backend, adapter) {
        (backend, None) => Ok(backend.clone()),
        (Backend::Auto | Backend::Wgpu(None), Some(name)) => {
            Ok(Backend::Wgpu(Some(name.to_owned())))
        }
        (Backend::Cpu, Some(_)) => {
            bail!("--adapter names a GPU, --backend cpu wants none: use --backend wgpu")
        }
        (Backend::Wgpu(Some(_)), Some(_)) => bail!("--backend {backend} names an adapter already"),
    }
}

/// The formats of `--dataset` with their settings, for `--help`.
pub(super) fn formats_help() -> String {
    let mut text = "Datasets, [NAME:]FORMAT=PATH[,key=value…]:\n".to_owned();
    for entry in ENTRIES {
        text += &format!("  {:<18} {}: {}\n", entry.format, entry.title, entry.layout);
        for setting in entry.settings {
            text += &format!(
                "    {}={}  {}\n",
                setting.key, setting.default, setting.meaning
            );
        }
    }
    let pictures = PICTURES
        .iter()
        .map(|s| format!("    {}={}  {}\n", s.key, s.default, s.meaning));
    let pictures: String = pictures.collect();
    text += &format!(
        "  each of these, too\n    frame=RULE  its views at another size, cameras with them: {}\n{pictures}    \
         pairs.KEY=VALUE  a pair option for it alone (keys: `pairs --help-all`)\n  \
         `datasets list` has the values of each setting\n",
        Frame::forms()
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_adapter_asks_for_wgpu() {
        let named = Backend::Wgpu(Some("A".to_owned()));
        for given in [Backend::Auto, Backend::Wgpu(None)] {
            assert_eq!(backend(&given, Some("A")).unwrap(), named);
            assert_eq!(backend(&given, None).unwrap(), given);
        }
        assert!(backend(&Backend::Cpu, Some("A")).is_err());
        assert!(backend(&named, Some("B")).is_err());
    }
}
