//! Training configuration as one TOML file. The defaults are the paper's values.
//!
//! ```toml
//! network.file = "mini.json#mini"     # or "release", or a table `network.inline`
//! trained.patch_encoder = true
//!
//! [stage1]
//! steps = 20000
//! side = 256
//! schedule.warmup_steps = 500
//!
//! [stage2]
//! steps = 0
//! ```

use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer};
use sharp::model::ModelConfig;
use sharp::model::config::{AlignmentInput, config_sha256};
use sharp_datasets::DatasetSpec;

use crate::losses::{LossOptions, LossWeights};
use crate::optimizer::Adam;
use crate::parts::TrainedParts;
use crate::position::Stage;
pub use crate::pseudo_views::PseudoViews;
use crate::schedule::Schedule;

/// Errors of a training configuration.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("{}: {source}", path.display())]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
    /// Invalid TOML, an unknown key, or a value of the wrong type.
    #[error("{}: line {line}: {reason}", path.display())]
    Parse {
        path: PathBuf,
        line: usize,
        reason: String,
    },
    /// A value out of range.
    #[error("{}: `{key}` {reason}", path.display())]
    Value {
        path: PathBuf,
        key: String,
        reason: String,
    },
}

/// Everything that determines a training run, and how often the weights are validated and saved.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainingConfig {
    /// `"release"`, `"mini"` (the bundled network), `{ file = "FILE#NAME" }` (JSON, relative to the working directory)
    /// or `{ inline = { … } }`.
    #[serde(deserialize_with = "network")]
    pub network: ModelConfig,
    /// Checkpoint of this network that initialises the weights; it may have been trained at another picture size.
    /// Without one, the weights are random. Here and in `initial_depth`, the harness also accepts `"mini"`, the bundled
    /// network.
    pub initial: Option<PathBuf>,
    /// Checkpoint of SHARP or Depth Pro that initialises the depth network only; all other weights are random.
    pub initial_depth: Option<PathBuf>,
    pub trained: TrainedParts,
    /// True if predicted depth is aligned with the true depth before use (paper, depth adjustment).
    pub aligned: bool,
    /// Overrides the network's own `alignment_input`. Parsing moves the value into `network` and
    /// leaves `None` here.
    pub alignment_input: Option<AlignmentInput>,
    /// True if disparity that has become zero may recover; see
    /// [`TrainingInput`](sharp::model::training::TrainingInput). Not in the paper, whose network is pretrained.
    pub zeros_return: bool,
    /// Weight λ of each loss.
    pub losses: LossWeights,
    pub loss_options: LossOptions,
    pub adam: Adam,
    pub stage1: StageConfig,
    pub stage2: StageConfig,
    pub intervals: Intervals,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Number of steps; 0 skips the stage.
    pub steps: u64,
    /// Number of samples whose gradients are averaged in a step.
    #[serde(default = "one")]
    pub batch: usize,
    /// Seed of all random choices.
    #[serde(default)]
    pub seed: u64,
    #[serde(default)]
    pub schedule: Schedule,
    /// Maximum norm of the gradient over all parameters; `inf` disables clipping. Not in the paper.
    #[serde(default = "clip_norm")]
    pub clip_norm: f64,
    /// Width and height of the pictures in pixels.
    #[serde(default = "side")]
    pub side: u32,
    #[serde(default)]
    pub data: TrainingData,
    /// Maximum distance between two cameras, in metres. First stage: the cameras of a dataset's pair. Second stage: the
    /// cameras of a photograph and of a pseudo-novel view.
    #[serde(default = "max_baseline_m")]
    pub max_baseline_m: f64,
    /// Choices about pseudo-novel views; for the second stage.
    #[serde(default)]
    pub pseudo_views: PseudoViews,
}

#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum TrainingData {
    /// Scenes generated from seeds; the second stage uses only their pictures.
    #[default]
    Procedural,
    /// Scenes generated from seeds, of which every other one has mirrors, panes of glass and water, and light from the
    /// sky.
    Reflective,
    /// Datasets with depth, each given as `[NAME:]FORMAT=PATH[,key=value…]`; for the first stage.
    Datasets(Vec<String>),
    /// A folder of PNG and JPEG files, also in its subfolders; for the second stage.
    Photographs(PathBuf),
    /// A folder of photographs, of which a part is held out for validation; for the second stage.
    Split(SplitFolder),
}

/// A folder of photographs of which a part is held out.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitFolder {
    pub photographs: PathBuf,
    /// Every `held_out`-th file or subfolder directly in the folder is held out, in natural order of names; at least 2.
    pub held_out: usize,
}

