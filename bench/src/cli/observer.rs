//! Warnings as lines and progress as a bar, both on standard error.

use std::sync::{Mutex, PoisonError};

use indicatif::ProgressBar;

use super::{output, progress};
use crate::io::observer::Observer;

/// Draws a bar where standard error is a terminal.
#[derive(Debug, Default)]
pub(super) struct Terminal(Mutex<Option<ProgressBar>>);

impl Terminal {
    fn with_bar(&self, act: impl FnOnce(&mut Option<ProgressBar>)) {
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Observer for Terminal {
    fn warn(&self, text: &str) {
        self.with_bar(|bar| match bar {
            Some(bar) => bar.suspend(|| output::remark(format!("warning: {text}"))),
            None => output::remark(format!("warning: {text}")),
        });
    }

    fn begin(&self, phase: &str, steps: usize, unit: &'static str) {
        self.with_bar(|bar| {
            let new = progress::bar(steps, unit);
            new.set_message(phase.to_owned());
            *bar = Some(new);
        });
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

    fn end(&self) {
        self.with_bar(|bar| {
            if let Some(bar) = bar.take() {
                bar.finish_and_clear();
            }
        });
    }
}
