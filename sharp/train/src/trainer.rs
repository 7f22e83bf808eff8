//! The training loop, resumable from its folder.
//!
//! | in the folder | |
//! |---|---|
//! | `log.csv`, `timing.csv` | every step |
//! | `validation.csv` | the caller's validation results, by step |
//! | `checkpoints/` | states to resume from |
//! | `stage1.safetensors`, `validated.safetensors`, `weights.safetensors` | weights after the first stage (if a second follows), at the last validation, after the last step |
//! | `stopped-…/` | the example whose loss or gradient was not finite |

mod error;
mod sum;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;
use sharp::model::params::WeightSource;
use sharp::model::predictor::{Planes, planes_of};
use sharp::model::training::{TrainableNetwork, TrainingInput};
use sharp::model::{Compute, ModelConfig, ModelError};
use sharp::random::mix;

pub use error::TrainingError;
use sum::StepSum;

use crate::checkpoint::{CheckpointFolder, Precision, StateError, TrainingState};
use crate::config::{StageConfig, TrainingConfig};
use crate::data::{FolderPhotographs, Prefetcher, Sample};
use crate::examples::Examples;
use crate::initial::{Pretrained, TrainedDepth, Untrained};
use crate::log::{StepRecord, TrainingLog};
use crate::losses::TERMS;
use crate::objective::{Example, Objective, known_depth};
use crate::optimizer::{ParameterState, clip_norm};
use crate::position::{Position, Stage};
use crate::stopped;

/// Callbacks to monitor and control a training run.
pub trait Watcher {
    /// Called after every step; `steps` is the number of steps of the current stage.
    fn stepped(&mut self, record: &StepRecord, steps: u64);

    /// Evaluates the weights in a file; called at the configured interval and after the last step. Returns named
    /// values.
    ///
    /// # Errors
    /// The reason, if validation fails; the training run then ends and can be resumed.
    fn validate(
        &mut self,
        weights: &Path,
        config: &ModelConfig,
        position: Position,
    ) -> Result<Vec<(String, f64)>, String>;

    /// Receives warnings about excluded data; the training continues.
    fn warn(&mut self, text: &str);

    /// Called before every step; returning true ends the training after a checkpoint.
    fn stop(&self) -> bool;
}

/// Reason why a training run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    Complete,
    /// Stopped by the watcher; can be resumed.
    Stopped(Position),
}

/// A training run in progress.
pub struct Trainer {
    config: TrainingConfig,
    folder: PathBuf,
    network: TrainableNetwork,
    objective: Objective,
    state: Arc<TrainingState>,
    checkpoints: CheckpointFolder,
    config_sha256: String,
}

/// The state as a source of weights.
struct Snapshot(Arc<TrainingState>);

impl WeightSource for Snapshot {
    fn values(&self, name: &str, _: &[usize]) -> Result<Vec<f32>, ModelError> {
        let mut weights = self.0.weights.iter();
        let found = weights.find(|weights| weights.name == name);
        Ok(found.map(|found| found.values.clone()).unwrap_or_default())
    }
}

