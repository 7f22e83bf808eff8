//! Results on standard output, so that they can be piped; remarks, warnings and progress on standard error.

use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::io::observer::Observer;

/// Writes a line. That the reader went away (`| head`) is not an error.
pub(super) fn line(text: impl AsRef<str>) -> anyhow::Result<()> {
    match writeln!(io::stdout().lock(), "{}", text.as_ref()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => Ok(other?),
    }
}

/// Writes a value as indented JSON.
pub(super) fn json(value: &impl Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string_pretty(value)?)
}

/// Writes a line to standard error.
pub(super) fn remark(text: impl AsRef<str>) {
    // Nothing is left to do when standard error itself is gone.
    let _ = writeln!(io::stderr().lock(), "{}", text.as_ref());
}

/// Warnings as lines, progress as a bar. indicatif draws nothing unless standard error is a terminal.
#[derive(Debug, Default)]
pub(super) struct Terminal(Mutex<Option<ProgressBar>>);

impl Terminal {
    fn with_bar(&self, act: impl FnOnce(&mut Option<ProgressBar>)) {
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Progress of a phase whose number of steps is known only once it runs.
    pub(super) fn advance(&self, phase: &str, unit: &str, done: u64, total: u64) {
        self.with_bar(|bar| {
            let bar = bar.get_or_insert_with(|| new_bar(phase, unit));
            bar.set_length(total);
            bar.set_position(done);
        });
    }
}

fn new_bar(phase: &str, unit: &str) -> ProgressBar {
    let template =
        format!("{{msg:28!}} {{bar:32}} {{pos}}/{{len}} {unit}  {{elapsed}} (left {{eta}})");
    let style =
        ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(0).with_style(style);
    bar.with_message(phase.to_owned())
}

impl Observer for Terminal {
    fn warn(&self, text: &str) {
        self.with_bar(|bar| match bar {
            Some(bar) => bar.suspend(|| remark(format!("warning: {text}"))),
            None => remark(format!("warning: {text}")),
        });
    }

    fn begin(&self, phase: &str, steps: usize, unit: &'static str) {
        let new = new_bar(phase, unit);
        new.set_length(steps as u64);
        self.with_bar(|bar| *bar = Some(new));
    }

    fn progress(&self, done: usize, current: &str) {
        self.with_bar(|bar| {
            if let Some(bar) = bar {
                bar.set_position(done as u64);
                if !current.is_empty() {
                    bar.set_message(current.to_owned());
                }
            }
        });
    }

    fn step(&self) {
        self.with_bar(|bar| {
            if let Some(bar) = bar {
                bar.inc(1);
            }
        });
    }

    fn end(&self) {
        self.with_bar(|bar| {
            if let Some(bar) = bar.take() {
                bar.finish_and_clear();
            }
        });
    }
}
