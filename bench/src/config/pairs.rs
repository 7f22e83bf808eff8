use std::path::PathBuf;

use clap::Args;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::text;
use crate::pairs::{OverlapCache, PairOptions, PairOrigin, PairRecipe, SceneChecks};

/// Options for the depth that decides overlap, the cache of overlaps, and the check of scenes.
#[derive(Debug, Clone, Default, PartialEq, Args, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", default)]
pub struct OverlapConfig {
    /// Measure overlap with your own depth maps, `DIR/<dataset>/<scene>/<view>.npy|npz|exr|pfm|png`. By default
    /// (overlap=given), each map is scaled to the dataset's depth by the median of their ratios
    #[arg(long, value_name = "DIR")]
    pub overlap_depth: Option<PathBuf>,
    /// Checkpoint for overlap=sharp-release (mini: the bundled network) or overlap=depth-pro [default: the release
    /// checkpoint or depth_pro.pt, in torch's hub folder or in sharp-bench's cache]
    #[arg(long, value_name = "FILE")]
    pub overlap_checkpoint: Option<PathBuf>,
    /// The checkpoint's architecture, FILE.json#NAME [default: the release's]
    #[arg(long, value_name = "FILE[#NAME]", requires = "overlap_checkpoint")]
    pub overlap_config: Option<String>,
    /// Folder in which measured overlaps are cached [default: the user's cache folder]
    #[arg(long, value_name = "DIR", conflicts_with = "no_cache")]
    pub cache: Option<PathBuf>,
    /// Measure every overlap again; neither read nor write the cache
    #[arg(long)]
    pub no_cache: bool,
    /// Skip the quick check of the datasets. This check examines a few views per scene for wrong units or focal
    /// lengths, poses that belong to other pictures, and swapped stereo pairs; `datasets check` checks more
    #[arg(long)]
    pub no_check: bool,
}

impl OverlapConfig {
    /// The recipe that builds a pair list from `options`, with the files that the options need.
    pub fn recipe(&self, options: &PairOptions) -> Result<PairRecipe, ConfigError> {
        let recipe = PairRecipe {
            options: options.clone(),
            overlap_depth: self.overlap_depth.clone(),
            overlap_checkpoint: self.overlap_checkpoint.clone(),
            overlap_config: self.overlap_config.clone(),
        };
        Ok(recipe.checked()?)
    }

    /// The quick check of datasets, cached next to measured overlaps; `None` with `--no-check`.
    pub fn checks(&self) -> Option<SceneChecks> {
        let folder = self.cache.clone().or_else(OverlapCache::users_folder);
        let folder = folder.filter(|_| !self.no_cache);
        (!self.no_check).then(|| SceneChecks::new(folder))
    }

    pub fn cache(&self) -> Option<OverlapCache> {
        let folder = self.cache.clone().or_else(OverlapCache::users_folder);
        folder
            .filter(|_| !self.no_cache)
            .map(OverlapCache::in_folder)
    }
}

/// The pairs to evaluate: either an existing list, or options for building one.
#[derive(Debug, Clone, Default, PartialEq, Args, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", default)]
pub struct PairConfig {
    /// Evaluate the pairs in this CSV file, as written by `pairs`, instead of building a pair list
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["pair_options", "overlap_depth", "overlap_checkpoint", "cache", "no_cache"]
    )]
    pub pairs: Option<PathBuf>,
    /// How to build pairs where the paper leaves a choice, key=value,…; see `pairs --help-all`. To set an option for a
    /// single dataset, use --dataset SPEC,pairs.key=value
    #[arg(long, value_name = "LIST")]
    #[serde(with = "text")]
    #[schemars(with = "Option<String>")]
    pub pair_options: Option<PairOptions>,
    #[command(flatten)]
    #[serde(flatten)]
    pub overlap: OverlapConfig,
}

impl PairConfig {
    /// Where the pairs are taken from: an existing list, or a recipe that builds one.
    ///
    /// # Errors
    /// If options for building a list are given together with a list, or the files that are given or found do not suit
    /// `overlap=`.
    pub fn origin(&self) -> Result<PairOrigin, ConfigError> {
        let overlap = &self.overlap;
        let builds = [
            ("pair-options", self.pair_options.is_some()),
            ("overlap-depth", overlap.overlap_depth.is_some()),
            ("overlap-checkpoint", overlap.overlap_checkpoint.is_some()),
        ];
        match (&self.pairs, builds.iter().find(|(_, is_given)| *is_given)) {
            (Some(_), Some((option, _))) => Err(ConfigError::Usage(format!(
                "pairs and {option} are mutually exclusive, because the list is either read or built"
            ))),
            (Some(path), None) => Ok(PairOrigin::Given(path.clone())),
            (None, _) => {
                let options = self.pair_options.clone().unwrap_or_default();
                Ok(PairOrigin::Built {
                    recipe: Box::new(overlap.recipe(&options)?),
                    cache: overlap.cache(),
                })
            }
        }
    }
}
