//! Which pairs: a list, or the choices that build one.

use std::path::PathBuf;

use clap::Args;

use crate::evaluate::PairOrigin;
use crate::pairs::{OverlapCache, PairOptions, PairRecipe};

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

    /// Where measured overlaps are kept.
    pub(super) fn cache(&self) -> Option<OverlapCache> {
        if self.no_cache {
            return None;
        }
        let folder = self.cache.clone();
        let folder = folder.or_else(OverlapCache::users_folder);
        folder.map(OverlapCache::in_folder)
    }
}

/// Which pairs: a list, or the choices that build one.
#[derive(Debug, Args)]
pub(super) struct PairArgs {
    /// Evaluate the pairs of this list (CSV as written by `pairs`) instead of building one
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["pair_options", "overlap_depth", "overlap_checkpoint", "cache", "no_cache"]
    )]
    pairs: Option<PathBuf>,
    /// Choices that the paper leaves open, key=value,…; see `pairs --help`. A dataset changes them for itself by
    /// --dataset SPEC,pairs.key=value
    #[arg(long, value_name = "LIST")]
    pair_options: Option<PairOptions>,
    #[command(flatten)]
    overlap: OverlapArgs,
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
