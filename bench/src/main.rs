//! `sharp-bench`, the command line of the harness.

use std::borrow::Cow;
use std::process::ExitCode;

use clap::Parser;
use sharp_bench::cli::{Cli, is_usage, with_planned};
use sharp_bench::io::text::{shortened, visible, visible_line};

fn main() -> ExitCode {
    quieten_mesa();
    match parse().and_then(Cli::execute) {
        Ok(outcome) => outcome.into(),
        Err(error) => {
            let text = one_line(&error);
            let line = format!(
                "error: {}\n",
                visible_line(&shortened(&text, LONGEST_ERROR))
            );
            // Nothing is left to do when standard error itself is gone.
            let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
            match is_usage(&error) {
                true => ExitCode::from(2),
                false => ExitCode::FAILURE,
            }
        }
    }
}

/// Characters of an error that are printed: a file that is one line would come back whole.
const LONGEST_ERROR: usize = 4000;

/// The command line. Its errors quote it, and are shown with nothing that a terminal obeys.
fn parse() -> anyhow::Result<Cli> {
    let arguments = with_planned(std::env::args_os().collect())?;
    Ok(Cli::try_parse_from(arguments).unwrap_or_else(|error| {
        let text = error.render().to_string();
        match visible(&text) {
            Cow::Borrowed(_) => error.exit(),
            Cow::Owned(harmless) => {
                // As above.
                let _ = std::io::Write::write_all(&mut std::io::stderr(), harmless.as_bytes());
                std::process::exit(error.exit_code())
            }
        }
    }))
}

/// Without a session, Mesa's device-select layer complains on standard error that it cannot ask the desktop which GPU
/// is the default one. The layer is left out then; adapters are ordered by ourselves anyway.
#[cfg(target_os = "linux")]
fn quieten_mesa() {
    let set = |name| std::env::var_os(name).is_some();
    if !set("XDG_RUNTIME_DIR") && !set("MESA_VK_DEVICE_SELECT") {
        // SAFETY: called first in `main`, before there is another thread that could read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

#[cfg(not(target_os = "linux"))]
fn quieten_mesa() {}

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
