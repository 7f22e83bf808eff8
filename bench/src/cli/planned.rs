//! `run --plan`: the command line that planned, again.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};

use super::outcome::UsageError;
use super::run::RunArgs;
use crate::evaluate::{PlannedCommand, RunFolder};
use crate::methods::MethodSpec;

/// Options of a shard beside `--plan`: which one it is, whether programs start, and what changes no value.
const OF_SHARDS: [&str; 8] = [
    "--shard",
    ALLOW_PROGRAMS,
    "--stage",
    "--threads",
    "--memory-limit",
    "--time-budget",
    "--simd",
    "--json",
];

const ALLOW_PROGRAMS: &str = "--allow-programs";

/// The arguments of a command line; those of `run --plan DIR` with the ones that DIR was planned with before them, so that
/// its own count.
///
/// # Errors
/// When there is no such plan, or an option beside it that would change what was planned.
pub(super) fn with_planned(mut arguments: Vec<OsString>) -> anyhow::Result<Vec<OsString>> {
    let is_command = |argument: &OsString| !argument.to_string_lossy().starts_with('-');
    let command = arguments.iter().skip(1).position(is_command);
    let Some(run) = command
        .map(|at| at + 1)
        .filter(|at| arguments[*at] == "run")
    else {
        return Ok(arguments);
    };
    let own = &arguments[run + 1..];
    let plan = own
        .iter()
        .enumerate()
        .find_map(|(at, argument)| match argument.to_str() {
            Some("--plan") => own.get(at + 1).map(PathBuf::from),
            Some(argument) => argument.strip_prefix("--plan=").map(PathBuf::from),
            None => None,
        });
    if let Some(root) = plan {
        let others = ["--plan", "--quiet", "-q", "--help", "-h", "--help-all"];
        let is_known = |argument: &str| {
            let name = argument.split('=').next();
            !argument.starts_with('-')
                || OF_SHARDS
                    .iter()
                    .chain(&others)
                    .any(|known| name == Some(*known))
        };
        let foreign = own
            .iter()
            .filter_map(|argument| argument.to_str())
            .find(|argument| !is_known(argument));
        if let Some(option) = foreign {
            let options = OF_SHARDS.join(", ");
            let reason = format!(
                "{option}: a shard does what was planned; beside --plan there are {options}"
            );
            return Err(UsageError(reason).into());
        }
        let planned = planned(&root)?.arguments;
        // That is for whoever starts the shard to say, not for whoever made the plan.
        if planned.iter().any(|argument| argument == ALLOW_PROGRAMS) {
            bail!(
                "{}: its arguments hold {ALLOW_PROGRAMS}, which no plan does: it was changed",
                root.join("plan.json").display()
            );
        }
        arguments.splice(run + 1..run + 1, planned.into_iter().map(OsString::from));
    }
    Ok(arguments)
}

fn planned(root: &Path) -> anyhow::Result<PlannedCommand> {
    let plan = RunFolder::open(root)?.plan()?;
    plan.command.ok_or_else(|| {
        anyhow!(
            "{}: it was not planned by `run --plan-only`, so that it has no shards",
            root.display()
        )
    })
}

/// The arguments that planned, as a shard takes them; and the folder in which their paths start.
pub(super) fn this_command() -> anyhow::Result<PlannedCommand> {
    let mut arguments = Vec::new();
    let own = std::env::args_os()
        .skip(1)
        .skip_while(|argument| argument != "run");
    for argument in own.skip(1) {
        match argument.into_string() {
            Ok(argument) => arguments.push(argument),
            Err(argument) => bail!("{}: a plan holds Unicode only", argument.display()),
        }
    }
    Ok(PlannedCommand {
        arguments,
        directory: std::env::current_dir()?,
    })
}

/// The folder of a plan, from where its command was given: relative paths lead on from there.
pub(super) fn enter(root: &Path, args: &RunArgs) -> anyhow::Result<PathBuf> {
    let root = std::path::absolute(root)?;
    let PlannedCommand { directory, .. } = planned(&root)?;
    std::env::set_current_dir(&directory).with_context(|| {
        format!(
            "{}: relative paths of the plan start there, and it is not here",
            directory.display()
        )
    })?;
    for spec in args.methods.iter().filter(|_| !args.allow_programs) {
        if spec.parse::<MethodSpec>()?.kind == "command" {
            let reason = format!(
                "the plan starts a program, --method {spec}: if you trust it, say --allow-programs"
            );
            return Err(UsageError(reason).into());
        }
    }
    Ok(root)
}
