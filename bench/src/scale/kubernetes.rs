//! An indexed Job of Kubernetes, and the Job that merges.

use std::path::PathBuf;

use super::{ScaleError, Shards, arguments, fill, memory_mib, planned, quoted_path, write};

/// Options of the Kubernetes files for a plan.
#[derive(Debug, Clone)]
pub struct Kubernetes {
    pub shards: Shards,
    /// Most shards that run at once.
    pub parallel: usize,
    /// An image with `sharp-bench` in it.
    pub image: String,
    /// The claim of the volume on which the plan lies, and what it reads.
    pub claim: String,
    /// Where that is mounted; the plan's paths lead there.
    pub mount: PathBuf,
    pub out: PathBuf,
}

/// Kubernetes' limit for a Job whose indices fail independently.
const MOST_SHARDS: usize = 100_000;

/// Writes `job.yaml` and `merge.yaml`.
///
/// # Errors
/// See [`super::slurm()`].
pub fn kubernetes(request: &Kubernetes) -> Result<Vec<PathBuf>, ScaleError> {
    let Kubernetes { shards, out, .. } = request;
    if !shards.plan.starts_with(&request.mount) {
        return Err(ScaleError::Refused {
            what: "--mount",
            value: request.mount.display().to_string(),
            reason: "the plan does not lie below it, so that no pod would see it",
        });
    }
    if shards.count > MOST_SHARDS {
        return Err(ScaleError::Refused {
            what: "--shards",
            value: shards.count.to_string(),
            reason: "an indexed Job that gives up on no index has at most 100000; a shard may hold many units",
        });
    }
    let (estimate, name) = planned(shards)?;
    let plan = quoted_path("plan", &shards.plan)?;
    // The first process of a container gets SIGTERM, and a shell passes none on by itself. Recorded failures are results.
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

/// A part of a container's command: Kubernetes puts values in for `$(NAME)`, and one `$` for two.
fn unexpanded(text: &str) -> String {
    text.replace('$', "$$")
}

/// A string as every version of YAML takes it, also where a character would end a line or is forbidden.
fn yaml(text: &str) -> String {
    let escaped = text.chars().map(|c| match u32::from(c) {
        _ if "\"\\".contains(c) => format!("\\{c}"),
        0x20..=0x7e => c.to_string(),
        code => format!("\\U{code:08x}"),
    });
    format!("\"{}\"", escaped.collect::<String>())
}
