//! What `run` and `demo` share: open, pair, plan, execute, write.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::bail;
use sharp::render::Backend;
use sharp_datasets::Scene;

use super::data_args::{self, OpenDataset};
use super::list_facts::ListFacts;
use super::pair_args::PairOrigin;
use super::usage::UsageError;
use super::{output, progress};
use crate::durable::write_atomic;
use crate::methods::scale_sweep::ScaleChooser;
use crate::methods::{self, KINDS, Method, MethodSpec};
use crate::protocol::PairList;
use crate::protocol::pair_list::ResolvedPair;
use crate::rendering::SharedRenderer;
use crate::runs::execute::{Executed, execute};
use crate::runs::manifest::{
    DatasetFacts, FORMAT, Manifest, MethodFacts, PairFacts, scoring_facts,
};
use crate::runs::metric_facts::MetricFacts;
use crate::runs::plan::{Keep, RunPlan, Scoring};
use crate::runs::scores::{scores_csv, timings_csv};
use crate::runs::store::RunFolder;
use crate::runs::unit::SOURCE_FINGERPRINT;

/// Everything that decides what is evaluated.
pub(super) struct Evaluation {
    datasets: Vec<OpenDataset>,
    scenes: Vec<Scene>,
    list: PairList,
    facts: ListFacts,
    specs: Vec<MethodSpec>,
    methods: Vec<Box<dyn Method>>,
    scoring: Scoring,
    limit: Option<usize>,
    only_scenes: Option<String>,
    common_region: bool,
    renderer: SharedRenderer,
}

/// What is to be evaluated, as given.
pub(super) struct Request<'a> {
    pub(super) datasets: &'a [String],
    pub(super) scenes: Option<&'a str>,
    pub(super) pairs: PairOrigin,
    pub(super) methods: &'a [String],
    pub(super) scoring: Scoring,
    pub(super) limit: Option<usize>,
    pub(super) common_region: bool,
    pub(super) backend: &'a Backend,
    /// Chooses among the scales of methods that have several.
    pub(super) chooser: Option<Arc<ScaleChooser>>,
}

/// A finished run.
pub(super) struct Finished {
    pub(super) folder: RunFolder,
    pub(super) manifest: Manifest,
    pub(super) executed: Executed,
    pub(super) scenes: Vec<Scene>,
}

impl Evaluation {
    /// Opens datasets, builds or reads the pair list, builds methods. Writes nothing.
    pub(super) fn prepare(request: Request) -> anyhow::Result<Self> {
        let specs: Vec<MethodSpec> = request
            .methods
            .iter()
            .map(|text| text.parse())
            .collect::<Result<_, _>>()?;
        if let Some(spec) = specs
            .iter()
            .find(|spec| KINDS.iter().all(|kind| kind.name != spec.kind))
        {
            let known: Vec<&str> = KINDS.iter().map(|kind| kind.name).collect();
            let reason = format!(
                "--method {}: unknown kind; known: {}",
                spec.text,
                known.join(", ")
            );
            return Err(UsageError(reason).into());
        }
        let methods = methods::build(&specs, request.chooser.as_ref())?;
        let datasets = data_args::open(request.datasets, request.scenes)?;
        let scenes: Vec<Scene> = datasets.iter().flat_map(|d| d.scenes.clone()).collect();
        let (list, facts) = match &request.pairs {
            PairOrigin::Built(recipe) => {
                let built = recipe.build(&datasets)?;
                if built.pairs.pairs.iter().all(|pair| !pair.selected) {
                    bail!("no pair to evaluate: {}", built.advice.join("; "));
                }
                for advice in &built.advice {
                    output::remark(format!("warning: {advice}"));
                }
                let facts = ListFacts::of_built(&built, &methods)?;
                (PairList::new("pairs.csv", built.pairs.pairs), facts)
            }
            PairOrigin::Given(path) => {
                let list = PairList::read(path)?;
                warn_of_other_files(&list, &scenes);
                let facts = ListFacts::of_given(&list, &methods)?;
                (list, facts)
            }
        };
        let evaluation = Self {
            datasets,
            scenes,
            list,
            facts,
            specs,
            methods,
            scoring: request.scoring,
            limit: request.limit,
            only_scenes: request.scenes.map(str::to_owned),
            common_region: request.common_region,
            renderer: SharedRenderer::open(request.backend)?,
        };
        if evaluation.limit == Some(0) {
            return Err(UsageError("--limit 0: no pair to evaluate".to_owned()).into());
        }
        if evaluation.pairs()?.is_empty() {
            match evaluation.list.pairs.len() {
                0 => bail!("no pair to evaluate: the pair list is empty"),
                n => bail!("no pair to evaluate: none of the {n} in the list is selected"),
            }
        }
        Ok(evaluation)
    }

