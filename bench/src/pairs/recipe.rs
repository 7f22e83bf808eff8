//! The recipe of a pair list: the open choices, and the files that they need.

use std::collections::BTreeMap;
use std::path::PathBuf;

use sharp_datasets::spec::PaperOverlap;

use super::advice::{advice, sparse_pairs};
use super::ambiguity::{Alternative, OtherReading, alternatives};
use super::build::{BuildContext, PairBuild, Problem, build_pairs};
use super::dataset::{OpenDataset, scenes_of};
use super::dataset_config::DatasetConfig;
use super::depth::{
    DepthNetwork, DepthSource, GivenDepth, GroundTruthDepth, PredictedDepth, ScaledToGroundTruth,
};
use super::error::PairError;
use super::options::{OverlapDepth, PairOptions};
use super::overlap_cache::OverlapCache;
use super::pair_list::PairList;
use super::provenance::{DepthMaps, PairProvenance};
use crate::io::checkpoint::{depth_pro_network, find_depth_pro, named_network};
use crate::io::observer::Observer;
use crate::pairs::PairOverrides;

/// The open choices behind a dataset's pairs, and the files that these choices need.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PairRecipe {
    pub options: PairOptions,
    /// User-supplied depth maps, `DIR/<dataset>/<scene>/<view>.npy|npz|exr|pfm|png`.
    pub overlap_depth: Option<PathBuf>,
    /// Checkpoint for `overlap=sharp-release` or `overlap=depth-pro`; `None` for the one that is found on this machine.
    pub overlap_checkpoint: Option<PathBuf>,
    /// Architecture of the checkpoint, `FILE.json#NAME`; `None` for the release's.
    pub overlap_config: Option<String>,
}

/// A built list with its provenance.
#[derive(Debug, Clone)]
pub struct BuiltList {
    pub build: PairBuild,
    pub provenance: BTreeMap<String, PairProvenance>,
    /// One sentence for each dataset without a selected pair, or with depth that is too sparse for the choices.
    pub advice: Vec<String>,
    /// Notes on the pairs of each dataset, to be added to its record.
    pub notes: BTreeMap<String, String>,
}

struct OpenDepth {
    source: Box<dyn DepthSource>,
    given: Option<GivenDepth>,
    checkpoint_sha256: Option<String>,
}

impl OpenDepth {
    fn new(source: impl DepthSource + 'static) -> Self {
        Self {
            source: Box::new(source),
            given: None,
            checkpoint_sha256: None,
        }
    }

    fn predicted(network: PredictedDepth) -> Self {
        Self {
            checkpoint_sha256: Some(network.checkpoint_sha256().to_owned()),
            ..Self::new(ScaledToGroundTruth(network))
        }
    }
}

const NEEDS_DEPTH_PRO: &str = "overlap=depth-pro needs depth_pro.pt, which is neither in torch's hub folder nor in \
                               sharp-bench's cache; pass the file with --overlap-checkpoint FILE";

impl PairRecipe {
    /// A recipe that uses the dataset's own depth.
    pub fn new(options: PairOptions) -> Self {
        Self {
            options,
            ..Self::default()
        }
    }

    /// Checks that choices and files fit together. If depth maps are given and no source of depth is set, sets
    /// `overlap=given`.
    ///
    /// # Errors
    /// [`PairError::Recipe`] names the option that is missing or not applicable.
    pub fn checked(mut self) -> Result<Self, PairError> {
        if self.overlap_depth.is_some() && self.options.depth.is_ground_truth() {
            self.options.depth = OverlapDepth::Given;
        }
        let depth = self.options.depth;
        let given = depth.takes_maps();
        if given != self.overlap_depth.is_some() {
            let needs = if given { "needs" } else { "does not take" };
            let reason = format!("overlap={depth} {needs} --overlap-depth DIR");
            return Err(PairError::Recipe(reason));
        }
        if !depth.takes_checkpoint() && self.overlap_checkpoint.is_some() {
            let reason = "--overlap-checkpoint applies only to --pair-options overlap=sharp-release or overlap=depth-pro";
            return Err(PairError::Recipe(reason.to_owned()));
        }
        if depth == OverlapDepth::DepthPro && self.overlap_checkpoint.is_none() {
            self.overlap_checkpoint = find_depth_pro();
        }
        if depth == OverlapDepth::DepthPro && self.overlap_checkpoint.is_none() {
            return Err(PairError::Recipe(NEEDS_DEPTH_PRO.to_owned()));
        }
        Ok(self)
    }

