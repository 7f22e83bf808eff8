//! Prepares an evaluation from datasets, pairs, methods and metrics.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use sharp::render::Backend;
use sharp_datasets::Scene;
use sharp_datasets::left_out::LeftOutViews;

use super::aggregation::Aggregation;
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::job::{Job, RunOptions};
use super::keys::{Keys, dataset_identity};
use super::manifest::{
    DatasetRecord, FORMAT, ListOrigin, ListRecord, Manifest, PairsRecord, ProtocolRecord,
    RendererRecord, metric_records, scoring_conventions,
};
use super::picture_check::sample::PictureSample;
use super::plan::RunStatus;
use super::score::missing;
use super::shard::Shard;
use super::unit::{Unit, UnitProgress};
use crate::config::RunConfig;
use crate::io::counts::counted;
use crate::io::fingerprints;
use crate::io::machine::monotonic;
use crate::io::observer::Observer;
use crate::methods::spec::check_label;
use crate::methods::{BuiltMethod, Method, MethodSpec, SpecError};
use crate::pairs::dataset::scenes_of;
use crate::pairs::pair_list::ResolvedPair;
use crate::pairs::provenance::ListCompanion;
use crate::pairs::sampling::spread;
use crate::pairs::{OpenDataset, PairError, PairList, PairOrigin, PairProvenance, SceneChecks};
use crate::rendering::{RenderSettings, SharedRenderer};
use crate::scoring::Scoring;

/// Input of [`prepare`].
pub struct Request {
    pub datasets: Vec<OpenDataset>,
    /// Checks of scenes for contradictions, made before anything else; `None` skips them.
    pub checks: Option<SceneChecks>,
    /// The pattern of `--scenes`, to be recorded in the manifest.
    pub only_scenes: Option<String>,
    pub pairs: PairOrigin,
    /// Evaluate at most this many of the selected pairs, spread over datasets and scenes.
    pub limit: Option<usize>,
    /// Methods, with the specs to record in the manifest. Labels must be unique.
    pub methods: Vec<BuiltMethod>,
    pub scoring: Scoring,
    /// Whether to score all methods of a pair on the region that all of them predict.
    pub common_region: bool,
    pub aggregation: Aggregation,
    /// The protocol that the run follows, to be recorded in the manifest.
    pub protocol: Option<ProtocolRecord>,
    pub backend: Backend,
    pub rendering: RenderSettings,
    /// The configuration that the request was made from, to be stored in the run folder; `None` if code made the
    /// request.
    pub config: Option<RunConfig>,
}

impl Request {
    /// A request with defaults: all pairs by the paper's rules, rendered on the CPU.
    pub fn new(
        datasets: Vec<OpenDataset>,
        methods: Vec<Box<dyn Method>>,
        scoring: Scoring,
    ) -> Self {
        let methods = methods.into_iter();
        Self {
            datasets,
            checks: None,
            only_scenes: None,
            pairs: PairOrigin::Built {
                recipe: Box::default(),
                cache: None,
            },
            limit: None,
            methods: methods.map(|method| (None, method)).collect(),
            scoring,
            common_region: false,
            aggregation: Aggregation::default(),
            protocol: None,
            backend: Backend::Cpu,
            rendering: RenderSettings::default(),
            config: None,
        }
    }
}

pub struct Evaluation {
    pub(super) datasets: Vec<OpenDataset>,
    only_scenes: Option<String>,
    pub(super) scenes: Vec<Scene>,
    pub(super) list: PairList,
    origin: ListOrigin,
    choices: BTreeMap<String, PairProvenance>,
    pair_notes: BTreeMap<String, String>,
    limit: Option<usize>,
    specs: Vec<Option<MethodSpec>>,
    pub(super) config: Option<RunConfig>,
    /// [`DatasetRecord::unreadable_views`] by dataset, taken from the plan, because shards do not build pairs.
    planned_unreadable: BTreeMap<String, usize>,
    pub(super) methods: Vec<Box<dyn Method>>,
    pub(super) scoring: Scoring,
    pub(super) common_region: bool,
    aggregation: Aggregation,
    protocol: Option<ProtocolRecord>,
    pub(super) renderer: SharedRenderer,
    /// Clock for timing; see [`Job::clock`].
    pub(super) clock: fn() -> Duration,
}

