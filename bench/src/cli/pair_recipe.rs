//! How a pair list is built: the open choices, whose depth decides overlap, what was measured before.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{bail, ensure};
use clap::Args;
use sharp::model::ModelConfig;
use sharp_datasets::Scene;

use super::data_args::OpenDataset;
use super::{output, pair_advice, progress};
use crate::model_files::find_checkpoint;
use crate::protocol::ambiguity::{Alternative, Reading, alternatives};
use crate::protocol::depth::{
    DepthSource, FirstLayerDepth, GivenDepth, GroundTruthDepth, ScaledToGroundTruth,
};
use crate::protocol::options::OverlapDepth;
use crate::protocol::{BuildContext, OverlapCache, PairBuild, PairOptions, build_pairs};

/// Whose depth decides overlap, and where measured overlaps are kept.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct OverlapArgs {
    /// Depth maps by anyone that decide overlap, DIR/<dataset>/<scene>/<view>.npy|npz|exr|pfm|png; scaled to the
    /// dataset's own depth by the median of ratios (overlap=given)
    #[arg(long, value_name = "DIR")]
    overlap_depth: Option<PathBuf>,
    /// The checkpoint of overlap=sharp-release; where the release keeps it without this
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
}

/// Everything that decides which pairs there are.
#[derive(Debug, Clone)]
pub(super) struct PairRecipe {
    options: PairOptions,
    overlap: OverlapArgs,
}

/// The depth that decides overlap, opened.
struct Depth {
    source: Box<dyn DepthSource>,
    given: Option<GivenDepth>,
    /// Of the network, where one predicts it.
    checkpoint_sha256: Option<String>,
}

/// A built list with what its manifest says of it.
pub(super) struct Built {
    pub(super) pairs: PairBuild,
    pub(super) facts: BTreeMap<String, String>,
    /// What its reader should know of datasets without a selected pair, or with depth too sparse for the choices made.
    pub(super) advice: Vec<String>,
    /// sha256 of the checkpoint that decided overlap.
    pub(super) checkpoint_sha256: Option<String>,
}

impl PairRecipe {
    /// Joins the choices with the files that they need.
    pub(super) fn new(mut options: PairOptions, overlap: OverlapArgs) -> anyhow::Result<Self> {
        if overlap.overlap_depth.is_some() && options.depth == OverlapDepth::GroundTruth {
            options.depth = OverlapDepth::Given;
        }
        let given = matches!(
            options.depth,
            OverlapDepth::Given | OverlapDepth::GivenMetric
        );
        ensure!(
            given == overlap.overlap_depth.is_some(),
            "overlap={} {} --overlap-depth DIR",
            options.depth,
            if given { "needs" } else { "does not take" }
        );
        let network = options.depth == OverlapDepth::SharpRelease;
        ensure!(
            network || overlap.overlap_checkpoint.is_none(),
            "--overlap-checkpoint is for --pair-options overlap=sharp-release"
        );
        Ok(Self { options, overlap })
    }

    /// The dataset's own depth, nothing kept.
    pub(super) fn plain(options: PairOptions) -> Self {
        let overlap = OverlapArgs {
            no_cache: true,
            ..OverlapArgs::default()
        };
        Self { options, overlap }
    }

    pub(super) fn options(&self) -> &PairOptions {
        &self.options
    }

    /// Builds the list of opened datasets and says which files could not be read.
    pub(super) fn build(&self, datasets: &[OpenDataset]) -> anyhow::Result<Built> {
        let scenes: Vec<Scene> = datasets.iter().flat_map(|d| d.scenes.clone()).collect();
        let (depth, cache) = (self.depth()?, self.cache());
        let bar = progress::bar(scenes.len(), "scenes");
        bar.set_message("building the pair list");
        let advance = |done: usize, _: usize| bar.set_position(done as u64);
        let context = context(datasets, &depth, cache.as_ref(), &advance);
        let pairs = build_pairs(&scenes, &self.options, &context)?;
        bar.finish_and_clear();
        for problem in &pairs.problems {
            output::remark(format!("warning: {}", problem.reason));
        }
        warn(cache.as_ref());
        let mut facts: BTreeMap<String, String> = self
            .options
            .entries()
            .into_iter()
            .map(|(key, value)| (key.to_owned(), value))
            .collect();
        facts.insert("overlap depth".to_owned(), depth.source.name());
        if let Some(given) = &depth.given {
            let (maps, sha256) = given.digest(&scenes)?;
            if maps == 0 {
                bail!("--overlap-depth: not one view of the datasets has a map there");
            }
            let text = format!("{maps} maps, sha256 {sha256}");
            facts.insert("overlap depth maps".to_owned(), text);
        }
        Ok(Built {
            advice: datasets
                .iter()
                .filter_map(|dataset| {
                    let counts = pairs.summaries.get(&dataset.name)?;
                    pair_advice::advice(&dataset.name, &dataset.spec, counts, &self.options)
                })
                .collect(),
            pairs,
            facts,
            checkpoint_sha256: depth.checkpoint_sha256,
        })
    }

