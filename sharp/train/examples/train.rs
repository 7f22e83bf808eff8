//! Trains as `CONFIG.toml` says, in a folder: `train CONFIG.toml FOLDER`. The library's own loop, without the
//! harness's metrics.

use std::io::Write;
use std::path::Path;

use sharp::model::ModelConfig;
use sharp_train::config::TrainingConfig;
use sharp_train::log::StepRecord;
use sharp_train::losses::TERMS;
use sharp_train::position::Position;
use sharp_train::trainer::{Trainer, Watcher};

struct Printer;

impl Watcher for Printer {
    fn stepped(&mut self, record: &StepRecord, steps: u64) {
        let terms = TERMS.iter().zip(record.terms);
        let terms: String = terms.map(|(n, v)| format!(" {n} {v:.4}")).collect();
        let mut out = std::io::stdout().lock();
        let _ = writeln!(
            out,
            "{} of {steps}: {:.4},{terms}, gradient {:.2}, {:.2} s",
            record.position, record.total, record.gradient_norm, record.seconds
        );
    }

    fn validate(
        &mut self,
        _: &Path,
        _: &ModelConfig,
        _: Position,
    ) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }

    fn stop(&self) -> bool {
        false
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(config), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: train CONFIG.toml FOLDER".into());
    };
    std::fs::create_dir_all(&folder)?;
    let config = TrainingConfig::load(Path::new(&config))?;
    let mut trainer = Trainer::open(config, Path::new(&folder))?;
    let (learning, all) = trainer.parameter_counts();
    writeln!(std::io::stdout(), "{learning} of {all} values learn")?;
    trainer.run(&mut Printer)?;
    Ok(())
}