/// Checks scenes and methods, and builds or reads the pair list. Writes only to the cache of overlaps.
///
/// # Errors
/// If a part of the request is invalid, or no pair is left.
pub fn prepare(mut request: Request, observer: &dyn Observer) -> Result<Evaluation, EvaluateError> {
    let mut labels = BTreeSet::new();
    for (_, method) in &request.methods {
        let label = method.label();
        if let Err(reason) = check_label(label) {
            let spec = label.to_owned();
            return Err(SpecError::Refused { spec, reason }.into());
        }
        if !labels.insert(label) {
            return Err(EvaluateError::RepeatedLabel(label.to_owned()));
        }
    }
    if let Some(checks) = &request.checks {
        let datasets = request.datasets.iter_mut();
        datasets.for_each(|dataset| checks.look_at(dataset, observer));
    }
    let scenes = scenes_of(&request.datasets);
    let mut planned_unreadable: BTreeMap<String, usize> = BTreeMap::new();
    let mut pair_notes = BTreeMap::new();
    let (list, origin, choices) = match request.pairs {
        PairOrigin::Built { recipe, cache } => {
            let configs = request.config.iter_mut().flat_map(|c| &mut c.datasets);
            configs.for_each(|dataset| recipe.pin(dataset));
            let built = recipe.build(&request.datasets, cache.as_ref(), observer)?;
            // Record the files that cause missing pairs, for the manifest and the report.
            for problem in built.build.left_out() {
                let mut scenes = request.datasets.iter_mut().flat_map(|d| &mut d.scenes);
                let is_of = |scene: &&mut Scene| {
                    (&scene.dataset, &scene.id) == (&problem.dataset, &problem.scene)
                };
                if let Some(scene) = scenes.find(is_of) {
                    LeftOutViews::add(&mut scene.left_out, &problem.reason, &problem.view);
                }
            }
            if !built.has_selected() {
                return Err(PairError::NoPair(built.advice.join("; ")).into());
            }
            for advice in &built.advice {
                observer.warn(advice);
            }
            pair_notes.clone_from(&built.notes);
            (built.list("pairs.csv"), ListOrigin::Built, built.provenance)
        }
        PairOrigin::Given(path) => {
            let list = PairList::read(&path)?;
            pair_notes = check_files(&list, &scenes, observer)?;
            let left = list.pairs.len() - list.resolve_readable(&scenes, &request.datasets)?.len();
            if left > 0 {
                let all = list.pairs.len();
                observer.warn(&format!(
                    "{left} of the {all} pairs in the list are not evaluated, because their scenes or \
                     views cannot be read"
                ));
            }
            let companion = ListCompanion::of(&list);
            let choices = companion.map(|companion| companion.choices);
            (list, ListOrigin::Given, choices.unwrap_or_default())
        }
        // Each shard checks its own part of the list.
        PairOrigin::Planned(root) => {
            let folder = RunFolder::open(&root)?;
            if let Some(planned) = folder.manifest()? {
                let counts = planned.datasets.into_iter();
                planned_unreadable.extend(counts.map(|d| (d.name, d.unreadable_views)));
            }
            let list = PairList::read(&folder.pairs_path())?;
            (list, ListOrigin::Given, BTreeMap::new())
        }
    };
    let (specs, methods): (Vec<_>, Vec<Box<dyn Method>>) = request.methods.into_iter().unzip();
    check_independence(&choices, &methods)?;
    for method in &methods {
        for note in method.notes() {
            observer.warn(&format!("method '{}': {note}", method.label()));
        }
    }
    let evaluation = Evaluation {
        datasets: request.datasets,
        only_scenes: request.only_scenes,
        scenes,
        list,
        origin,
        choices,
        pair_notes,
        limit: request.limit,
        specs,
        config: request.config,
        planned_unreadable,
        methods,
        scoring: request.scoring,
        common_region: request.common_region,
        aggregation: request.aggregation,
        protocol: request.protocol,
        renderer: SharedRenderer::open(&request.backend, request.rendering)?,
        clock: monotonic,
    };
    let pairs = evaluation.pairs()?;
    if pairs.is_empty() {
        let reason = match evaluation.list.pairs.len() {
            0 => "the pair list is empty".to_owned(),
            n => format!(
                "the list has {}, none of which is selected",
                counted(n, "pair")
            ),
        };
        return Err(PairError::NoPair(reason).into());
    }
    let ids: BTreeSet<String> = pairs.iter().map(|p| p.pair.pair_id.clone()).collect();
    drop(pairs);
    for (method, spec) in evaluation.methods.iter().zip(&evaluation.specs) {
        method.check_files(&ids).map_err(|reason| {
            let spec = spec
                .as_ref()
                .map_or(method.label().to_owned(), MethodSpec::to_string);
            SpecError::Refused { spec, reason }
        })?;
    }
    Ok(evaluation)
}