impl TrainingData {
    /// The folder of photographs, and `held_out` if the folder is split; `None` for other data.
    pub fn photographs(&self) -> Option<(&Path, Option<usize>)> {
        match self {
            Self::Photographs(folder) => Some((folder, None)),
            Self::Split(split) => Some((&split.photographs, Some(split.held_out))),
            _ => None,
        }
    }
}

/// Intervals in steps, which do not affect results.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Intervals {
    /// Steps between two validations; 0 disables validation.
    pub validation: u64,
    pub checkpoint: u64,
    /// Number of most recent checkpoints that are kept.
    pub kept_checkpoints: usize,
}

/// Default width and height of the pictures: the paper's resolution.
fn side() -> u32 {
    1536
}

fn clip_norm() -> f64 {
    1.0
}

fn one() -> usize {
    1
}

/// Default maximum baseline in metres: that of the paper's synthetic data.
fn max_baseline_m() -> f64 {
    0.6
}

impl Default for Intervals {
    fn default() -> Self {
        Self {
            validation: 1000,
            checkpoint: 1000,
            kept_checkpoints: 3,
        }
    }
}

impl Default for TrainingConfig {
    /// Batches of one sample for each GPU of the paper: 128 in stage 1 and 32 in stage 2.
    fn default() -> Self {
        let stage = |steps, batch| StageConfig {
            steps,
            batch,
            seed: 0,
            schedule: Schedule::default(),
            clip_norm: clip_norm(),
            side: side(),
            data: TrainingData::default(),
            max_baseline_m: max_baseline_m(),
            pseudo_views: PseudoViews::default(),
        };
        Self {
            network: ModelConfig::release(),
            initial: None,
            initial_depth: None,
            losses: LossWeights::default(),
            loss_options: LossOptions::default(),
            trained: TrainedParts::default(),
            aligned: true,
            alignment_input: None,
            zeros_return: false,
            adam: Adam::default(),
            stage1: stage(100_000, 128),
            stage2: stage(60_000, 32),
            intervals: Intervals::default(),
        }
    }
}

/// A network as given in a configuration file.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum NetworkChoice {
    Release,
    Mini,
    File(String),
    Inline(Box<ModelConfig>),
}

fn network<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ModelConfig, D::Error> {
    let config = match NetworkChoice::deserialize(deserializer)? {
        NetworkChoice::Release => Ok(ModelConfig::release()),
        NetworkChoice::Mini => sharp::model::bundled::config(),
        NetworkChoice::File(file) => ModelConfig::load(&file),
        NetworkChoice::Inline(config) => config.validate().map(|()| *config),
    };
    config.map_err(|error| serde::de::Error::custom(format!("`network`: {error}")))
}

