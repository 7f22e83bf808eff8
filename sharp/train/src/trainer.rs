//! A training from its first step to its last, in a folder that it can be taken up from.
//!
//! | in the folder | |
//! |---|---|
//! | `config.toml` | what decides it, as given |
//! | `log.csv`, `timing.csv` | every step |
//! | `validation.csv` | what the caller measured, by step |
//! | `checkpoints/` | states to go on from |
//! | `stage1.safetensors`, `weights.safetensors` | weights after the first stage, and after the last step |
//! | `stopped-…/` | the inputs of a step whose loss or gradient was not finite |

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use sharp::model::inventory::CheckpointSource;
use sharp::model::params::WeightSource;
use sharp::model::predictor::Planes;
use sharp::model::training::{TrainableNetwork, TrainingInput};
use sharp::model::{ModelConfig, ModelError};

use crate::checkpoint::{CheckpointFolder, Precision, StateError, TrainingState};
use crate::config::TrainingConfig;
use crate::data::{DataError, Prefetcher, Sample};
use crate::initial::Untrained;
use crate::log::{LogError, StepRecord, TrainingLog};
use crate::losses::perceptual::PerceptualError;
use crate::objective::{Example, Objective, ObjectiveError, TERMS, known_depth};
use crate::optimizer::{OptimizerError, clip_norm};
use crate::position::{Position, Stage};
use crate::self_supervision::{SelfSupervisedSamples, Teacher};
use crate::stopped;