    /// How the count changes over the open choices and the datasets' other readings.
    pub(super) fn ambiguity(
        &self,
        datasets: &[OpenDataset],
        readings: &[Reading],
    ) -> anyhow::Result<Vec<Alternative>> {
        let scenes: Vec<Scene> = datasets.iter().flat_map(|d| d.scenes.clone()).collect();
        let (depth, cache) = (self.depth()?, self.cache());
        let bar = progress::bar(1, "choices");
        bar.set_message("counting pairs");
        let advance = |done: usize, all: usize| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        let context = context(datasets, &depth, cache.as_ref(), &|_, _| {});
        let rows = alternatives(&scenes, &self.options, readings, &context, &advance)?;
        bar.finish_and_clear();
        warn(cache.as_ref());
        Ok(rows)
    }

    fn cache(&self) -> Option<OverlapCache> {
        if self.overlap.no_cache {
            return None;
        }
        let folder = self.overlap.cache.clone();
        let folder = folder.or_else(OverlapCache::users_folder);
        folder.map(OverlapCache::in_folder)
    }

    fn depth(&self) -> anyhow::Result<Depth> {
        let plain = |source: Box<dyn DepthSource>| Depth {
            source,
            given: None,
            checkpoint_sha256: None,
        };
        let given = || -> anyhow::Result<GivenDepth> {
            let Some(dir) = &self.overlap.overlap_depth else {
                bail!("--overlap-depth DIR is needed");
            };
            Ok(GivenDepth::open(dir)?)
        };
        Ok(match self.options.depth {
            OverlapDepth::GroundTruth | OverlapDepth::Sparse { .. } => {
                plain(Box::new(GroundTruthDepth))
            }
            OverlapDepth::Given => Depth {
                given: Some(given()?),
                ..plain(Box::new(ScaledToGroundTruth(given()?)))
            },
            OverlapDepth::GivenMetric => Depth {
                given: Some(given()?),
                ..plain(Box::new(given()?))
            },
            OverlapDepth::SharpRelease => {
                let checkpoint = match &self.overlap.overlap_checkpoint {
                    Some(file) => file.clone(),
                    None => find_checkpoint()?,
                };
                let (config, name) = match &self.overlap.overlap_config {
                    Some(file) => (ModelConfig::load(file)?, "first layer of another network"),
                    None => (ModelConfig::release(), "first layer of sharp-release"),
                };
                let network = FirstLayerDepth::new(&checkpoint, config, name)?;
                Depth {
                    checkpoint_sha256: Some(network.checkpoint_sha256().to_owned()),
                    ..plain(Box::new(ScaledToGroundTruth(network)))
                }
            }
        })
    }
}

fn context<'a>(
    datasets: &[OpenDataset],
    depth: &'a Depth,
    cache: Option<&'a OverlapCache>,
    progress: &'a dyn Fn(usize, usize),
) -> BuildContext<'a> {
    BuildContext {
        depth: depth.source.as_ref(),
        roots: datasets
            .iter()
            .filter_map(|dataset| Some((dataset.name.clone(), dataset.root.clone()?)))
            .collect(),
        cache,
        settings: datasets
            .iter()
            .map(|dataset| (dataset.name.clone(), dataset.settings.clone()))
            .collect(),
        progress,
        ..BuildContext::default()
    }
}

fn warn(cache: Option<&OverlapCache>) {
    for warning in cache.map(OverlapCache::take_warnings).unwrap_or_default() {
        output::remark(format!("warning: {warning}"));
    }
}
