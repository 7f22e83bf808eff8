//! `completions SHELL`: shell completion scripts.

use clap::Args;
use clap_complete::Shell;

use super::{Outcome, help};

/// Write a completion script for a shell to standard output
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  sharp-bench completions bash > ~/.local/share/bash-completion/completions/sharp-bench"
)]
pub(super) struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

pub(super) fn execute(args: &CompletionsArgs) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut help::command(), "sharp-bench", &mut script);
    super::output::line(String::from_utf8_lossy(&script).trim_end())?;
    Ok(Outcome::Done)
}
