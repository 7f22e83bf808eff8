//! Trains networks: the harness's own evaluation validates the weights, and a page shows progress.
//!
//! | in the folder, besides [the files of `sharp_train`](sharp_train::trainer) | |
//! |---|---|
//! | `config.toml`, `network.json` | the configuration, and the network's architecture by itself |
//! | `validation-pairs.csv` | the pairs on which weights are validated |
//! | `validation/` | the run folder of the last validation |
//! | `index.html` | the page |
//!
//! * `configured`: a configuration with overridden values; `folder`: the training folder and its checks on resuming;
//!   `validation`: scores of weights; `page`: curves and samples.

mod configured;
mod error;
mod folder;
mod page;
mod validation;

use std::path::{Path, PathBuf};

use sharp::model::{Algorithm, DeviceChoice, ModelConfig, bundled};
use sharp_train::checkpoint::{CheckpointFolder, Precision};
use sharp_train::log::StepRecord;
use sharp_train::position::{Position, Stage};
use sharp_train::trainer::{Ended, Trainer, TrainingError, Watcher};

use configured::configured;
pub use error::TrainError;
use folder::TrainingFolder;
use validation::Validation;
pub use validation::ValidationRequest;

use crate::io::atomic_files::write_json;
use crate::io::checkpoint::bundled_weights;
use crate::io::observer::Observer;

/// Arguments of [`train`].
pub struct TrainRequest<'a> {
    /// The configuration file, TOML.
    pub config: &'a Path,
    /// Overrides of the file's values, as `KEY=VALUE`. The key is dotted. The value is TOML, or text without quotes; an
    /// empty value restores the default.
    pub set: &'a [String],
    /// Output folder. An interrupted training run resumes from it.
    pub folder: &'a Path,
    pub validation: ValidationRequest,
    /// Device for training; validation runs on the CPU.
    pub device: DeviceChoice,
    /// Additional output path for the final weights, in half precision.
    pub export_f16: Option<&'a Path>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    pub ended: Ended,
    pub position: Position,
    /// Network whose features the perceptual loss compares.
    pub perceptual_network: Option<&'static str>,
    /// Number of trainable parameters, and of all parameters.
    pub parameters: (usize, usize),
    /// The weights after the last step; `None` if training was interrupted.
    pub weights: Option<PathBuf>,
    /// Scores of the last validated weights.
    pub validated: Vec<(String, f64)>,
    pub page: PathBuf,
}

/// Trains, or resumes a training run, until it is complete or the observer requests a stop.
///
/// # Errors
/// [`TrainError`]. Checkpoints are kept, and calling again with the same request resumes from them.
pub fn train(request: TrainRequest<'_>, observer: &dyn Observer) -> Result<Trained, TrainError> {
    let compute = request.device.open(Algorithm::Winograd);
    let compute = compute.map_err(TrainingError::from)?;
    let (text, config) = configured(request.config, request.set)?;
    let folder = TrainingFolder::open(request.folder, &text, &config)?;
    let validates = config.intervals.validation > 0;
    let validation =
        validates.then(|| Validation::new(request.validation, &config, &folder, observer));
    let validation = validation.transpose()?;
    let weight = config.losses.percep;
    let is_vgg = config.loss_options.percep.resnet50dilated.is_none();
    if is_vgg && weight > MAX_VGG_WEIGHT {
        observer.warn(&format!(
            "`losses.percep` is {weight}, a weight for the paper's network \
             (`loss_options.percep.resnet50dilated`, which `weights fetch resnet50dilated` gets); with VGG16, this loss is about a hundred times as large and needs a weight near 0.01"
        ));
    }
    // Save the name of the bundled network rather than its path, which depends on where the program is installed.
    let named = config
        .initial
        .as_deref()
        .or(config.initial_depth.as_deref());
    let checkpoints = CheckpointFolder::new(folder.root().join("checkpoints")).positions();
    let begins = checkpoints.map_err(TrainingError::from)?.is_empty();
    let is_bundled = begins && named == Some(Path::new(bundled::NAME));
    let initial = is_bundled.then(bundled_weights).transpose()?;
    let network = config.network.clone();
    let mut trainer = Trainer::open(config, initial.as_deref(), folder.root(), compute)?;
    write_json(&folder.root().join("network.json"), &network)?;
    let perceptual_network = trainer.perceptual_network();
    let mut watcher = Watching {
        folder: &folder,
        perceptual_network,
        validation,
        observer,
        phase: None,
        validated: Vec::new(),
        page_due: false,
    };
    let ended = trainer.run(&mut watcher);
    observer.end();
    let validated = watcher.validated;
    // Write the page even if training failed.
    let page = page::write(&folder, perceptual_network, observer);
    let ended = ended?;
    if let Some(path) = request.export_f16
        && ended == Ended::Complete
    {
        trainer.export(path, Precision::F16)?;
    }
    let page = page?;
    let weights = folder.root().join("weights.safetensors");
    Ok(Trained {
        ended,
        position: trainer.position(),
        perceptual_network,
        parameters: trainer.parameter_counts(),
        weights: (ended == Ended::Complete).then_some(weights),
        validated,
        page,
    })
}

/// A larger weight of the perceptual loss with VGG16 causes a warning, because this loss then outweighs all others.
const MAX_VGG_WEIGHT: f64 = 0.3;

/// Number of steps per stage whose loss and time are reported.
const MILESTONES: u64 = 50;

/// Forwards the trainer's events to an observer, and the weights to the validation.
struct Watching<'a> {
    folder: &'a TrainingFolder,
    perceptual_network: Option<&'static str>,
    validation: Option<Validation>,
    observer: &'a dyn Observer,
    /// The stage whose progress is currently displayed.
    phase: Option<Stage>,
    validated: Vec<(String, f64)>,
    /// Whether to rewrite the page at the next step. Set after a validation, because its values are
    /// not in the log until then.
    page_due: bool,
}

impl Watcher for Watching<'_> {
    fn stepped(&mut self, record: &StepRecord, steps: u64) {
        let Position { stage, step } = record.position;
        if std::mem::take(&mut self.page_due)
            && let Err(error) = page::write(self.folder, self.perceptual_network, self.observer)
        {
            self.observer
                .warn(&format!("index.html was not written: {error}"));
        }
        let name = format!("stage {}", stage.number());
        if self.phase.replace(stage) != Some(stage) {
            self.observer.begin(&name, steps as usize, "steps");
        }
        let (loss, seconds) = (record.total, record.seconds);
        let now = format!("loss {loss:.4}, {seconds:.2} s");
        self.observer
            .progress(step as usize, &format!("{name}: {now}"));
        let every = steps.div_ceil(MILESTONES);
        if step == 1 || step == steps || step.is_multiple_of(every) {
            let text = format!("{name}, step {step} of {steps}: {now}");
            self.observer.milestone(&text);
        }
    }

    fn validate(
        &mut self,
        weights: &Path,
        config: &ModelConfig,
        _: Position,
    ) -> Result<Vec<(String, f64)>, String> {
        let Some(validation) = &self.validation else {
            return Ok(Vec::new());
        };
        self.observer.end();
        // The validation displays other phases, so the stage's phase must begin again.
        self.phase = None;
        let measured = validation.measure(weights, config, self.observer);
        let measured = measured.map_err(|error| error.to_string())?;
        self.validated.clone_from(&measured);
        self.page_due = true;
        Ok(measured)
    }

    fn warn(&mut self, text: &str) {
        self.observer.warn(text);
    }

    fn stop(&self) -> bool {
        self.observer.stop()
    }
}
