//! Progress on standard error; silent where that is no terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar over a known number of steps. indicatif draws nothing unless standard error is a terminal.
pub(super) fn bar(steps: usize, unit: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template(&format!(
        "{{msg:28!}} {{bar:32}} {{pos}}/{{len}} {unit}  {{elapsed}} (left {{eta}})"
    ))
    .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(steps as u64).with_style(style)
}
