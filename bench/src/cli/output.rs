//! Prints results to standard output, where they can be piped. Prints notes, warnings and progress to standard error.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use serde_json::json;

use crate::io::observer::Observer;
use crate::io::text::{visible, visible_line};

/// Writes a line, escaping control characters. A closed pipe (`| head`) is not an error.
pub(super) fn line(text: impl AsRef<str>) -> anyhow::Result<()> {
    match writeln!(io::stdout().lock(), "{}", visible(text.as_ref())) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => Ok(other?),
    }
}

/// Writes a value as indented JSON.
pub(super) fn json(value: &impl Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string_pretty(value)?)
}

/// Prints a command's result: with `--json` the value as indented JSON, otherwise the text unless it is empty.
pub(super) fn print<V: Serialize>(
    as_json: bool,
    value: impl FnOnce() -> V,
    text: impl FnOnce() -> String,
) -> anyhow::Result<()> {
    if as_json {
        return json(&value());
    }
    match text().trim_end() {
        "" => Ok(()),
        text => line(text),
    }
}

/// Prints the paths of written files.
pub(super) fn print_written(as_json: bool, files: &[PathBuf]) -> anyhow::Result<()> {
    let value = || json!({ "files": names(files) });
    print(as_json, value, || wrote(files))
}

/// A line for each written file.
pub(super) fn wrote(files: &[PathBuf]) -> String {
    let line = |file: &PathBuf| format!("wrote {}\n", file.display());
    files.iter().map(line).collect()
}

pub(super) fn names(paths: &[PathBuf]) -> Vec<String> {
    let names = paths.iter().map(|path| path.display().to_string());
    names.collect()
}

/// Replaces names of picture settings in a message (`alpha=`) with names of command-line options (`--alpha `).
pub(super) fn as_options(message: &impl ToString) -> String {
    let keys = ["alpha", "color", "orientation", "exr"].into_iter();
    keys.fold(message.to_string(), |text, key| {
        text.replace(&format!("{key}="), &format!("--{key} "))
    })
}

/// Writes a line to standard error.
pub(super) fn remark(text: impl AsRef<str>) {
    // Nothing can be done if standard error is closed.
    let _ = writeln!(io::stderr().lock(), "{}", visible(text.as_ref()));
}

/// Whether progress is hidden; set by `--quiet`.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Hides progress, but not warnings and results.
pub(super) fn silence_progress() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Whether `--quiet` hides progress.
pub(super) fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Shows warnings as lines and progress as a bar, or as occasional lines if standard error is not a terminal.
#[derive(Debug, Default)]
pub(super) struct Terminal {
    phase: Mutex<Option<Phase>>,
    /// Whether a signal has asked the process to stop.
    asked_to_stop: Arc<AtomicBool>,
    deadline: Option<Instant>,
}

/// The current phase of work.
#[derive(Debug)]
struct Phase {
    bar: ProgressBar,
    unit: String,
    failed: u64,
    /// Time, and number of steps done, when the last plain line was printed; initially, when the phase began.
    said: (Instant, u64),
    lines: usize,
}

/// Time between two progress lines where no bar can be drawn.
const INTERVAL: Duration = Duration::from_secs(30);

impl Phase {
    fn new(name: &str, unit: &str) -> Self {
        let template =
            format!("{{msg:28!}} {{wide_bar}} {{pos}}/{{len}} {unit}  {{elapsed}} (left {{eta}})");
        let style = ProgressStyle::with_template(&template)
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = if is_quiet() {
            ProgressBar::hidden()
        } else {
            ProgressBar::new(0)
        };
        Self {
            bar: bar.with_style(style).with_message(name.to_owned()),
            unit: unit.to_owned(),
            failed: 0,
            said: (Instant::now(), 0),
            lines: 0,
        }
    }

    fn say_now_and_then(&mut self) {
        if !is_quiet()
            && !io::stderr().is_terminal()
            && let Some(line) = self.plain_line(Instant::now())
        {
            remark(line);
        }
    }

    /// A progress line, at most one per [`INTERVAL`]. The remaining time is extrapolated from the last interval only,
    /// because units reused from an earlier run take no time.
    fn plain_line(&mut self, now: Instant) -> Option<String> {
        let (then, before) = self.said;
        let elapsed = now.saturating_duration_since(then);
        let done = self.bar.position();
        if elapsed < INTERVAL || done <= before {
            return None;
        }
        let total = self.bar.length().unwrap_or(0);
        let mut line = match total {
            0 => format!("{done} {}", self.unit),
            _ => format!("{done} of {total} {}", self.unit),
        };
        if self.failed > 0 {
            line += &format!(", {} failed", self.failed);
        }
        if self.lines > 0 && total > done {
            let each = elapsed.as_secs_f64() / (done - before) as f64;
            line += &format!(", {} left", span(each * (total - done) as f64));
        }
        self.said = (now, done);
        self.lines += 1;
        Some(line)
    }
}

