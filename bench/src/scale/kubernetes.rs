//! An indexed Kubernetes Job for the shards, and a Job that merges them.

use std::path::PathBuf;

use super::{ScaleError, Shards, arguments, fill, memory_mib, planned, quoted_path, write};

/// Options of the Kubernetes files for a plan.
#[derive(Debug, Clone)]
pub struct Kubernetes {
    pub shards: Shards,
    /// Maximum number of shards that run at once.
    pub parallel: usize,
    /// Container image that includes `sharp-bench`.
    pub image: String,
    /// Claim of the volume with the plan and the files that the plan reads.
    pub claim: String,
    /// Mount point of the volume; the plan's paths must be below it.
    pub mount: PathBuf,
    pub out: PathBuf,
}

/// Kubernetes' limit for a Job whose indices fail independently.
const MAX_SHARDS: usize = 100_000;

/// Writes `job.yaml` and `merge.yaml`; returns their paths.
///
/// # Errors
/// If there is no plan, its folder is not below the mount point, there are too many shards, or an existing file that
/// would be overwritten was not written by this program.
pub fn kubernetes(request: &Kubernetes) -> Result<Vec<PathBuf>, ScaleError> {
    let Kubernetes { shards, out, .. } = request;
    if !shards.plan.starts_with(&request.mount) {
        return Err(ScaleError::Refused {
            what: "--mount",
            value: request.mount.display().to_string(),
            reason: "the plan is not below this folder, so no pod could read it",
        });
    }
    if shards.count > MAX_SHARDS {
        return Err(ScaleError::Refused {
            what: "--shards",
            value: shards.count.to_string(),
            reason: "an indexed Job with retries per index has at most 100000 indices; use fewer, larger shards",
        });
    }
    let (estimate, name) = planned(shards)?;
    let plan = quoted_path("plan", &shards.plan)?;
    // The shell, as a container's first process, must forward SIGTERM. A shard with recorded failures (exit code 4)
    // counts as done.
    let script = format!(
        "sharp-bench --quiet run --plan {plan} --shard auto/{} --threads {} {} & run=$!; trap 'kill -TERM $run' TERM; \
         wait $run; code=$?; while kill -0 $run 2>/dev/null; do wait $run; code=$?; done; \
         [ $code -ne 4 ] || code=0; exit $code",
        shards.count,
        shards.cpus,
        arguments(shards)
    );
    let values = vec![
        ("plan", yaml(&unexpanded(&shards.plan.to_string_lossy()))),
        ("name", name),
        ("shards", shards.count.to_string()),
        ("parallel", request.parallel.min(shards.count).to_string()),
        ("image", yaml(&request.image)),
        ("claim", yaml(&request.claim)),
        ("mount", yaml(&request.mount.to_string_lossy())),
        ("cpus", shards.cpus.to_string()),
        (
            "memory_mib",
            memory_mib(estimate.total.peak_bytes).to_string(),
        ),
        ("script", yaml(&unexpanded(&script))),
    ];
    let files = [
        ("job.yaml", include_str!("../../templates/scale/job.yaml")),
        (
            "merge.yaml",
            include_str!("../../templates/scale/merge.yaml"),
        ),
    ];
    let files = files.map(|(file, text)| (file.to_owned(), fill(text, &values)));
    write(out, files.into())
}

/// Escapes a part of a container's command: Kubernetes expands `$(NAME)` and turns `$$` into `$`.
fn unexpanded(text: &str) -> String {
    text.replace('$', "$$")
}

/// Quotes a string for every version of YAML, escaping line breaks and forbidden characters.
fn yaml(text: &str) -> String {
    let escaped = text.chars().map(|c| match u32::from(c) {
        _ if "\"\\".contains(c) => format!("\\{c}"),
        0x20..=0x7e => c.to_string(),
        code => format!("\\U{code:08x}"),
    });
    format!("\"{}\"", escaped.collect::<String>())
}