impl Trainer {
    /// Starts a training run in `folder`, or resumes the run in it from its latest checkpoint.
    /// `initial` overrides the configuration's file of initial weights. The networks run on
    /// `compute`; results of different kinds of devices differ in the last bits.
    ///
    /// # Errors
    /// [`TrainingError`]: a folder that cannot be written, a checkpoint of another configuration,
    /// or initial weights that do not fit.
    pub fn open(
        config: TrainingConfig,
        initial: Option<&Path>,
        folder: &Path,
        compute: Compute,
    ) -> Result<Self, TrainingError> {
        // Check the second stage's photographs now rather than after the first stage.
        if let (1.., Some((folder, held_out))) =
            (config.stage2.steps, config.stage2.data.photographs())
        {
            FolderPhotographs::open(folder, held_out, config.stage2.seed, (1, 1))?;
        }
        let network = TrainableNetwork::new(&config.network, compute.clone())?;
        let checkpoints = CheckpointFolder::new(folder.join("checkpoints"));
        let config_sha256 = config.sha256();
        let state = match checkpoints.positions()?.last() {
            Some(position) => TrainingState::load(
                &checkpoints.file(*position),
                &config_sha256,
                network.parameters(),
                &config.trained,
            )?,
            None => {
                let (sizes, seed) = (&config.network, config.stage1.seed);
                let named = config
                    .initial
                    .as_deref()
                    .or(config.initial_depth.as_deref());
                let file = initial.or(named);
                let source: Box<dyn WeightSource> = match file {
                    Some(file) if config.initial.is_some() => {
                        Box::new(Pretrained::open(file, sizes)?)
                    }
                    Some(file) => Box::new(TrainedDepth::open(file, sizes, seed)?),
                    None => Box::new(Untrained::new(sizes, seed)),
                };
                let state =
                    TrainingState::new(network.parameters(), &config.trained, source.as_ref())?;
                if let Some(file) = file {
                    state.check(file)?;
                }
                state
            }
        };
        Ok(Self {
            objective: Objective::new(config.losses, config.loss_options.clone(), compute)?,
            config,
            folder: folder.to_owned(),
            network,
            state: Arc::new(state),
            checkpoints,
            config_sha256,
        })
    }

    pub fn position(&self) -> Position {
        self.state.position
    }

