//! Files that submit the shards of a plan to a scheduler.
//!
//! Each file is a template in which `{{name}}` is replaced by a value.

mod kubernetes;
mod slurm;

use std::path::{Path, PathBuf};

use crate::evaluate::{Estimate, EvaluateError, RunFolder};
use crate::io::atomic_files::{FileError, write_over_own};
use crate::io::hash::sha256_hex;

pub use kubernetes::{Kubernetes, kubernetes};
pub use slurm::{Slurm, slurm};

/// Options common to all schedulers.
#[derive(Debug, Clone)]
pub struct Shards {
    /// The plan's run folder: absolute, as seen by the nodes.
    pub plan: PathBuf,
    pub count: usize,
    /// Number of cores per shard.
    pub cpus: usize,
    /// Whether to resubmit shards with recorded failures.
    pub retry_failed: bool,
    /// Whether shards may start the programs of `command` methods.
    pub allow_programs: bool,
}

/// Why the files cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ScaleError {
    /// The plan cannot be read.
    #[error(transparent)]
    Plan(#[from] EvaluateError),
    #[error(transparent)]
    File(#[from] FileError),
    /// The folder has no plan for shards.
    #[error("{}: not planned by `run --plan-only`", .0.display())]
    NotPlanned(PathBuf),
    /// A value cannot be written into a script.
    #[error("{what} '{value}': {reason}")]
    Refused {
        what: &'static str,
        value: String,
        reason: &'static str,
    },
}

/// Identifies a file as written by this program; among the first lines of the file.
const MARK: &str = "sharp-bench scale";

/// Values for a template, with the names of their placeholders.
type Values = Vec<(&'static str, String)>;

/// Fills a template in one pass, so that placeholders in values are not expanded.
fn fill(template: &str, values: &Values) -> String {
    let mut parts = template.split("{{");
    let mut filled = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (name, rest) = part.split_once("}}").unwrap_or((part, ""));
        let value = values.iter().find(|(known, _)| *known == name);
        filled += value.map_or("", |(_, value)| value);
        filled += rest;
    }
    filled
}

/// Writes files into a folder, overwriting only files that this program wrote. Returns the paths.
fn write(out: &Path, files: Vec<(String, String)>) -> Result<Vec<PathBuf>, ScaleError> {
    let mut written = Vec::new();
    for (name, text) in files {
        let path = out.join(name);
        // Insert the mark after the shebang line.
        let (first, rest) = if text.starts_with("#!") {
            text.split_once('\n').unwrap_or((&text, ""))
        } else {
            ("", text.as_str())
        };
        let first = match first {
            "" => String::new(),
            line => format!("{line}\n"),
        };
        let marked = format!("{first}# made by {MARK}\n{rest}");
        write_over_own(&path, marked.as_bytes(), MARK)?;
        written.push(path);
    }
    Ok(written)
}

/// The plan's estimated cost, and a name for the plan's jobs.
fn planned(shards: &Shards) -> Result<(Estimate, String), ScaleError> {
    let plan = RunFolder::open(&shards.plan).map_err(EvaluateError::from)?;
    let plan = plan.plan()?;
    let not_planned = || ScaleError::NotPlanned(shards.plan.clone());
    let estimate = plan.estimate.ok_or_else(not_planned)?;
    let name = shards
        .plan
        .file_name()
        .unwrap_or_default()
        .to_string_lossy();
    // Restrict the name to what all schedulers accept; Kubernetes is the strictest. Job names must
    // be unique.
    let plain = name.chars().map(|c| match c.to_ascii_lowercase() {
        c if c.is_ascii_alphanumeric() => c,
        _ => '-',
    });
    let name: String = plain.take(40).collect();
    let place = sha256_hex(shards.plan.as_os_str().as_encoded_bytes());
    Ok((estimate, format!("sharp-{name}-{}", &place[..8])))
}

/// Quotes a text for a shell; control characters are an error.
fn quoted(what: &'static str, text: &str) -> Result<String, ScaleError> {
    if text.contains(char::is_control) {
        return Err(ScaleError::Refused {
            what,
            value: text.escape_debug().to_string(),
            reason: "a script cannot contain control characters",
        });
    }
    // Quote `=`, because a leading `NAME=value` would set a variable.
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+:@%".contains(c);
    Ok(if !text.is_empty() && text.chars().all(plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    })
}

fn quoted_path(what: &'static str, path: &Path) -> Result<String, ScaleError> {
    let text = path.to_str().ok_or_else(|| ScaleError::Refused {
        what,
        value: path.display().to_string(),
        reason: "a script can only contain Unicode",
    })?;
    quoted(what, text)
}

/// Memory to request in MiB: 1.5 times the measured peak, rounded up to whole GiB, at least two.
fn memory_mib(peak_bytes: Option<u64>) -> u64 {
    let gib = peak_bytes.unwrap_or_default() as f64 / f64::from(1 << 30);
    (gib * 1.5).ceil().max(2.0) as u64 * 1024
}

/// Command-line arguments of every shard.
fn arguments(shards: &Shards) -> String {
    if shards.allow_programs {
        "--allow-programs".to_owned()
    } else {
        String::new()
    }
}

#[cfg(test)]
mod tests;
