//! Log of a training run: one row per step, and the validation results. `log.csv` has everything
//! that depends only on configuration and seed; interruptions do not change it. `timing.csv` has
//! the times.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::losses::TERMS;
use crate::position::{Position, Stage};

#[derive(Debug, thiserror::Error)]
pub enum LogError {
    #[error("{}: {source}", path.display())]
    Io { path: PathBuf, source: io::Error },
    /// The file is not the log of this training run.
    #[error("{}: {reason}", path.display())]
    Other { path: PathBuf, reason: String },
}

/// A row of the log.
#[derive(Debug, Clone, Copy)]
pub struct StepRecord {
    /// Position after the step.
    pub position: Position,
    pub learning_rate: f64,
    /// Losses before weighting, in the order of [`TERMS`].
    pub terms: [f64; TERMS.len()],
    /// The weighted sum, which training minimises.
    pub total: f64,
    /// Norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Duration of the step.
    pub seconds: f64,
}

/// Log files of a training run in progress.
#[derive(Debug)]
pub struct TrainingLog {
    after: Position,
    log: Rows,
    timing: Rows,
    validation: Rows,
}

impl TrainingLog {
    /// Opens or creates the files in a folder, for a training run that continues after the step at `after`; later rows
    /// are removed.
    ///
    /// # Errors
    /// [`LogError::Io`] if a file cannot be read or written; [`LogError::Other`] if a file is not a
    /// training log or ends before `after`.
    pub fn open(folder: &Path, after: Position) -> Result<Self, LogError> {
        let header = format!(
            "stage,step,learning_rate,{},total,gradient_norm\n",
            TERMS.join(",")
        );
        Ok(Self {
            after,
            log: Rows::open(folder.join("log.csv"), &header, after)?.reaching(after)?,
            timing: Rows::open(folder.join("timing.csv"), "stage,step,seconds\n", after)?
                .reaching(after)?,
            validation: Rows::open(
                folder.join("validation.csv"),
                "stage,step,value,measure\n",
                after,
            )?,
        })
    }

    /// True if the weights at the position passed to [`Self::open`] were already validated.
    pub fn is_validated(&self) -> bool {
        self.after == self.validation.last
    }

    /// Appends validation results for the weights at `position`; the results are on disk when this
    /// returns.
    ///
    /// # Errors
    /// [`LogError::Io`] if the file cannot be written.
    pub fn append_validation(
        &mut self,
        Position { stage, step }: Position,
        measured: &[(String, f64)],
    ) -> Result<(), LogError> {
        let row = |(name, value): &(String, f64)| {
            let quoted = name.replace('"', "\"\"");
            format!("{},{step},{value},\"{quoted}\"\n", stage.number())
        };
        self.validation
            .append(&measured.iter().map(row).collect::<String>())
    }

    /// Appends a step; the row is on disk when this returns. Numbers are written in the shortest
    /// form that round-trips.
    ///
    /// # Errors
    /// [`LogError::Io`] if a file cannot be written.
    pub fn append(&mut self, record: &StepRecord) -> Result<(), LogError> {
        let StepRecord {
            position: Position { stage, step },
            learning_rate,
            terms,
            total,
            gradient_norm,
            seconds,
        } = *record;
        let start = format!("{},{step},", stage.number());
        let terms: String = terms.iter().map(|term| format!("{term},")).collect();
        let row = format!("{start}{learning_rate},{terms}{total},{gradient_norm}\n");
        self.timing.append(&format!("{start}{seconds:.3}\n"))?;
        self.log.append(&row)
    }
}

/// A CSV file that is appended to; its rows start with stage and step.
#[derive(Debug)]
struct Rows {
    path: PathBuf,
    file: File,
    /// Position of the last row that was kept.
    last: Position,
}

impl Rows {
    fn open(path: PathBuf, header: &str, after: Position) -> Result<Self, LogError> {
        let open = || {
            let file = OpenOptions::new().create(true).append(true).open(&path)?;
            Ok((file, sharp::files::read_text(&path)?))
        };
        let opened = open().map_err(|source| fault(&path, source));
        let (file, text) = opened?;
        let last = Position::START;
        let mut rows = Self { path, file, last };
        // Complete a header that was only partially written when the process was killed.
        if header.starts_with(&text) && text != header {
            rows.cut(0)?;
            rows.append(header)?;
            return Ok(rows);
        }
        let Some(body) = text.strip_prefix(header) else {
            return Err(rows.other("not the log of a training run".to_owned()));
        };
        let mut kept = header.len();
        for line in body.split_inclusive('\n') {
            let position = position(line).filter(|_| line.ends_with('\n'));
            match position {
                Some(position) if position <= after => rows.last = position,
                _ => break,
            }
            kept += line.len();
        }
        if kept < text.len() {
            rows.cut(kept)?;
        }
        Ok(rows)
    }

    /// Fails if rows up to `after` are missing, because they cannot be recomputed. A stage that has
    /// not started needs no rows.
    fn reaching(self, after: Position) -> Result<Self, LogError> {
        if after.step == 0 || self.last == after {
            Ok(self)
        } else {
            Err(self.other(format!(
                "rows are missing: the log ends at {}, before {after}",
                self.last
            )))
        }
    }