    /// The selected pairs by id. A limit takes the first of each dataset in turn, so that every one is tried.
    pub(super) fn pairs(&self) -> anyhow::Result<Vec<ResolvedPair<'_>>> {
        let mut pairs = self.list.resolve(&self.scenes)?;
        pairs.retain(|resolved| resolved.pair.selected);
        pairs.sort_by(|a, b| a.pair.pair_id.cmp(&b.pair.pair_id));
        let Some(limit) = self.limit else {
            return Ok(pairs);
        };
        let mut taken: BTreeMap<&str, usize> = BTreeMap::new();
        let mut turns: Vec<(usize, ResolvedPair<'_>)> = Vec::with_capacity(pairs.len());
        for resolved in pairs {
            let turn = taken.entry(resolved.pair.dataset.as_str()).or_default();
            turns.push((*turn, resolved));
            *turn += 1;
        }
        turns.sort_by_key(|(turn, _)| *turn);
        turns.truncate(limit);
        let mut pairs: Vec<ResolvedPair<'_>> = turns.into_iter().map(|(_, pair)| pair).collect();
        pairs.sort_by(|a, b| a.pair.pair_id.cmp(&b.pair.pair_id));
        Ok(pairs)
    }

    /// What a run would do.
    pub(super) fn manifest(&self) -> anyhow::Result<Manifest> {
        let facts = |dataset: &OpenDataset| DatasetFacts {
            name: dataset.name.clone(),
            spec: dataset.spec.clone(),
            only_scenes: self.only_scenes.clone(),
            scenes: dataset.scenes.len(),
            views: dataset.scenes.iter().map(|scene| scene.views.len()).sum(),
            notes: dataset.notes(),
        };
        Ok(Manifest {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            source_fingerprint: SOURCE_FINGERPRINT.to_owned(),
            backend: self.renderer.name().to_owned(),
            datasets: self.datasets.iter().map(facts).collect(),
            pairs: PairFacts {
                sha256: self.list.sha256.clone(),
                listed: self.list.pairs.len(),
                evaluated: self.pairs()?.len(),
                limit: self.limit,
                origin: self.facts.origin.to_owned(),
                options: self.facts.options(),
                proxies: self.facts.proxies(),
            },
            methods: self
                .specs
                .iter()
                .zip(&self.methods)
                .map(|(spec, method)| MethodFacts {
                    label: spec.label.clone(),
                    spec: spec.text.clone(),
                    identity: method.identity(),
                })
                .collect(),
            metrics: self
                .scoring
                .metrics
                .iter()
                .map(|metric| MetricFacts::of(metric.key, self.scoring.scorer.weights()))
                .collect(),
            scoring: self.scoring_facts(),
        })
    }

    fn scoring_facts(&self) -> BTreeMap<String, String> {
        let networks = self.scoring.scorer.options().arithmetic().to_string();
        let mut facts = scoring_facts(self.renderer.name(), &networks);
        let fits = |spec: &MethodSpec| ["resize", "crop"].map(|k| spec.options.contains_key(k));
        if self.specs.iter().any(|spec| fits(spec).contains(&true)) {
            let rule = "full resolution of the target; predictions are resized up or cropped only where a method's \
                        identity says so";
            facts.insert("resolution".to_owned(), rule.to_owned());
        }
        if self.common_region {
            let rule = "on the part of a target that all methods predict (--common-region)";
            facts.insert("region".to_owned(), rule.to_owned());
        }
        facts
    }

    /// Evaluates into a run folder.
    pub(super) fn run(self, out: &Path, keep: Keep) -> anyhow::Result<Finished> {
        let manifest = self.manifest()?;
        let folder = RunFolder::create(out)?;
        manifest.check_backend(&folder)?;
        folder.reopen()?;
        manifest.write(&folder)?;
        write_atomic(&folder.pairs_path(), self.list.to_csv().as_bytes())?;

        let plan = RunPlan {
            pairs: self.pairs()?,
            methods: &self.methods,
            readings: self
                .datasets
                .iter()
                .map(|dataset| (dataset.name.as_str(), dataset.readings()))
                .collect(),
            scoring: &self.scoring,
            renderer: &self.renderer,
            keep,
            common_region: self.common_region,
        };
        let bar = progress::bar(plan.pairs.len() * plan.methods.len(), "units");
        let executed = execute(&plan, &folder, |pair_id, method| {
            bar.set_message(format!("{method} {pair_id}"));
            bar.inc(1);
        })?;
        bar.finish_and_clear();

        let records = executed.records();
        folder.write_records(&records)?;
        write_atomic(
            &folder.scores_path(),
            &scores_csv(&records, &self.scoring.keys())?,
        )?;
        write_atomic(&folder.timings_path(), &timings_csv(&executed.units)?)?;
        Ok(Finished {
            folder,
            manifest,
            executed,
            scenes: self.scenes,
        })
    }
}

/// A list that was made from other photographs or poses is evaluated all the same, and said to be so.
fn warn_of_other_files(list: &PairList, scenes: &[Scene]) {
    let found = list.verify(scenes);
    for mismatch in found.different {
        output::remark(format!(
            "warning: {}/{}/{}: the photograph is not the one the list was made from (sha256 {} instead of {})",
            mismatch.dataset, mismatch.scene, mismatch.view, mismatch.found, mismatch.expected
        ));
    }
    if let Some(first) = found.moved.first() {
        output::remark(format!(
            "warning: {} of the list's pairs have other cameras than it says, such as {}: baseline {} m instead of {} m",
            found.moved.len(),
            first.pair_id,
            first.found.0,
            first.expected.0
        ));
    }
}
