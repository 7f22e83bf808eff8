//! Progress and warnings of long-running work. The library never prints; the command line draws bars and writes lines.

/// Receives warnings and progress. Every method does nothing unless overridden, and may be called from any thread.
pub trait Observer: Sync {
    /// Reports a fact that the user should know but that is not an error.
    fn warn(&self, _text: &str) {}

    /// Begins a phase of work, given its name, number of steps (0 if unknown) and unit.
    fn begin(&self, _phase: &str, _steps: usize, _unit: &'static str) {}

    /// Reports that `done` steps of the phase are done; `current` names the step in progress.
    fn progress(&self, _done: usize, _current: &str) {}

    /// Reports a state that is worth logging; called occasionally.
    fn milestone(&self, _text: &str) {}

    /// Reports that one more step of the phase is done.
    fn step(&self) {}

    /// Reports that one of the finished steps failed.
    fn failed(&self) {}

    fn end(&self) {}

    /// Whether to stop. Work that can be resumed ends after the step in progress.
    fn stop(&self) -> bool {
        false
    }
}

#[derive(Debug, Clone, Copy, Default)]
pub struct Quiet;

impl Observer for Quiet {}