    /// The recipe for a dataset: this recipe, overridden by the dataset's own pair options.
    pub fn of(&self, dataset: &OpenDataset) -> Result<Self, PairError> {
        let own = &dataset.config.pairs;
        let named = |error: PairError| PairError::DatasetSpec {
            spec: dataset.config.to_string(),
            reason: error.to_string(),
        };
        let options = self.options.with(&own.options_text()).map_err(named)?;
        let mut common = self.clone();
        // If the dataset has its own source of depth, drop those common files that this source does not use.
        if own.options.contains_key("overlap") {
            common
                .overlap_depth
                .take_if(|_| !options.depth.takes_maps());
            common
                .overlap_checkpoint
                .take_if(|_| !options.depth.takes_checkpoint());
        }
        let mut recipe = Self {
            options,
            overlap_depth: own.overlap_depth.clone().or(common.overlap_depth),
            overlap_checkpoint: own.overlap_checkpoint.clone().or(common.overlap_checkpoint),
            overlap_config: own.overlap_config.clone().or(common.overlap_config),
        };
        recipe = recipe.checked().map_err(named)?;
        if recipe.options.depth == OverlapDepth::Auto {
            recipe.resolve(dataset.config.spec.entry.paper_overlap);
        }
        Ok(recipe)
    }

    /// Replaces [`OverlapDepth::Auto`] by [`OverlapDepth::DepthPro`] where the paper predicts depth and the checkpoint
    /// is found, otherwise by [`OverlapDepth::GroundTruth`].
    fn resolve(&mut self, paper: PaperOverlap) {
        self.overlap_checkpoint = match paper {
            PaperOverlap::Sparse => find_depth_pro(),
            PaperOverlap::Stereo | PaperOverlap::Dense => None,
        };
        self.options.depth = match self.overlap_checkpoint {
            Some(_) => OverlapDepth::DepthPro,
            None => OverlapDepth::GroundTruth,
        };
    }

    /// If the dataset's source of depth is [`OverlapDepth::Auto`], stores the source that this machine selects in the
    /// dataset's own options, so that the configuration gives the same pairs on machines with other weights.
    pub fn pin(&self, dataset: &mut DatasetConfig) {
        let own = &mut dataset.pairs;
        let paper = dataset.spec.entry.paper_overlap;
        if self.options.depth != OverlapDepth::Auto
            || own.options.contains_key("overlap")
            || own.overlap_depth.is_some()
            || paper != PaperOverlap::Sparse
        {
            return;
        }
        let mut recipe = self.clone();
        recipe.resolve(paper);
        let depth = recipe.options.depth.to_string();
        own.options.insert("overlap".to_owned(), depth);
        own.overlap_checkpoint = recipe.overlap_checkpoint;
    }

    /// Builds the pair list of opened datasets, each by its own recipe. Warns about files that cannot be read.
    ///
    /// # Errors
    /// If choices are inconsistent, or requested depth does not exist.
    pub fn build(
        &self,
        datasets: &[OpenDataset],
        cache: Option<&OverlapCache>,
        observer: &dyn Observer,
    ) -> Result<BuiltList, PairError> {
        let mut built = BuiltList {
            build: PairBuild::default(),
            provenance: BTreeMap::new(),
            advice: Vec::new(),
            notes: BTreeMap::new(),
        };
        let scenes: usize = datasets.iter().map(|dataset| dataset.scenes.len()).sum();
        observer.begin("building the pair list", scenes, "scenes");
        let mut before = 0;
        for dataset in datasets {
            let recipe = self.of(dataset)?;
            let depth = recipe.depth()?;
            let advance = |done: usize, _: usize| observer.progress(before + done, &dataset.name);
            let of_dataset = std::slice::from_ref(dataset);
            let stop = || observer.stop();
            let context = BuildContext {
                stop: &stop,
                ..context(of_dataset, depth.source.as_ref(), cache, &advance)
            };
            let found = build_pairs(&dataset.scenes, &recipe.options, &context)?;
            before += dataset.scenes.len();
            if let Some(counts) = found.summaries.get(&dataset.name) {
                let problems: Vec<&Problem> = found.left_out().collect();
                let spec = &dataset.config.spec;
                built
                    .advice
                    .extend(advice(spec, counts, &problems, &recipe.options));
                if let Some(note) = sparse_pairs(counts, &recipe.options) {
                    built.notes.insert(dataset.name.clone(), note);
                }
            }
            built
                .provenance
                .insert(dataset.name.clone(), recipe.provenance(dataset, &depth)?);
            built.build.append(found);
        }
        observer.end();
        let others = built.build.problems.iter();
        for problem in others.filter(|problem| !problem.is_left_out) {
            observer.warn(&problem.reason);
        }
        warn(cache, observer);
        built.build.finish()?;
        Ok(built)
    }

