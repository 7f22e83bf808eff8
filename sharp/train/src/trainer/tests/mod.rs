mod curve;
mod overfit;
mod resume;
mod step;

use sharp::model::Algorithm;
use tempfile::TempDir;

use super::*;
use crate::config::TrainingData;
use crate::losses::LossWeights;
use crate::pseudo_views::PseudoViews;
use crate::schedule::Schedule;

fn cpu() -> Compute {
    Compute::cpu(Algorithm::Winograd)
}

/// Trains the tiny network without the perceptual loss, for `steps` steps in each of the two stages;
/// pictures have a side of `side` pixels.
fn config(steps: [u64; 2], side: u32) -> TrainingConfig {
    let stage = |steps| StageConfig {
        steps,
        batch: 1,
        seed: 3,
        schedule: Schedule {
            peak: 2e-5,
            last: 2e-6,
            warmup_steps: 1,
        },
        clip_norm: 1.0,
        side,
        data: TrainingData::Procedural,
        max_baseline_m: 0.6,
        pseudo_views: PseudoViews::default(),
    };
    let network = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/golden/model/tiny_config.json#tiny"
    );
    let network = ModelConfig::load(network).unwrap();
    let mut config = TrainingConfig {
        losses: LossWeights {
            percep: 0.0,
            ..LossWeights::default()
        },
        stage1: stage(steps[0]),
        stage2: stage(steps[1]),
        ..TrainingConfig::default()
    };
    config.loss_options.splat_width = network.internal_resolution as f64;
    config.network = network;
    config
}

/// A training with its temporary folder.
struct Training {
    trainer: Trainer,
    folder: TempDir,
}

impl Training {
    fn new(config: &TrainingConfig) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let trainer = Trainer::open(config.clone(), None, folder.path(), cpu()).unwrap();
        Self { trainer, folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The values of every parameter whose name contains `part`.
    fn overwrite(&mut self, part: &str, value: f32) {
        let weights = Arc::make_mut(&mut self.trainer.state).weights.iter_mut();
        let named = weights.filter(|weights| weights.name.contains(part));
        assert!(named.map(|weights| weights.values.fill(value)).count() > 0);
    }
}

/// A watcher that does nothing.
struct Silent;

impl Watcher for Silent {
    fn stepped(&mut self, _: &StepRecord, _: u64) {}

    fn validate(
        &mut self,
        _: &Path,
        _: &ModelConfig,
        _: Position,
    ) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }

    fn warn(&mut self, _: &str) {}

    fn stop(&self) -> bool {
        false
    }
}
