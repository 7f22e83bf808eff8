//! Progress and warnings of long-running work. The library never prints; the command line draws bars and writes lines.

/// Receives warnings and progress. Every method does nothing unless overridden, and may be called from any thread.
pub trait Observer: Sync {
    /// Reports something the user should know that is not an error.
    fn warn(&self, _text: &str) {}

    /// A new phase of work begins, with its name, number of steps (0 if unknown) and unit.
    fn begin(&self, _phase: &str, _steps: usize, _unit: &'static str) {}

    /// `done` steps of the phase are done; `current` names the one in progress.
    fn progress(&self, _done: usize, _current: &str) {}

    /// One more step of the phase is done.
    fn step(&self) {}

    /// One of the finished steps has failed.
    fn failed(&self) {}

    fn end(&self) {}

    /// Whether to stop. Resumable work ends after its current step.
    fn stop(&self) -> bool {
        false
    }
}

#[derive(Debug, Clone, Copy, Default)]
pub struct Quiet;

impl Observer for Quiet {}
