//! Progress and warnings of long-running work. The library never prints; the command line draws bars and writes lines.

/// Receives warnings and progress. Every method does nothing unless overridden, and may be called from any thread.
pub trait Observer: Sync {
    /// Something that the user should know and that is not an error.
    fn warn(&self, _text: &str) {}

    /// A new phase of work begins: what it is, how many steps it has (0 if unknown) and what a step is.
    fn begin(&self, _phase: &str, _steps: usize, _unit: &'static str) {}

    /// `done` steps of the phase are done; `current` names the one in work.
    fn progress(&self, _done: usize, _current: &str) {}

    /// One more step of the phase is done.
    fn step(&self) {}

    /// One of the steps done has failed.
    fn failed(&self) {}

    fn end(&self) {}

    /// Whether to stop: work that can be resumed ends after the step that it is at.
    fn stop(&self) -> bool {
        false
    }
}

#[derive(Debug, Clone, Copy, Default)]
pub struct Quiet;

impl Observer for Quiet {}