/// Fails if a method would be evaluated on pairs chosen by its own checkpoint.
fn check_independence(
    choices: &BTreeMap<String, PairProvenance>,
    methods: &[Box<dyn Method>],
) -> Result<(), EvaluateError> {
    let checkpoints = choices
        .values()
        .filter_map(|c| c.overlap_checkpoint.as_ref());
    for checkpoint in checkpoints {
        let chooser = methods
            .iter()
            .find(|method| method.identity().settings.get("checkpoint") == Some(checkpoint));
        if let Some(method) = chooser {
            return Err(EvaluateError::ChosenByMethod {
                method: method.label().to_owned(),
            });
        }
    }
    Ok(())
}

/// Warns if the list was made from other photographs; returns the warnings by dataset, as notes for the manifest. Fails if
/// it was made from other poses: pairs are sorted and plotted by baselines and rotations, which would be wrong.
fn check_files(
    list: &PairList,
    scenes: &[Scene],
    observer: &dyn Observer,
) -> Result<BTreeMap<String, String>, PairError> {
    let found = list.verify(scenes);
    if let Some(first) = found.moved.first() {
        let ([listed_m, found_m], [listed_deg, found_deg]) = (first.baseline_m, first.rotation_deg);
        return Err(PairError::List {
            path: list.path.clone(),
            line: first.line,
            reason: format!(
                "the cameras in the files differ from those in the list for {}, such as {}: source and target are \
                 {found_m} m and {found_deg}° apart in the files, but {listed_m} m and {listed_deg}° in the list; the \
                 list was made from other poses or with other settings; `pairs verify` lists the \
                 differences, and `pairs` builds a new list",
                counted(found.moved.len(), "pair"),
                first.pair_id,
            ),
        });
    }
    let mut different: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for mismatch in found.different {
        let view = format!("{}/{}", mismatch.scene, mismatch.view);
        different.entry(mismatch.dataset).or_default().insert(view);
    }
    let notes = different.into_iter().map(|(dataset, views)| {
        let first = views.first().map_or("", String::as_str);
        let text = format!(
            "{} from those of the pair list, such as {first}, so the list's overlaps and selection may not apply; \
             `pairs verify` lists the differences, and `pairs` builds a new list",
            match views.len() {
                1 => "a photograph differs".to_owned(),
                n => format!("{n} photographs differ"),
            }
        );
        observer.warn(&format!("{dataset}: {text}"));
        (dataset, format!("warning: {text}"))
    });
    Ok(notes.collect())
}