    /// Name of the perceptual loss's network, for a log.
    pub fn perceptual_network(&self) -> Option<&'static str> {
        self.objective.perceptual_network()
    }

    /// Number of trained parameter values, and number of all parameter values that the network uses.
    pub fn parameter_counts(&self) -> (usize, usize) {
        let weights = &self.state.weights;
        let learning = weights.iter().filter(|weights| weights.moments.is_some());
        let count = |values: usize, weights: &ParameterState| values + weights.values.len();
        (learning.fold(0, count), weights.iter().fold(0, count))
    }

    /// Trains to the end of the last stage, or until the watcher stops the training.
    ///
    /// # Errors
    /// [`TrainingError`]. Checkpoints written so far are kept.
    pub fn run(&mut self, watcher: &mut dyn Watcher) -> Result<Ended, TrainingError> {
        let mut log = TrainingLog::open(&self.folder, self.position())?;
        for stage in Stage::ALL {
            let Position { stage: at, step } = self.position();
            let is_first = stage == Stage::Supervised;
            // The first stage exports weights even if it has no steps, because the second stage
            // needs them as its teacher.
            if at > stage || (self.config.stage(stage).steps == 0 && !is_first) {
                continue;
            }
            if at < stage {
                Arc::make_mut(&mut self.state).begin(stage);
            }
            let first = if at < stage { 0 } else { step };
            if let Ended::Stopped(position) = self.run_stage(stage, first, &mut log, watcher)? {
                return Ok(Ended::Stopped(position));
            }
        }
        self.export_named("weights")?;
        Ok(Ended::Complete)
    }

    fn run_stage(
        &mut self,
        stage: Stage,
        first: u64,
        log: &mut TrainingLog,
        watcher: &mut dyn Watcher,
    ) -> Result<Ended, TrainingError> {
        let settings = self.config.stage(stage).clone();
        let intervals = self.config.intervals.clone();
        let batch = settings.batch as u64;
        let is_due = |interval, step: u64| step == settings.steps || step.is_multiple_of(interval);
        let validates = |step| intervals.validation > 0 && is_due(intervals.validation, step);
        // Repeats a validation that failed or was interrupted.
        if first > 0 && validates(first) && !log.is_validated() {
            self.validate(log, watcher)?;
        }
        if first < settings.steps {
            let examples = Examples::open(&self.config, stage, &self.teacher())?;
            examples.left_out.iter().for_each(|text| watcher.warn(text));
            let mut samples = Prefetcher::start(examples, first * batch, SAMPLES_AHEAD)?;
            for step in first + 1..=settings.steps {
                if watcher.stop() {
                    self.checkpoint()?;
                    return Ok(Ended::Stopped(self.position()));
                }
                let position = Position { stage, step };
                let stepped = self.step(position, &settings, &mut samples, log, watcher);
                // An unreadable picture ends the training, so save the steps made so far.
                if matches!(stepped, Err(TrainingError::Data(_))) {
                    self.checkpoint()?;
                }
                stepped?;
                if validates(step) || is_due(intervals.checkpoint, step) {
                    self.checkpoint()?;
                }
                if validates(step) {
                    self.validate(log, watcher)?;
                }
            }
        }
        if stage == Stage::Supervised && self.config.stage2.steps > 0 {
            self.export_named(FIRST_STAGE)?;
        }
        Ok(Ended::Complete)
    }

    /// Runs one step, which ends at `position`.
    fn step(
        &mut self,
        position: Position,
        settings: &StageConfig,
        samples: &mut Prefetcher<Sample>,
        log: &mut TrainingLog,
        watcher: &mut dyn Watcher,
    ) -> Result<(), TrainingError> {
        let started = Instant::now();
        let mut sum = StepSum::default();
        let batch = settings.batch as u64;
        let indices: Vec<u64> = ((position.step - 1) * batch..position.step * batch).collect();
        let at_once = if self.network.recomputes() {
            1
        } else {
            EXAMPLES_AT_ONCE
        };
        for indices in indices.chunks(at_once) {
            let mut examples = Vec::new();
            for index in indices {
                let sample = samples.fetch()?;
                examples.push((sample, mix(settings.seed ^ mix(*index))));
            }
            let costs = examples.par_iter();
            let costs = costs.map(|(sample, seed)| self.example(sample, *seed));
            let costs: Vec<_> = costs.collect();
            for ((sample, _), cost) in examples.iter().zip(costs) {
                let (what, terms) = match cost {
                    Err(TrainingError::Model(ModelError::Depth(_))) => (Some("the depth"), None),
                    Err(error) => return Err(error),
                    Ok(cost) => {
                        let terms = cost.terms;
                        sum.add(cost);
                        (sum.not_finite(), Some(terms))
                    }
                };
                if let Some(what) = what {
                    return Err(self.not_finite(position, what, sample, terms)?);
                }
            }
        }
        sum.divide_by(settings.batch);
        let norm = clip_norm(&mut sum.gradients, settings.clip_norm);
        let Position { step, .. } = position;
        let learning_rate = settings.schedule.learning_rate(step, settings.steps);
        let state = Arc::make_mut(&mut self.state);
        let adam = &self.config.adam;
        adam.update(&mut state.weights, &sum.gradients, learning_rate, step)?;
        state.position = position;
        let record = StepRecord {
            position,
            learning_rate,
            terms: sum.terms,
            total: sum.total,
            gradient_norm: norm,
            seconds: started.elapsed().as_secs_f64(),
        };
        log.append(&record)?;
        watcher.stepped(&record, settings.steps);
        Ok(())
    }

    /// Saves the example on which a step failed, and the state before the step.
    fn not_finite(
        &self,
        position: Position,
        what: &'static str,
        sample: &Sample,
        terms: Option<[f64; TERMS.len()]>,
    ) -> Result<TrainingError, TrainingError> {
        let Position { stage, step } = position;
        let name = format!("stopped-stage{}-step{step}", stage.number());
        let folder = self.folder.join(name);
        match self.checkpoint() {
            // Not saved: training could not resume from a state with such values.
            Ok(()) | Err(TrainingError::State(StateError::Value { .. })) => {}
            Err(error) => return Err(error),
        }
        let saved = stopped::save(&folder, sample, terms);
        saved.map_err(|source| TrainingError::Io {
            path: folder.clone(),
            source,
        })?;
        Ok(TrainingError::NotFinite {
            position,
            what,
            folder,
        })
    }

    /// Losses of one example, and their gradient.
    fn example(&self, sample: &Sample, seed: u64) -> Result<StepSum, TrainingError> {
        let source = &sample.source;
        let side = self.config.network.internal_resolution;
        let parts = self.config.trained;
        let values = planes_of(source.image.as_raw(), |v| f32::from(v) / 255.0);
        let known = known_depth(source, side);
        let input = TrainingInput {
            image: Planes {
                values: &values,
                width: source.image.width() as usize,
                height: source.image.height() as usize,
            },
            disparity_factor: (source.intrinsics.fx / f64::from(source.intrinsics.width)) as f32,
            // Without known depth, the network performs no alignment.
            known_depth: self.config.aligned.then_some(&known),
            zeros_return: self.config.zeros_return,
            depth_only: self.objective.is_of_depth_alone(),
        };
        let snapshot = Snapshot(Arc::clone(&self.state));
        let trains = move |name: &str| parts.contain(name);
        let pass = self.network.forward(snapshot, trains, input)?;
        let example = Example {
            source,
            target: &sample.target,
            seed,
        };
        let cost = self.objective.cost(&pass, &example)?;
        let mut found = pass.backward(&cost.gradient)?;
        let learning = self.state.weights.iter().filter(|w| w.moments.is_some());
        let gradients = learning.map(|weights| {
            let found = found.remove(&weights.name);
            found.unwrap_or_else(|| vec![0.0; weights.values.len()])
        });
        Ok(StepSum {
            terms: cost.terms,
            total: cost.total,
            gradients: gradients.collect(),
        })
    }

    /// Path of the weights after the first stage, which are the second stage's teacher.
    fn teacher(&self) -> PathBuf {
        self.folder.join(format!("{FIRST_STAGE}.safetensors"))
    }

    fn checkpoint(&self) -> Result<(), TrainingError> {
        let kept = self.config.intervals.kept_checkpoints;
        Ok(self
            .checkpoints
            .save(&self.state, &self.config_sha256, kept)?)
    }

    /// Writes the current weights as a checkpoint for [`Predictor`](sharp::model::Predictor).
    ///
    /// # Errors
    /// [`TrainingError::State`] if the weights are not finite in `precision` or the file cannot be written.
    pub fn export(&self, path: &Path, precision: Precision) -> Result<(), TrainingError> {
        let about = BTreeMap::from([("trained".to_owned(), self.position().to_string())]);
        Ok(self.state.export(path, precision, &about)?)
    }

    /// Writes the weights to `NAME.safetensors` in the folder, as f32.
    fn export_named(&self, name: &str) -> Result<PathBuf, TrainingError> {
        let path = self.folder.join(format!("{name}.safetensors"));
        self.export(&path, Precision::F32)?;
        Ok(path)
    }

    fn validate(
        &self,
        log: &mut TrainingLog,
        watcher: &mut dyn Watcher,
    ) -> Result<(), TrainingError> {
        let position = self.position();
        let weights = self.export_named("validated")?;
        let measured = watcher.validate(&weights, &self.config.network, position);
        let measured = measured.map_err(|reason| TrainingError::Validation { position, reason })?;
        Ok(log.append_validation(position, &measured)?)
    }
}

/// Name of the second stage's teacher weights.
const FIRST_STAGE: &str = "stage1";
/// Number of examples prefetched while a step computes.
const SAMPLES_AHEAD: usize = 3;
/// Number of examples of a batch computed concurrently. Much of a pass is too small for several
/// threads, and two passes fill each other's idle time; more would only need more memory. Networks
/// that recompute intermediate tensors run one example at a time, because one pass then occupies
/// all threads.
const EXAMPLES_AT_ONCE: usize = 2;

#[cfg(test)]
mod tests;
