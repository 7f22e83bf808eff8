//! How a command that could finish ended.

use std::process::ExitCode;

/// Success in three shades; what could not finish is an error instead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All well: exit code 0.
    Done,
    /// Finished, but some units are recorded failures: exit code 4.
    RecordedFailures,
    /// Stopped early; the same command goes on where it stopped: exit code 75.
    Resumable,
}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Done => Self::SUCCESS,
            Outcome::RecordedFailures => Self::from(4),
            Outcome::Resumable => Self::from(75),
        }
    }
}
