//! Builds pairs from scenes.

mod measure;
pub(super) mod scene;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use serde::Serialize;
use sharp_datasets::{Pairing, Scene};

use self::scene::SceneWork;
use super::depth::{DepthSource, GroundTruthDepth};
use super::options::PairOptions;
use super::overlap_cache::OverlapCache;
use super::sampling::sample;
use super::{Pair, PairError};

/// Inputs of pair building other than scenes and options. Of these, only the source of depth affects which pairs are
/// built.
#[derive(Clone)]
pub struct BuildContext<'a> {
    pub depth: &'a dyn DepthSource,
    /// Folder of each dataset, keyed by its name; file names are made relative to it.
    pub roots: BTreeMap<String, PathBuf>,
    /// Memory limit for depth maps held at once, bytes; at least two maps are always held.
    pub depth_memory_bytes: u64,
    pub cache: Option<&'a OverlapCache>,
    /// Reader settings of each dataset as stable text, keyed by dataset name. Part of the cache key, because depth
    /// depends on the settings.
    pub settings: BTreeMap<String, String>,
    /// Whether to hash photographs; not needed for counting.
    pub hash_photographs: bool,
    /// Called after each scene with the number of scenes done and in total.
    pub progress: &'a dyn Fn(usize, usize),
    /// Returns whether to stop. Called from any thread, before each depth map, overlap and photograph.
    pub stop: &'a (dyn Fn() -> bool + Sync),
}

impl Default for BuildContext<'_> {
    /// The defaults: ground-truth depth in at most 2 GiB, file names unchanged, photographs hashed, no cache, no
    /// progress.
    fn default() -> Self {
        Self {
            depth: &GroundTruthDepth,
            roots: BTreeMap::new(),
            depth_memory_bytes: 2 << 30,
            cache: None,
            settings: BTreeMap::new(),
            hash_photographs: true,
            progress: &|_, _| {},
            stop: &|| false,
        }
    }
}

/// The pairs of some scenes, with counts and problems.
#[derive(Debug, Clone, Default)]
pub struct PairBuild {
    /// Qualified pairs, sorted bytewise by id.
    pub pairs: Vec<Pair>,
    pub summaries: BTreeMap<String, PairCounts>,
    /// Files that could not be read, each listed once.
    pub problems: Vec<Problem>,
}

impl PairBuild {
    /// Adds the pairs of other datasets; call [`Self::finish`] afterwards to sort.
    pub(super) fn append(&mut self, other: Self) {
        self.pairs.extend(other.pairs);
        self.summaries.extend(other.summaries);
        self.problems.extend(other.problems);
    }

    /// For each view that was left out, the first problem that caused it.
    pub fn left_out(&self) -> impl Iterator<Item = &Problem> {
        let mut seen = BTreeSet::new();
        let needed = self.problems.iter().filter(|problem| problem.is_left_out);
        needed.filter(move |problem| seen.insert((&problem.dataset, &problem.scene, &problem.view)))
    }

    pub(super) fn finish(&mut self) -> Result<(), PairError> {
        self.pairs.sort_by(|a, b| a.pair_id.cmp(&b.pair_id));
        match self.pairs.windows(2).find(|p| p[0].pair_id == p[1].pair_id) {
            Some(twice) => Err(PairError::DuplicatePair(twice[0].pair_id.clone())),
            None => Ok(()),
        }
    }
}

/// A view's depth counts as sparse if its [`density`](crate::pairs::valid_depth::density) is below this value;
/// projected points then rarely hit a pixel with depth.
pub const SPARSE_DENSITY: f64 = 0.3;

/// Counts of a dataset's pairs after each step of the selection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PairCounts {
    pub scenes: usize,
    pub views: usize,
    /// Views of multi-view scenes known to have depth.
    pub with_depth: usize,
    /// Views among `with_depth` whose depth has a density below [`SPARSE_DENSITY`].
    pub with_sparse_depth: usize,
    pub sets: usize,
    /// Ordered pairs of views of one set.
    pub considered: usize,
    /// Considered pairs closer than the minimum baseline.
    pub too_near: usize,
    /// Considered pairs farther apart than the maximum baseline.
    pub too_far: usize,
    pub without_depth: usize,
    /// Considered pairs left out because files of a view cannot be read.
    pub unreadable: usize,
    pub too_little_overlap: usize,
    pub qualified: usize,
    pub selected: usize,
}

impl PairCounts {
    /// Whether most views with depth have sparse depth.
    pub fn is_sparse(&self) -> bool {
        2 * self.with_sparse_depth > self.with_depth
    }
}

/// A file that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    pub dataset: String,
    pub scene: String,
    pub view: String,
    /// The reason, which names the file.
    pub reason: String,
    /// Whether the view is left out because its pairs need the file. Depth is not needed for stereo pairs, nor under
    /// [`MissingDepth::Accept`](super::options::MissingDepth::Accept).
    pub is_left_out: bool,
}

/// Builds the pairs of all scenes.
///
/// A file that cannot be read is a [`Problem`], not an error; other scenes are still processed.
///
/// # Errors
/// [`PairError::Options`] if the options contradict each other; [`PairError::Stopped`] if `stop` returned true;
/// [`PairError::DuplicatePair`] if two scenes have the same dataset and id, or two views of a scene the same id.
pub fn build_pairs(
    scenes: &[Scene],
    options: &PairOptions,
    context: &BuildContext,
) -> Result<PairBuild, PairError> {
    options.validate()?;
    let mut build = PairBuild::default();
    for (done, scene) in scenes.iter().enumerate() {
        let mut work = SceneWork::new(scene, options, context, &mut build);
        match scene.pairing {
            Pairing::Stereo { source, target } => work.one_to_others(source, &[target]),
            Pairing::Star { source } => {
                let others: Vec<usize> = (0..scene.views.len()).filter(|i| *i != source).collect();
                work.one_to_others(source, &others);
            }
            Pairing::MultiView => work.multi_view(),
        }
        work.keep();
        if (context.stop)() {
            return Err(PairError::Stopped);
        }
        (context.progress)(done + 1, scenes.len());
    }
    build.finish()?;
    select(&mut build, options);
    Ok(build)
}

fn select(build: &mut PairBuild, options: &PairOptions) {
    for (dataset, counts) in &mut build.summaries {
        let members: Vec<usize> = (0..build.pairs.len())
            .filter(|&i| build.pairs[i].dataset == *dataset)
            .collect();
        let pairs = members.iter().map(|&i| &build.pairs[i]);
        let pairs: Vec<(&str, f64)> = pairs.map(|p| (p.scene.as_str(), p.baseline_m)).collect();
        let selected = sample(&pairs, &options.sampling);
        for (&i, &selected) in members.iter().zip(&selected) {
            build.pairs[i].selected = selected;
        }
        counts.qualified = members.len();
        counts.selected = selected.iter().filter(|s| **s).count();
    }
}

#[cfg(test)]
mod tests;
