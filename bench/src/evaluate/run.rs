//! Runs an evaluation, or a shard of its plan.

use std::collections::BTreeSet;
use std::path::Path;

use sharp_datasets::Scene;

use super::differences::{Purpose, extended, refusal};
use super::error::EvaluateError;
use super::folder::RunFolder;
use super::gaussians::source_check::checked_sources;
use super::job::{RunOptions, Stages, UnitCounts};
use super::keys::Keys;
use super::manifest::RendererRecord;
use super::picture_check::sample::compared_pairs;
use super::pipeline::run as run_pipeline;
use super::plan::{Estimate, PlanBlock, RunPlan};
use super::prepare::Evaluation;
use super::rescore::score_common_region;
use super::results::{Results, check_rows, write_tables};
use super::score::MemoryShares;
use super::shard::Shard;
use super::unit::Unit;
use crate::config::Keep;
use crate::io::atomic_files::write_atomic;
use crate::io::observer::Observer;
use crate::pairs::PairList;
use crate::pairs::pair_list::ResolvedPair;

pub struct Finished {
    pub folder: RunFolder,
    pub counts: UnitCounts,
    /// All results of the folder, including those of earlier runs.
    pub results: Results,
    pub scenes: Vec<Scene>,
}

impl Evaluation {
    /// Evaluates into a folder, which may contain results of other methods, pairs, metrics and datasets. These remain
    /// visible, and finished units are reused.
    ///
    /// # Errors
    /// If the folder cannot be used, or the renderer's device fails. Finished units are kept.
    pub fn run(
        self,
        out: &Path,
        options: RunOptions,
        observer: &dyn Observer,
    ) -> Result<Finished, EvaluateError> {
        let folder = RunFolder::create(out)?;
        if self.common_region && (options.keep == Keep::None || options.stages != Stages::All) {
            return Err(refused(
                out,
                "--common-region scores kept predictions again, so it needs --keep all and all stages",
            ));
        }
        let pairs = self.pairs()?;
        let block = self.block(&pairs);
        let plan = folder.plan()?.with(block.clone());
        if self.common_region && plan.pairs().len() != pairs.len() {
            return Err(refused(
                out,
                "it contains pairs that are not in this run, but --common-region needs all methods on all pairs; use \
                 either the same pairs or another folder",
            ));
        }
        let keys = Keys::new(&self.datasets, &RendererRecord::of(&self.renderer));
        self.begin(&folder, &plan, block, &keys, observer)?;
        let checked = (checked_sources(&pairs), compared_pairs(&pairs));
        let job = self.job(pairs, checked, &keys, options, Shard::WHOLE);
        let counts = run_pipeline(&job, &folder, observer)?;
        if counts.left == 0 && self.common_region {
            let memory = MemoryShares::of(options.memory_limit_bytes);
            score_common_region(&folder, &job.pairs, &self.scoring, &keys, memory, observer)?;
        }
        let results = match counts.left {
            0 => write_tables(&folder)?,
            // Tables are written only for finished runs.
            _ => Results::read(out)?,
        };
        if counts.left == 0 {
            results
                .warnings()
                .iter()
                .for_each(|text| observer.warn(text));
        }
        Ok(Finished {
            folder: folder.unlocked(),
            counts,
            results,
            scenes: self.scenes,
        })
    }

    /// Writes the plan of a run for shards, with its estimated cost.
    ///
    /// # Errors
    /// If the folder has another run, or `--common-region` is set, which needs all units at once; also the errors of
    /// [`Self::estimate`].
    pub fn plan(
        &self,
        out: &Path,
        options: RunOptions,
        observer: &dyn Observer,
    ) -> Result<Estimate, EvaluateError> {
        self.check_shardable(out)?;
        let folder = RunFolder::create(out)?;
        let block = self.block(&self.pairs()?);
        let plan = folder.plan()?.with(block.clone());
        if plan.blocks.len() > 1 {
            return Err(refused(
                out,
                "it contains another run; plan into a new folder (`merge` joins folders)",
            ));
        }
        let estimate = self.estimate(options)?;
        let plan = RunPlan {
            estimate: Some(estimate),
            ..plan
        };
        let keys = Keys::new(&self.datasets, &RendererRecord::of(&self.renderer));
        self.begin(&folder, &plan, block, &keys, observer)?;
        Ok(estimate)
    }

    /// Writes the plan, without an estimate of its cost, unless the folder already has a plan. Processes of several
    /// shards may call this at the same time, because they make equal plans.
    ///
    /// # Errors
    /// If the folder has another plan, or `--common-region` is set, which needs all units at once.
    pub fn plan_shards(&self, out: &Path, observer: &dyn Observer) -> Result<(), EvaluateError> {
        self.check_shardable(out)?;
        let folder = RunFolder::create_shared(out)?;
        let block = self.block(&self.pairs()?);
        let plan = RunPlan::default().with(block.clone());
        if folder.manifest()?.is_none() {
            let keys = Keys::new(&self.datasets, &RendererRecord::of(&self.renderer));
            return self.begin(&folder, &plan, block, &keys, observer);
        }
        if folder.plan()?.blocks == plan.blocks {
            Ok(())
        } else {
            Err(refused(
                out,
                "it was planned with other pairs or methods; use another folder",
            ))
        }
    }

    fn check_shardable(&self, out: &Path) -> Result<(), EvaluateError> {
        if self.common_region {
            Err(refused(
                out,
                "--common-region scores all methods on all pairs at once, which shards cannot do",
            ))
        } else {
            Ok(())
        }
    }

