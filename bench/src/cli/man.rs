//! `man`: manual pages.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{Outcome, help, output};
use crate::io::atomic_files::write_over_own;

/// Write manual pages, one per command
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  sharp-bench man --out ~/.local/share/man/man1 && man sharp-bench-run"
)]
pub(super) struct ManArgs {
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print the list of written files as JSON
    #[arg(long)]
    json: bool,
}

/// Beginning of every generated page. An existing file is overwritten only if it begins with this.
const MARK: &str = ".ie";

pub(super) fn execute(args: &ManArgs) -> anyhow::Result<Outcome> {
    let mut command = help::command().disable_help_subcommand(true);
    command.build();
    let mut files = Vec::new();
    pages(&command, &mut |name, page| {
        let path = args.out.join(format!("{name}.1"));
        write_over_own(&path, page, MARK)?;
        files.push(path.display().to_string());
        Ok(())
    })?;
    output::print(
        args.json,
        || json!({ "files": files }),
        || format!("wrote {} pages to {}", files.len(), args.out.display()),
    )?;
    Ok(Outcome::Done)
}

fn pages(
    command: &clap::Command,
    write: &mut dyn FnMut(&str, &[u8]) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let name = command.get_display_name().unwrap_or(command.get_name());
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut page)?;
    write(name, &page)?;
    command
        .get_subcommands()
        .try_for_each(|sub| pages(sub, write))
}
