//! `sharp-bench`, the command line of the harness.

use std::process::ExitCode;

use clap::Parser;
use sharp_bench::cli::Cli;

fn main() -> ExitCode {
    match Cli::parse().execute() {
        Ok(outcome) => outcome.into(),
        Err(error) => {
            let line = format!("error: {}\n", one_line(&error));
            // Nothing is left to do when standard error itself is gone.
            let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
            ExitCode::FAILURE
        }
    }
}

/// An error with its causes, without those that its text already holds: one line that names file and reason.
fn one_line(error: &anyhow::Error) -> String {
    error
        .chain()
        .map(ToString::to_string)
        .fold(String::new(), |line, cause| {
            if line.is_empty() {
                cause
            } else if line.contains(&cause) {
                line
            } else {
                format!("{line}: {cause}")
            }
        })
}
