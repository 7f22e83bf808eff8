use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};

use super::*;

/// How a training is interrupted.
#[derive(Clone, Copy, PartialEq)]
enum Interruption {
    /// As after a signal: stops before the next step.
    Stop(Position),
    /// As after a power cut: the step is in the log, but not in any checkpoint.
    Kill(Position),
    /// A validation fails.
    Unmeasured(Position),
}

struct Interrupter {
    at: Option<Interruption>,
    seen: Position,
}

impl Watcher for Interrupter {
    fn stepped(&mut self, record: &StepRecord, _: u64) {
        self.seen = record.position;
        if self.at == Some(Interruption::Kill(self.seen)) {
            std::panic::resume_unwind(Box::new("killed"));
        }
    }

    fn validate(
        &mut self,
        weights: &Path,
        _: &ModelConfig,
        position: Position,
    ) -> Result<Vec<(String, f64)>, String> {
        if self.at == Some(Interruption::Unmeasured(position)) {
            return Err("a pair could not be read".to_owned());
        }
        let bytes = fs::read(weights).map_err(|error| error.to_string())?;
        Ok(vec![
            ("bytes".to_owned(), bytes.len() as f64),
            ("step".to_owned(), position.step as f64),
        ])
    }

    fn warn(&mut self, _: &str) {}

    fn stop(&self) -> bool {
        self.at == Some(Interruption::Stop(self.seen))
    }
}

/// Runs a whole training on `threads` threads with the given interruptions; returns its files, keyed by name.
fn files(threads: usize, interruptions: &[Interruption]) -> BTreeMap<String, Vec<u8>> {
    let mut config = config([4, 3], 48);
    config.intervals.checkpoint = 2;
    config.intervals.validation = 2;
    config.intervals.kept_checkpoints = 1;
    let folder = tempfile::tempdir().unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(|| {
        let all = interruptions.iter().copied().map(Some);
        for at in all.chain([None]) {
            let mut trainer = Trainer::open(config.clone(), None, folder.path(), cpu()).unwrap();
            let seen = trainer.position();
            let mut watcher = Interrupter { at, seen };
            let run = || trainer.run(&mut watcher);
            match (at, catch_unwind(AssertUnwindSafe(run))) {
                (None, Ok(Ok(Ended::Complete)))
                | (Some(Interruption::Kill(_)), Err(_))
                | (Some(Interruption::Stop(_)), Ok(Ok(Ended::Stopped(_)))) => {}
                (
                    Some(Interruption::Unmeasured(position)),
                    Ok(Err(TrainingError::Validation { .. })),
                ) => {
                    // No step is lost.
                    let taken_up =
                        Trainer::open(config.clone(), None, folder.path(), cpu()).unwrap();
                    assert_eq!(taken_up.position(), position);
                }
                _ => panic!("the training was not interrupted as requested"),
            }
        }
    });
    let mut files = BTreeMap::new();
    for folder in [folder.path().to_owned(), folder.path().join("checkpoints")] {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_file() && name != "timing.csv" {
                files.insert(name, fs::read(path).unwrap());
            }
        }
    }
    files
}

/// Both stages, with checkpoints after steps 2 and 4 of the first stage, and 2 and 3 of the second.
#[test]
fn neither_interruptions_nor_threads_change_a_byte() {
    let whole = files(1, &[]);
    let names: Vec<&str> = whole.keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "log.csv",
            "stage1.safetensors",
            "stage2-step00000003.safetensors",
            "validated.safetensors",
            "validation.csv",
            "weights.safetensors"
        ]
    );
    let at = |stage, step| Position { stage, step };
    let interrupted = files(
        3,
        &[
            Interruption::Kill(at(Stage::Supervised, 1)),
            Interruption::Kill(at(Stage::Supervised, 3)),
            Interruption::Stop(at(Stage::Supervised, 3)),
            Interruption::Unmeasured(at(Stage::Supervised, 4)),
            Interruption::Kill(at(Stage::SelfSupervised, 1)),
            Interruption::Stop(at(Stage::Supervised, 4)),
            Interruption::Stop(at(Stage::SelfSupervised, 2)),
            Interruption::Unmeasured(at(Stage::SelfSupervised, 3)),
        ],
    );
    for (name, bytes) in &whole {
        assert!(interrupted.get(name) == Some(bytes), "{name} differs");
    }
    assert_eq!(whole.len(), interrupted.len());
}