    /// Executes a shard of a folder's plan, while other processes execute other shards. Writes units, but neither
    /// manifest nor tables.
    ///
    /// # Errors
    /// If the evaluation, its input files, the machine, or the code differs from those of the plan; also the errors of
    /// [`Self::run`].
    pub fn run_shard(
        &self,
        root: &Path,
        shard: Shard,
        options: RunOptions,
        observer: &dyn Observer,
    ) -> Result<UnitCounts, EvaluateError> {
        let folder = RunFolder::join(root)?;
        let Some(planned) = folder.manifest()? else {
            return Err(refused(root, "it has no manifest.json; plan the run again"));
        };
        let plan = folder.plan()?;
        check_rows(&folder, &planned.pairs, &plan, &self.list)?;
        if let Some(difference) = refusal(&planned, &self.manifest()?, Purpose::Shard) {
            let difference = difference.between("in the plan", "in this shard");
            let reason = format!(
                "{difference}; a shard needs the binary, the files and the class of CPU kernels (`run --simd`) that the plan \
                 was made with"
            );
            return Err(refused(root, &reason));
        }
        let own: BTreeSet<&str> = shard
            .of(plan.pairs().into_iter().collect(), |id| *id)
            .into_iter()
            .collect();
        let mut pairs = self.pairs()?;
        let checked = (checked_sources(&pairs), compared_pairs(&pairs));
        pairs.retain(|planned| own.contains(planned.pair.pair_id.as_str()));
        if pairs.len() < own.len() {
            let readable = self.list.resolve_readable(&self.scenes, &self.datasets)?;
            let readable = readable
                .iter()
                .filter(|p| own.contains(p.pair.pair_id.as_str()));
            if readable.count() > pairs.len() {
                return Err(refused(
                    root,
                    "its run.toml selects other pairs than its plan.json, so one of these files was changed",
                ));
            }
            observer.warn(&format!(
                "{} of the {} pairs of shard {shard} are in scenes that cannot be read here",
                own.len() - pairs.len(),
                own.len()
            ));
        }
        self.check_files(root, &pairs)?;
        // The tables are stale; `merge` rewrites them once all shards have finished.
        folder.remove_tables()?;
        let keys = Keys::new(&self.datasets, &RendererRecord::of(&self.renderer));
        let missing = (own.len() - pairs.len()) * self.methods.len();
        let mut counts = run_pipeline(
            &self.job(pairs, checked, &keys, options, shard),
            &folder,
            observer,
        )?;
        counts.units += missing;
        counts.waiting += missing;
        Ok(counts)
    }

    /// Fails if photographs or cameras differ from those in the plan.
    fn check_files(&self, root: &Path, pairs: &[ResolvedPair<'_>]) -> Result<(), EvaluateError> {
        let pairs = pairs.iter().map(|planned| planned.pair.clone()).collect();
        let found = PairList::new(root.join("pairs.csv"), pairs).verify(&self.scenes);
        let different = found.different.first().map(|view| {
            format!(
                "the photograph {}/{}/{} has changed since the plan was made",
                view.dataset, view.scene, view.view
            )
        });
        let moved = found.moved.first().map(|pair| {
            format!(
                "the cameras of {} are {} m apart instead of {} m as planned",
                pair.pair_id, pair.baseline_m[1], pair.baseline_m[0]
            )
        });
        match different.or(moved) {
            Some(reason) => Err(refused(root, &reason)),
            None => Ok(()),
        }
    }

    fn block(&self, pairs: &[ResolvedPair<'_>]) -> PlanBlock {
        PlanBlock {
            pairs: pairs.iter().map(|p| p.pair.pair_id.clone()).collect(),
            methods: self.methods.iter().map(|m| m.label().to_owned()).collect(),
        }
    }

    /// Writes manifest, pair list and plan, combined with those already in the folder.
    fn begin(
        &self,
        folder: &RunFolder,
        plan: &RunPlan,
        block: PlanBlock,
        keys: &Keys,
        observer: &dyn Observer,
    ) -> Result<(), EvaluateError> {
        let mut manifest = self.manifest()?;
        let mut list = self.list.clone();
        let out = folder.root();
        if let Some(before) = folder.manifest()? {
            let (extended, replaced) = extended(before, manifest, out)?;
            manifest = extended;
            // Units of this run will be updated; units of other runs must have been made from the same files.
            let own = RunPlan::default().with(block);
            let own = own.units();
            let (units, _) = folder.units()?;
            let counts = manifest.counted_slots();
            let others = units.iter().filter(|Unit { slot, .. }| {
                !own.contains(&(slot.pair_id.as_str(), slot.method.as_str())) && counts(slot)
            });
            keys.check_files(
                folder,
                others,
                &self.scenes,
                &self.methods,
                "evaluate that method and pair in this command, too, or choose another folder",
            )?;
            for what in replaced {
                observer.warn(&format!(
                    "{what} before; its earlier results stay in {}, but tables no longer show them",
                    out.display()
                ));
            }
            list = PairList::read(&folder.pairs_path())?.joined(&list);
        }
        manifest.pairs.sha256.clone_from(&list.sha256);
        manifest.pairs.listed = list.pairs.len();
        manifest.pairs.evaluated = plan.pairs().len();
        folder.remove_tables()?;
        write_atomic(&folder.pairs_path(), list.bytes())?;
        folder.write_plan(plan)?;
        if let Some(config) = &self.config {
            let mut config = config.clone();
            // Refer to the folder's copy of the list, unless the copy also contains pairs of other runs.
            if config.pairs.pairs.is_some() && list.sha256 == self.list.sha256 {
                config.pairs.pairs = Some(folder.pairs_path());
            }
            folder.write_config(&config)?;
        }
        Ok(folder.write_manifest(&manifest)?)
    }
}

fn refused(folder: &Path, reason: &str) -> EvaluateError {
    EvaluateError::NotKept {
        folder: folder.to_owned(),
        reason: reason.to_owned(),
    }
}