/// Why a training cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    State(#[from] StateError),
    #[error(transparent)]
    Log(#[from] LogError),
    #[error(transparent)]
    Data(#[from] DataError),
    #[error(transparent)]
    Perceptual(#[from] PerceptualError),
    #[error(transparent)]
    Objective(#[from] ObjectiveError),
    #[error(transparent)]
    Optimizer(#[from] OptimizerError),
    #[error("{}: {source}", path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// A loss or a gradient that is NaN or infinite.
    #[error(
        "{position}: {what} is not finite; the step's inputs are in {}. Go on with a smaller learning rate from an \
         earlier checkpoint, or look at these inputs",
        folder.display()
    )]
    NotFinite {
        position: Position,
        what: &'static str,
        folder: PathBuf,
    },
    /// The caller's validation failed.
    #[error("validation after {position}: {reason}")]
    Validation { position: Position, reason: String },
}

/// What a caller sees of a training, and has a say in.
pub trait Watcher {
    /// Called after every step.
    fn stepped(&mut self, record: &StepRecord<'_>, steps: u64);

    /// Measures weights that lie in a file; called at the configured interval and after the last step.
    /// Each value is named.
    ///
    /// # Errors
    /// Whatever keeps it from measuring, as text: it ends the training, which can be taken up again.
    fn validate(
        &mut self,
        weights: &Path,
        config: &ModelConfig,
        position: Position,
    ) -> Result<Vec<(String, f64)>, String>;

    /// Asked before every step; true ends the training after a checkpoint.
    fn stop(&self) -> bool;
}

/// How a training ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    Complete,
    /// By the watcher; it can be taken up.
    Stopped(Position),
}

/// A training under way.
pub struct Trainer {
    config: TrainingConfig,
    folder: PathBuf,
    network: TrainableNetwork,
    objective: Objective,
    state: Arc<TrainingState>,
    checkpoints: CheckpointFolder,
    config_sha256: String,
    teacher: Option<Arc<Teacher>>,
}

/// The state as a source of weights.
#[derive(Clone)]
pub(crate) struct Snapshot(pub(crate) Arc<TrainingState>);

impl WeightSource for Snapshot {
    fn values(&self, name: &str, _: &[usize]) -> Result<Vec<f32>, ModelError> {
        let mut weights = self.0.weights.iter();
        let found = weights.find(|weights| weights.name == name);
        Ok(found.map(|found| found.values.clone()).unwrap_or_default())
    }
}

impl Trainer {
    /// Begins a training in a folder, or takes up the one that is there from its latest checkpoint.
    ///
    /// # Errors
    /// [`TrainingError`]: a folder that cannot be written, a checkpoint of another configuration,
    /// initial weights that do not fit.
    pub fn open(config: TrainingConfig, folder: &Path) -> Result<Self, TrainingError> {
        let network = TrainableNetwork::new(&config.network)?;
        let checkpoints = CheckpointFolder::new(folder.join("checkpoints"));
        let config_sha256 = config.sha256();
        let state = match checkpoints.positions()?.last() {
            Some(position) => TrainingState::load(
                &checkpoints.file(*position),
                network.parameters(),
                &config.trained,
                &config_sha256,
            )?,
            None => {
                let source: Box<dyn WeightSource> = match &config.initial {
                    Some(file) => {
                        let source = CheckpointSource::open(file)?;
                        source.check(&config.network, &[])?;
                        Box::new(source)
                    }
                    None => Box::new(Untrained::new(&config.network, config.stage1.seed)),
                };
                TrainingState::new(network.parameters(), &config.trained, source.as_ref())?
            }
        };
        Ok(Self {
            objective: Objective::new(config.losses, config.loss_options.clone())?,
            config,
            folder: folder.to_owned(),
            network,
            state: Arc::new(state),
            checkpoints,
            config_sha256,
            teacher: None,
        })
    }

    /// Where it stands.
    pub fn position(&self) -> Position {
        self.state.position
    }

    /// The perceptual loss's network, for a log.
    pub fn perceptual_network(&self) -> Option<&'static str> {
        self.objective.perceptual_network()
    }

    /// Values that learn, and all that the network uses.
    pub fn parameter_counts(&self) -> (usize, usize) {
        let weights = &self.state.weights;
        let learning = weights.iter().filter(|weights| weights.moments.is_some());
        let count = |values: usize, weights: &crate::optimizer::Weights| values + weights.values.len();
        (learning.fold(0, count), weights.iter().fold(0, count))
    }

    /// Trains to the end of the last stage, or until the watcher stops it.
    ///
    /// # Errors
    /// [`TrainingError`]. What was checkpointed stays.
    pub fn run(&mut self, watcher: &mut dyn Watcher) -> Result<Ended, TrainingError> {
        let mut log = TrainingLog::open(&self.folder, &TERMS, self.position())?;
        for stage in Stage::ALL {
            let Position { stage: at, step } = self.position();
            if at > stage || self.config.stage(stage).steps == 0 {
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
        self.export("weights")?;
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
        let mut samples = match first < settings.steps {
            true => Some(self.samples(stage, first * batch)?),
            false => None,
        };
        for step in first..settings.steps {
            if watcher.stop() {
                self.checkpoint()?;
                return Ok(Ended::Stopped(self.position()));
            }
            let started = Instant::now();
            let mut step_terms = [0.0; TERMS.len()];
            let mut total = 0.0;
            let mut gradients: Vec<Vec<f32>> = Vec::new();
            let mut inputs = Vec::new();
            for k in 0..batch {
                let Some(samples) = &mut samples else {
                    break;
                };
                let sample = samples.fetch()?;
                let seed = (step * batch + k) ^ settings.seed.rotate_left(32);
                let cost = self.gradient(&sample, seed, &mut gradients)?;
                total += cost.0 / batch as f64;
                for (sum, term) in step_terms.iter_mut().zip(cost.1) {
                    *sum += term / batch as f64;
                }
                inputs.push(sample);
            }
            let share = 1.0 / batch as f32;
            if batch > 1 {
                gradients
                    .iter_mut()
                    .flatten()
                    .for_each(|g: &mut f32| *g *= share);
            }
            let norm = clip_norm(&mut gradients, settings.clip_norm);
            let position = Position {
                stage,
                step: step + 1,
            };
            for (what, value) in [("the loss", total), ("the gradient", norm)] {
                if !value.is_finite() {
                    let folder = self.folder.join(format!("stopped-{position}").replace([' ', ','], "-"));
                    stopped::save(&folder, &inputs, &step_terms)?;
                    return Err(TrainingError::NotFinite {
                        position,
                        what,
                        folder,
                    });
                }
            }
            let learning_rate = settings.schedule.learning_rate(position.step, settings.steps);
            let state = Arc::make_mut(&mut self.state);
            self.config
                .adam
                .update(&mut state.weights, &gradients, position.step, learning_rate)?;
            state.position = position;
            let record = StepRecord {
                position,
                learning_rate,
                terms: &step_terms,
                total,
                gradient_norm: norm,
                seconds: started.elapsed().as_secs_f64(),
            };
            log.append(&record)?;
            watcher.stepped(&record, settings.steps);
            let last = position.step == settings.steps;
            if last || position.step.is_multiple_of(intervals.checkpoint) {
                self.checkpoint()?;
            }
            let due = intervals.validation > 0
                && (last || position.step.is_multiple_of(intervals.validation));
            if due {
                self.validate(watcher)?;
            }
        }
        if stage == Stage::Supervised {
            self.export("stage1")?;
        }
        Ok(Ended::Complete)
    }
}