/// A duration as text: `40 s`, `12 min`, `3 h 20 min`.
pub(super) fn span(secs: f64) -> String {
    let minutes = (secs / 60.0).round() as u64;
    match (secs as u64, minutes) {
        (..=99, _) => format!("{secs:.0} s"),
        (_, ..=99) => format!("{minutes} min"),
        _ => format!("{} h {} min", minutes / 60, minutes % 60),
    }
}

impl Terminal {
    /// A terminal that requests a stop after `budget`, or on a signal that schedulers send some time before they kill a
    /// process.
    pub(super) fn until(budget: Option<Duration>) -> io::Result<Self> {
        Self::obeying(
            budget,
            #[cfg(unix)]
            &[libc::SIGTERM, libc::SIGUSR1],
        )
    }

    /// Like [`Self::until`], but Ctrl-C also requests a stop. For work that would lose much if the process were killed.
    pub(super) fn until_interrupted(budget: Option<Duration>) -> io::Result<Self> {
        Self::obeying(
            budget,
            #[cfg(unix)]
            &[libc::SIGTERM, libc::SIGUSR1, libc::SIGINT],
        )
    }

    fn obeying(budget: Option<Duration>, #[cfg(unix)] signals: &[i32]) -> io::Result<Self> {
        let terminal = Self {
            // Ignore a budget that is too large for the clock.
            deadline: budget.and_then(|budget| Instant::now().checked_add(budget)),
            ..Self::default()
        };
        #[cfg(unix)]
        for &signal in signals {
            let asked = &terminal.asked_to_stop;
            // Exit at once on a second signal. Handlers run in the order of registration, so register this one before
            // the handler that sets the flag which it checks.
            signal_hook::flag::register_conditional_shutdown(signal, 75, Arc::clone(asked))?;
            signal_hook::flag::register(signal, Arc::clone(asked))?;
        }
        Ok(terminal)
    }

    fn with_phase(&self, act: impl FnOnce(&mut Option<Phase>)) {
        act(&mut self.phase.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Writes a line above the bar.
    fn remark(&self, line: String) {
        self.with_phase(|phase| match phase {
            Some(phase) => phase.bar.suspend(|| remark(line)),
            None => remark(line),
        });
    }

    fn in_phase(&self, act: impl FnOnce(&mut Phase)) {
        self.with_phase(|phase| {
            if let Some(phase) = phase {
                act(phase);
                phase.say_now_and_then();
            }
        });
    }

    /// Shows progress of a phase whose number of steps becomes known only during the phase.
    pub(super) fn advance(&self, phase: &str, unit: &str, done: u64, total: u64) {
        self.with_phase(|slot| {
            let phase = slot.get_or_insert_with(|| Phase::new(phase, unit));
            phase.bar.set_length(total);
            phase.bar.set_position(done);
            phase.say_now_and_then();
        });
    }
}

impl Observer for Terminal {
    fn warn(&self, text: &str) {
        self.remark(format!("warning: {}", visible_line(text)));
    }

    fn milestone(&self, text: &str) {
        if !is_quiet() {
            self.remark(visible_line(text).into_owned());
        }
    }

    fn begin(&self, phase: &str, steps: usize, unit: &'static str) {
        let new = Phase::new(phase, unit);
        new.bar.set_length(steps as u64);
        self.with_phase(|phase| *phase = Some(new));
    }

    fn progress(&self, done: usize, current: &str) {
        self.in_phase(|phase| {
            phase.bar.set_position(done as u64);
            if !current.is_empty() {
                phase.bar.set_message(visible_line(current).into_owned());
            }
        });
    }

    fn step(&self) {
        self.in_phase(|phase| phase.bar.inc(1));
    }

    fn failed(&self) {
        self.in_phase(|phase| phase.failed += 1);
    }

    fn end(&self) {
        self.with_phase(|phase| {
            if let Some(phase) = phase.take() {
                phase.bar.finish_and_clear();
            }
        });
    }

    fn stop(&self) -> bool {
        self.asked_to_stop.load(Ordering::Relaxed)
            || self
                .deadline
                .is_some_and(|deadline| Instant::now() >= deadline)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_lines_come_now_and_then_and_judge_by_the_last_interval() {
        let mut phase = Phase::new("", "units");
        phase.bar.set_length(1000);
        let (start, _) = phase.said;
        let mut at = |secs: u64, done: u64, failed: u64| {
            phase.bar.set_position(done);
            phase.failed = failed;
            phase.plain_line(start + Duration::from_secs(secs))
        };
        assert_eq!(at(10, 400, 0), None);
        // All units so far are reused from an earlier run.
        assert_eq!(at(30, 500, 0).as_deref(), Some("500 of 1000 units"));
        assert_eq!(at(59, 501, 0), None);
        // 10 units per minute.
        let line = at(90, 510, 3);
        assert_eq!(
            line.as_deref(),
            Some("510 of 1000 units, 3 failed, 49 min left")
        );
        assert_eq!(at(200, 510, 3), None);
    }

    #[test]
    fn spans_have_fitting_units() {
        let spans = [0.4, 40.0, 720.0, 12_000.0].map(span);
        assert_eq!(spans, ["0 s", "40 s", "12 min", "3 h 20 min"]);
    }
}
