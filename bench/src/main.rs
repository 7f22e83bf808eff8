//! `sharp-bench`, the command line of the harness.

use std::process::ExitCode;

use clap::Parser;
use sharp_bench::cli::Cli;

fn main() -> ExitCode {
    match Cli::parse().execute() {
        Ok(outcome) => outcome.into(),
        Err(error) => {
            // The alternate form joins the causes: one line that names file and reason.
            let line = format!("error: {error:#}\n");
            // Nothing is left to do when standard error itself is gone.
            let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
            ExitCode::FAILURE
        }
    }
}
