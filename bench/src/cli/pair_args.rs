//! Which pairs: a list, or the choices that build one.

use std::path::PathBuf;

use clap::Args;

use super::pair_recipe::{OverlapArgs, PairRecipe};
use crate::protocol::PairOptions;

/// Where the pair list comes from.
pub(super) enum PairOrigin {
    /// Built from the datasets.
    Built(Box<PairRecipe>),
    /// Handed in.
    Given(PathBuf),
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
    /// Choices that the paper leaves open, key=value,…; see `pairs --help`
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
                PairOrigin::Built(Box::new(PairRecipe::new(options, self.overlap.clone())?))
            }
        })
    }
}