    fn provenance(
        &self,
        dataset: &OpenDataset,
        depth: &OpenDepth,
    ) -> Result<PairProvenance, PairError> {
        let maps = match &depth.given {
            None => None,
            Some(given) => match given.digest(&dataset.scenes)? {
                (0, _) => {
                    let reason = format!(
                        "--overlap-depth has no map for any view of '{}'",
                        dataset.name
                    );
                    return Err(PairError::Recipe(reason));
                }
                (count, sha256) => Some(DepthMaps { count, sha256 }),
            },
        };
        Ok(PairProvenance {
            options: self.options.clone(),
            overlap_depth: depth.source.name(),
            overlap_depth_maps: maps,
            overlap_checkpoint: depth.checkpoint_sha256.clone(),
        })
    }

    /// The number of pairs under each alternative to an open choice, and under each alternative reading of the
    /// datasets. The source of depth is not varied.
    pub fn ambiguity(
        &self,
        datasets: &[OpenDataset],
        readings: &[OtherReading],
        cache: Option<&OverlapCache>,
        observer: &dyn Observer,
    ) -> Result<Vec<Alternative>, PairError> {
        let of_common = PairOverrides::default();
        if let Some(own) = datasets.iter().find(|d| d.config.pairs != of_common) {
            return Err(PairError::DatasetSpec {
                spec: own.config.to_string(),
                reason:
                    "--ambiguity varies one set of pair options for all datasets; remove those of this spec and use \
                     --pair-options"
                        .to_owned(),
            });
        }
        let mut base = self.options.clone();
        if base.depth == OverlapDepth::Auto {
            base.depth = OverlapDepth::GroundTruth;
        }
        let depth = self.depth()?;
        observer.begin("counting pairs", 0, "choices");
        let advance = |done: usize, _: usize| observer.progress(done, "");
        let context = context(datasets, depth.source.as_ref(), cache, &|_, _| {});
        let scenes = scenes_of(datasets);
        let rows = alternatives(&scenes, &base, readings, &context, &advance)?;
        observer.end();
        warn(cache, observer);
        Ok(rows)
    }

    fn depth(&self) -> Result<OpenDepth, PairError> {
        let given = || match &self.overlap_depth {
            Some(dir) => GivenDepth::open(dir),
            None => Err(PairError::Recipe(
                "--overlap-depth DIR is needed".to_owned(),
            )),
        };
        let mut depth = match self.options.depth {
            OverlapDepth::Auto | OverlapDepth::GroundTruth | OverlapDepth::Sparse { .. } => {
                return Ok(OpenDepth::new(GroundTruthDepth));
            }
            OverlapDepth::Given => OpenDepth::new(ScaledToGroundTruth(given()?)),
            OverlapDepth::GivenMetric => OpenDepth::new(given()?),
            OverlapDepth::SharpRelease => {
                let config = self.overlap_config.as_deref();
                let network = named_network(self.overlap_checkpoint.as_deref(), config)?;
                let network = PredictedDepth::new(network, DepthNetwork::Sharp)?;
                return Ok(OpenDepth::predicted(network));
            }
            OverlapDepth::DepthPro => {
                let needed = || PairError::Recipe(NEEDS_DEPTH_PRO.to_owned());
                let checkpoint = self.overlap_checkpoint.as_deref().ok_or_else(needed)?;
                let network = depth_pro_network(checkpoint, self.overlap_config.as_deref())?;
                let network = PredictedDepth::new(network, DepthNetwork::DepthPro)?;
                return Ok(OpenDepth::predicted(network));
            }
        };
        depth.given = Some(given()?);
        Ok(depth)
    }
}

