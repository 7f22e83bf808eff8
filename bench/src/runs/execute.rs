//! Runs a plan: predicts on one thread, scores and records on the other.

use std::collections::BTreeMap;
use std::sync::mpsc::sync_channel;
use std::time::Instant;

use sharp_metrics::Picture;

use super::error::RunError;
use super::plan::{Keep, RunPlan};
use super::predict::{Loaded, PredictedUnit, Step, predict_all};
use super::region::{cut, region_extras};
use super::store::{RunFolder, Timing, UnitFile};
use crate::durable::{FileError, file_sha256};
use crate::methods::Prediction;
use crate::record::{Record, Score, Status};
use crate::render_file::write_png;

/// What happened to the units of a run.
#[derive(Debug, Clone, Default)]
pub struct Executed {
    /// Every unit's record and timing, sorted by pair id, then in the order of the methods.
    pub units: Vec<(Record, Timing)>,
    /// Units whose stored result was taken over.
    pub reused: usize,
}

impl Executed {
    /// The records alone.
    pub fn records(&self) -> Vec<Record> {
        self.units
            .iter()
            .map(|(record, _)| record.clone())
            .collect()
    }

    /// How many units failed.
    pub fn failures(&self) -> usize {
        self.units
            .iter()
            .filter(|(record, _)| record.status != Status::Ok)
            .count()
    }
}

/// Runs a plan into a folder. Finished units are taken over, recorded failures tried again; a failing pair becomes
/// a record and the others go on. `progress(pair_id, method)` is called before each unit is scored.
///
/// While a unit is scored, the next one is predicted on another thread, and one step ahead only: at most two
/// predictions and the pictures of two pairs are in memory. No value depends on it.
///
/// # Errors
/// When the run folder cannot be read or written, or the renderer's device fails.
pub fn execute(
    plan: &RunPlan,
    folder: &RunFolder,
    mut progress: impl FnMut(&str, &str),
) -> Result<Executed, RunError> {
    for method in plan.methods {
        method.begin(&folder.logs_path());
    }
    // A channel without room: who predicts waits until who scores is ready for it.
    let (sender, steps) = sync_channel(0);
    std::thread::scope(|scope| {
        scope.spawn(move || predict_all(plan, folder, &sender));
        let mut executed = Executed::default();
        for step in steps {
            let unit = match step? {
                Step::Stored(unit) => {
                    progress(&unit.record.pair_id, &unit.record.method);
                    executed.reused += 1;
                    (unit.record, unit.timing)
                }
                Step::Predicted(unit) => {
                    progress(&unit.record.pair_id, &unit.record.method);
                    unit.finish(plan, folder)?
                }
            };
            executed.units.push(unit);
        }
        Ok(executed)
    })
}

impl PredictedUnit {
    /// Scores, keeps the picture, saves the record.
    fn finish(self, plan: &RunPlan, folder: &RunFolder) -> Result<(Record, Timing), FileError> {
        let Self {
            key,
            mut record,
            mut timing,
            common,
            outcome,
        } = self;
        let scored = outcome.and_then(|(mut prediction, loaded)| {
            let started = Instant::now();
            let size = loaded.truth.dimensions();
            if let Some(common) = common {
                cut(&mut prediction, common, size)?;
            }
            record.scores = score(plan, &prediction, &loaded)?;
            timing.score_secs = started.elapsed().as_secs_f64();
            if let Some(share) = loaded.truth.valid_share(prediction.region) {
                prediction.extras.insert("valid_share".to_owned(), share);
            }
            if let Some(region) = prediction.region {
                prediction.extras.extend(region_extras(&region, size));
            }
            Ok(prediction)
        });
        let mut prediction_sha256 = None;
        match scored {
            Ok(prediction) => {
                if plan.keep == Keep::All
                    && let Picture::Rgb8(image) = &prediction.picture
                {
                    let path = folder.prediction_path(&record.method, &record.pair_id);
                    write_png(&path, image)?;
                    prediction_sha256 = Some(file_sha256(&path)?);
                }
                record.extras = prediction.extras;
            }
            Err(reason) => {
                record.status = Status::Failed {
                    reason: one_line(&reason),
                };
            }
        }
        let unit = UnitFile {
            key: key.as_str().to_owned(),
            record,
            prediction_sha256,
            timing,
        };
        folder.save(&key, &unit)?;
        Ok((unit.record, unit.timing))
    }
}

fn score(
    plan: &RunPlan,
    prediction: &Prediction,
    loaded: &Loaded,
) -> Result<BTreeMap<String, Score>, String> {
    let scorer = &plan.scoring.scorer;
    let scores = prediction.score(scorer, &loaded.truth, loaded.mask.as_ref())?;
    let by_key = scores.into_iter().map(|(key, score)| {
        let score = match score {
            Ok(value) => Score::Value(value),
            Err(unavailable) => Score::Unavailable {
                unavailable: unavailable.to_string(),
            },
        };
        (key.to_string(), score)
    });
    Ok(by_key.collect())
}

/// Reasons become table cells and CSV fields.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests;