    fn append(&mut self, text: &str) -> Result<(), LogError> {
        let written = self.file.write_all(text.as_bytes());
        let written = written.and_then(|()| self.file.sync_data());
        written.map_err(|source| fault(&self.path, source))
    }

    fn cut(&self, len: usize) -> Result<(), LogError> {
        let cut = self.file.set_len(len as u64);
        cut.map_err(|source| fault(&self.path, source))
    }

    fn other(&self, reason: String) -> LogError {
        let path = self.path.clone();
        LogError::Other { path, reason }
    }
}

fn fault(path: &Path, source: io::Error) -> LogError {
    let path = path.to_owned();
    LogError::Io { path, source }
}

fn position(line: &str) -> Option<Position> {
    let mut fields = line.split(',');
    let mut number = || fields.next()?.parse().ok();
    Some(Position {
        stage: Stage::from_number(number()?)?,
        step: number()?,
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn at(stage: Stage, step: u64) -> Position {
        Position { stage, step }
    }

    /// Three steps of each stage.
    fn steps() -> Vec<Position> {
        let steps = Stage::ALL.map(|stage| (1..=3).map(move |step| at(stage, step)));
        steps.into_iter().flatten().collect()
    }

    fn write(folder: &Path, after: Position, positions: &[Position], seconds: f64) {
        let mut log = TrainingLog::open(folder, after).unwrap();
        for position in positions {
            let value = position.step as f64 / 3.0 + position.stage.number() as f64;
            let record = StepRecord {
                position: *position,
                learning_rate: 1e-5 * value,
                terms: terms(value),
                total: -value,
                gradient_norm: f64::INFINITY,
                seconds,
            };
            log.append(&record).unwrap();
        }
    }

    fn terms(value: f64) -> [f64; TERMS.len()] {
        let mut terms = [0.0; TERMS.len()];
        (terms[0], terms[1]) = (value, f64::NAN);
        terms
    }

    fn text(folder: &Path, name: &str) -> String {
        fs::read_to_string(folder.join(name)).unwrap()
    }

    #[test]
    fn rows_are_exact() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), Position::START, &steps()[..1], 0.25);
        let value = 1.0 / 3.0 + 1.0;
        let rate = 1e-5 * value;
        let expected = format!(
            "stage,step,learning_rate,color,alpha,percep,depth,tv,grad,delta,splat,scale,\
             scale_gradient,total,gradient_norm\n\
             1,1,{rate},{value},NaN,0,0,0,0,0,0,0,0,-{value},inf\n"
        );
        assert_eq!(text(dir.path(), "log.csv"), expected);
        let row = expected.lines().nth(1).unwrap();
        let read: f64 = row.split(',').nth(3).unwrap().parse().unwrap();
        assert_eq!(read, value);
        let timing = "stage,step,seconds\n1,1,0.250\n";
        assert_eq!(text(dir.path(), "timing.csv"), timing);
    }

    #[test]
    fn a_training_killed_at_any_byte_has_the_same_log_in_the_end() {
        let whole = tempfile::tempdir().unwrap();
        write(whole.path(), Position::START, &steps(), 1.0);
        let [expected, timing] = ["log.csv", "timing.csv"].map(|name| text(whole.path(), name));
        // Checkpoints before the first step, within each stage and between the stages.
        for (after, made) in [
            (Position::START, 0),
            (at(Stage::Supervised, 2), 2),
            (at(Stage::SelfSupervised, 0), 3),
            (at(Stage::SelfSupervised, 2), 5),
        ] {
            let at_least = match made {
                0 => 0,
                made => expected.match_indices('\n').nth(made).unwrap().0 + 1,
            };
            // A row's length is not a multiple of eleven, so writing is interrupted at every
            // position within a row.
            for killed in (at_least..=expected.len()).step_by(11) {
                let dir = tempfile::tempdir().unwrap();
                fs::write(dir.path().join("log.csv"), &expected[..killed]).unwrap();
                fs::write(dir.path().join("timing.csv"), &timing).unwrap();
                write(dir.path(), after, &steps()[made..], 1.0);
                assert_eq!(text(dir.path(), "log.csv"), expected, "{after}, {killed}");
                assert_eq!(text(dir.path(), "timing.csv"), timing);
            }
        }
    }

    #[test]
    fn a_log_that_does_not_fit_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), Position::START, &steps()[..2], 1.0);
        let open = |after| {
            let opened = TrainingLog::open(dir.path(), after);
            opened.unwrap_err().to_string()
        };
        let error = open(at(Stage::Supervised, 3));
        assert!(
            error.ends_with("ends at stage 1, step 2, before stage 1, step 3"),
            "{error}"
        );
        fs::write(dir.path().join("log.csv"), "stage,step,loss\n1,1,0.5\n").unwrap();
        let error = open(at(Stage::Supervised, 2));
        assert!(error.contains("log.csv: not the log"), "{error}");
        let empty = tempfile::tempdir().unwrap();
        let opened = TrainingLog::open(empty.path(), at(Stage::Supervised, 1));
        assert!(opened.is_err());
    }
}