impl Evaluation {
    /// The selected pairs, sorted by id; with a limit, a [`spread`] sample over datasets and scenes.
    pub(super) fn pairs(&self) -> Result<Vec<ResolvedPair<'_>>, EvaluateError> {
        let mut pairs = self.list.resolve_readable(&self.scenes, &self.datasets)?;
        pairs.retain(|resolved| resolved.pair.selected);
        pairs.sort_by(|a, b| a.pair.pair_id.cmp(&b.pair.pair_id));
        Ok(match self.limit {
            Some(limit) => spread(&pairs, limit),
            None => pairs,
        })
    }

    pub(super) fn job<'a>(
        &'a self,
        pairs: Vec<ResolvedPair<'a>>,
        (checked, sample): (BTreeSet<String>, PictureSample<'a>),
        keys: &'a Keys,
        options: RunOptions,
        shard: Shard,
    ) -> Job<'a> {
        Job {
            pairs,
            checked,
            sample,
            methods: &self.methods,
            scoring: &self.scoring,
            renderer: &self.renderer,
            keys,
            options,
            clock: self.clock,
            shard,
        }
    }

    /// The manifest that a run into a new folder would write.
    ///
    /// # Errors
    /// If a listed pair is not in the datasets.
    pub fn manifest(&self) -> Result<Manifest, EvaluateError> {
        let dataset = |dataset: &OpenDataset| DatasetRecord {
            name: dataset.name.clone(),
            spec: Some(dataset.config.without_pairs()),
            format: dataset.config.spec.entry.format.to_owned(),
            identity: dataset_identity(dataset),
            only_scenes: self.only_scenes.clone(),
            scenes: dataset.scenes.len(),
            views: dataset.scenes.iter().map(|scene| scene.views.len()).sum(),
            view_sizes: view_sizes(dataset),
            readings: dataset.readings.clone(),
            notes: {
                let of_pairs = self.pair_notes.get(&dataset.name).cloned();
                dataset.notes().into_iter().chain(of_pairs).collect()
            },
            left_out: dataset.left_out.clone(),
            unreadable_views: {
                let planned = self.planned_unreadable.get(&dataset.name).copied();
                dataset.unreadable_views().max(planned.unwrap_or(0))
            },
        };
        let methods = self.specs.iter().zip(&self.methods);
        let evaluated = self.pairs()?.len();
        let keys = Keys::new(&self.datasets, &RendererRecord::of(&self.renderer));
        Ok(Manifest {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            sources: fingerprints::all(),
            renderer: RendererRecord::of(&self.renderer),
            kernels: self.scoring.scorer.options().simd.instruction_set(),
            metric_networks: self.scoring.scorer.options().arithmetic(),
            scoring: scoring_conventions(
                self.renderer.settings().quantization,
                self.scoring.rules,
                self.aggregation,
            ),
            common_region: self.common_region,
            aggregation: self.aggregation,
            rules: self.scoring.rules,
            protocol: self.protocol.clone(),
            datasets: self.datasets.iter().map(dataset).collect(),
            pairs: PairsRecord {
                sha256: self.list.sha256.clone(),
                listed: self.list.pairs.len(),
                evaluated,
                lists: vec![ListRecord {
                    sha256: self.list.sha256.clone(),
                    listed: self.list.pairs.len(),
                    evaluated,
                    limit: self.limit,
                    origin: self.origin,
                    choices: self.choices.clone(),
                }],
            },
            methods: methods
                .map(|(spec, method)| keys.method_record(method.as_ref(), spec.as_ref()))
                .collect(),
            metrics: metric_records(&self.scoring),
        })
    }

    /// Progress of this evaluation in a folder; without a folder, all units are missing.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn status(&self, root: Option<&Path>) -> Result<RunStatus, EvaluateError> {
        let pairs = self.pairs()?;
        let mut standing = RunStatus::default();
        let Some(Ok(folder)) = root.map(RunFolder::open) else {
            standing.units = pairs.len() * self.methods.len();
            standing.missing = standing.units;
            return Ok(standing);
        };
        let keys = Keys::new(&self.datasets, &RendererRecord::of(&self.renderer));
        for planned in &pairs {
            for method in &self.methods {
                let unit = folder.load(&keys.slot(method.as_ref(), planned))?;
                let key = keys.picture(method.as_ref(), planned).picture;
                let lacks_scores =
                    |unit: &Unit| !missing(unit, &self.scoring, &keys, planned).is_empty();
                standing.add(match unit {
                    // A failed unit has no picture, so there is no key to compare.
                    Some(unit) if unit.is_failure() || unit.picture_key == key => {
                        unit.progress(lacks_scores(&unit))
                    }
                    _ => UnitProgress::Missing,
                });
            }
        }
        Ok(standing)
    }
}

/// Sizes of the views with the fewest and with the most pixels; one entry if they are equal.
fn view_sizes(dataset: &OpenDataset) -> Vec<(u32, u32)> {
    let views = dataset.scenes.iter().flat_map(|scene| &scene.views);
    let sizes = views.map(|view| (view.intrinsics.width, view.intrinsics.height));
    let sizes: BTreeSet<(u64, (u32, u32))> = sizes
        .map(|(width, height)| (u64::from(width) * u64::from(height), (width, height)))
        .collect();
    let ends = [sizes.first(), sizes.last()].into_iter().flatten();
    let mut ends: Vec<(u32, u32)> = ends.map(|(_, size)| *size).collect();
    ends.dedup();
    ends
}