impl TrainingConfig {
    /// Reads and validates a file.
    ///
    /// # Errors
    /// [`ConfigError`] if the file cannot be read or parsed, or a value is invalid.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text = sharp::files::read_text(path).map_err(|source| ConfigError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(&text, path)
    }

    /// Parses and validates the text of the file `path`.
    ///
    /// # Errors
    /// [`ConfigError::Parse`] and [`ConfigError::Value`], both with the file's path.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let mut config: Self = toml::from_str(text).map_err(|error| ConfigError::Parse {
            path: path.to_owned(),
            line: error
                .span()
                .map_or(1, |at| 1 + text[..at.start].matches('\n').count()),
            reason: error.message().replace('\n', ", "),
        })?;
        // If only one stage is configured, require the other too: the second's default of 60 000
        // steps at 1536 pixels would be unintended.
        let named: toml::Table = toml::from_str(text).unwrap_or_default();
        let [first, second] = ["stage1", "stage2"].map(|stage| named.contains_key(stage));
        let missing = (first != second).then(|| {
            let (key, other) = if first {
                ("stage2", "stage1")
            } else {
                ("stage1", "stage2")
            };
            let reason = format!("is required if `{other}` is given; `{key}.steps = 0` skips it");
            (key.to_owned(), reason)
        });
        if let Some((key, reason)) = config.first_fault().or(missing) {
            return Err(ConfigError::Value {
                path: path.to_owned(),
                key,
                reason,
            });
        }
        if let Some(input) = config.alignment_input.take() {
            config.network.alignment_input = input;
        }
        Ok(config)
    }

    pub fn stage(&self, stage: Stage) -> &StageConfig {
        match stage {
            Stage::Supervised => &self.stage1,
            Stage::SelfSupervised => &self.stage2,
        }
    }

    /// Hash of all settings that affect results. A training run can only be resumed with the configuration that it
    /// started with.
    pub fn sha256(&self) -> String {
        let decides = Self {
            intervals: Intervals::default(),
            ..self.clone()
        };
        config_sha256(&decides)
    }

    /// The first invalid value: its key, and the reason.
    fn first_fault(&self) -> Option<(String, String)> {
        let Adam {
            betas,
            epsilon,
            weight_decay,
        } = self.adam;
        let checks = [
            (
                self.initial.is_none() || self.initial_depth.is_none(),
                "initial_depth",
                "cannot be combined with `initial`, which includes the depth network",
            ),
            (
                self.aligned || self.alignment_input != Some(AlignmentInput::BothLayers),
                "alignment_input",
                "is \"both_layers\", but nothing is aligned, because `aligned` is false",
            ),
            (
                betas.iter().all(|beta| (0.0..1.0).contains(beta)),
                "adam.betas",
                "are not both in 0..1",
            ),
            (is_positive(epsilon), "adam.epsilon", "is not positive"),
            (
                weight_decay >= 0.0 && weight_decay.is_finite(),
                "adam.weight_decay",
                "is negative or not finite",
            ),
            (
                self.intervals.checkpoint > 0,
                "intervals.checkpoint",
                "is 0",
            ),
            (
                self.intervals.kept_checkpoints > 0,
                "intervals.kept_checkpoints",
                "is 0",
            ),
        ];
        let failed = checks.into_iter().find(|(holds, ..)| !holds);
        let failed = failed.map(|(_, key, reason)| (key.to_owned(), reason.to_owned()));
        let failed = failed.or_else(|| self.losses.first_fault());
        let failed = failed.or_else(|| self.loss_options.first_fault());
        failed.or_else(|| {
            Stage::ALL.into_iter().find_map(|stage| {
                let (key, reason) = self.stage(stage).first_fault(stage)?;
                Some((format!("stage{}.{key}", stage.number()), reason))
            })
        })
    }
}

impl StageConfig {
    fn first_fault(&self, stage: Stage) -> Option<(&'static str, String)> {
        let Schedule {
            peak,
            last,
            warmup_steps,
        } = self.schedule;
        let checks = [
            (
                (1..=1 << 16).contains(&self.batch),
                "batch",
                "is not between 1 and 65536",
            ),
            (self.steps <= 1 << 32, "steps", "must be at most 2^32"),
            (self.clip_norm > 0.0, "clip_norm", "is not positive"),
            (
                (2..=1 << 13).contains(&self.side),
                "side",
                "is not between 2 and 8192 pixels",
            ),
            (is_positive(peak), "schedule.peak", "is not positive"),
            (
                is_positive(self.max_baseline_m),
                "max_baseline_m",
                "is not positive",
            ),
            (
                (0.0..=peak).contains(&last),
                "schedule.last",
                "is not between 0 and the peak",
            ),
            (
                warmup_steps < self.steps || self.steps == 0,
                "schedule.warmup_steps",
                "must be less than the number of steps",
            ),
        ];
        let failed = checks.into_iter().find(|(holds, ..)| !holds);
        let failed = failed.map(|(_, key, reason)| (key, reason.to_owned()));
        let failed = failed.or_else(|| self.pseudo_views.first_fault());
        failed.or_else(|| Some(("data", self.data.fault(stage)?)))
    }
}

impl TrainingData {
    fn fault(&self, stage: Stage) -> Option<String> {
        match (self, stage) {
            (Self::Split(split), _) if split.held_out < 2 => {
                Some("holds out everything; `split.held_out` must be at least 2".to_owned())
            }
            (Self::Procedural | Self::Reflective, _)
            | (Self::Photographs(_) | Self::Split(_), Stage::SelfSupervised) => None,
            (Self::Photographs(_) | Self::Split(_), Stage::Supervised) => {
                Some("has photographs, which have no depth, but this stage needs depth".to_owned())
            }
            (Self::Datasets(_), Stage::SelfSupervised) => Some(
                "has datasets, but this stage is trained on procedural scenes or photographs"
                    .to_owned(),
            ),
            (Self::Datasets(specs), _) if specs.is_empty() => Some("lists no dataset".to_owned()),
            (Self::Datasets(specs), _) => {
                let error = specs
                    .iter()
                    .find_map(|spec| DatasetSpec::parse(spec).err())?;
                Some(format!("has no dataset: {error}"))
            }
        }
    }
}

fn is_positive(value: f64) -> bool {
    value > 0.0 && value.is_finite()
}

#[cfg(test)]
mod tests;