impl BuiltList {
    /// Converts the pairs to a list to be written to `path`.
    pub fn list(&self, path: impl Into<PathBuf>) -> PairList {
        PairList::new(path, self.build.pairs.clone())
    }

    /// Source of the depth used for overlap, if it is the same for all datasets.
    pub fn common_depth(&self) -> Option<&str> {
        let mut depths = self
            .provenance
            .values()
            .map(|choices| &choices.overlap_depth);
        let first = depths.next()?;
        depths.all(|depth| depth == first).then_some(first)
    }

    pub fn has_selected(&self) -> bool {
        self.build.pairs.iter().any(|pair| pair.selected)
    }
}

fn context<'a>(
    datasets: &[OpenDataset],
    depth: &'a dyn DepthSource,
    cache: Option<&'a OverlapCache>,
    progress: &'a dyn Fn(usize, usize),
) -> BuildContext<'a> {
    let roots = datasets.iter();
    let roots = roots.filter_map(|d| Some((d.name.clone(), d.root()?.to_owned())));
    let settings = datasets.iter();
    let settings = settings.map(|d| (d.name.clone(), d.settings.clone()));
    BuildContext {
        depth,
        roots: roots.collect(),
        cache,
        settings: settings.collect(),
        progress,
        ..BuildContext::default()
    }
}

fn warn(cache: Option<&OverlapCache>, observer: &dyn Observer) {
    for warning in cache.map(OverlapCache::take_warnings).unwrap_or_default() {
        observer.warn(&warning);
    }
}

/// Source of the pairs.
#[derive(Debug)]
pub enum PairOrigin {
    /// Built from the datasets.
    Built {
        /// The common choices; a dataset may override them.
        recipe: Box<PairRecipe>,
        cache: Option<OverlapCache>,
    },
    /// An existing list, read from this path.
    Given(PathBuf),
    /// The list of the plan in the run folder at this path.
    Planned(PathBuf),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dataset_changes_the_common_choices_for_itself() {
        let open = |options: &str| {
            let text = format!("S:synthetic=size=48x36,views=2{options}");
            OpenDataset::open_recorded(&text.parse().unwrap(), &[], None).unwrap()
        };
        let common = PairRecipe {
            overlap_depth: Some("maps".into()),
            ..PairRecipe::new("threshold=0.5".parse().unwrap())
        };
        let common = common.checked().unwrap();
        assert_eq!(common.of(&open("")).unwrap(), common);
        let dense = common.of(&open(",pairs.overlap=ground-truth")).unwrap();
        assert_eq!(dense.overlap_depth, None);
        assert_eq!(dense.options.threshold, 0.5);
        let metric = common.of(&open(",pairs.overlap=given-metric,pairs.size=4"));
        let metric = metric.unwrap();
        assert_eq!(metric.overlap_depth, common.overlap_depth);
        assert_eq!(metric.options.sets.size, 4);
        let own = common.of(&open(",pairs.overlap-depth=mine")).unwrap();
        assert_eq!(own.overlap_depth, Some("mine".into()));
        let pro = ",pairs.overlap=depth-pro,pairs.overlap-checkpoint=d.pt";
        let pro = common.of(&open(pro)).unwrap();
        assert_eq!(
            (pro.overlap_depth, pro.overlap_checkpoint),
            (None, Some("d.pt".into()))
        );
        for wrong in [
            ",pairs.size=1",
            ",pairs.overlap=depth-pro",
            ",pairs.overlap=sharp-release,pairs.overlap-depth=x",
        ] {
            let error = common.of(&open(wrong)).unwrap_err();
            assert!(matches!(error, PairError::DatasetSpec { .. }), "{error}");
        }
    }
}
