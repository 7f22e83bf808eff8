//! Standard output: results only, so that it can be piped.

use std::io::{self, Write};

use serde::Serialize;

/// Writes a line. A reader that went away (`| head`) is no error of ours.
pub(super) fn line(text: impl AsRef<str>) -> anyhow::Result<()> {
    ignore_closed_pipe(writeln!(io::stdout().lock(), "{}", text.as_ref()))
}

/// Writes a value as indented JSON.
pub(super) fn json(value: &impl Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string_pretty(value)?)
}

/// Writes a remark to standard error.
pub(super) fn remark(text: impl AsRef<str>) {
    // Nothing is left to do when standard error itself is gone.
    let _ = writeln!(io::stderr().lock(), "{}", text.as_ref());
}

fn ignore_closed_pipe(result: io::Result<()>) -> anyhow::Result<()> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => Ok(other?),
    }
}
