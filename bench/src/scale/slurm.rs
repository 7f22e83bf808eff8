//! Slurm array jobs, one per stage of the run, and a script that submits the shards that are not finished yet.

use std::path::PathBuf;

use super::{ScaleError, Shards, arguments, fill, memory_mib, planned, quoted_path, write};
use crate::evaluate::plan::{Estimate, StageCost};

/// Options of the Slurm scripts for a plan.
#[derive(Debug, Clone)]
pub struct Slurm {
    pub shards: Shards,
    /// Path of the program as seen by the nodes.
    pub binary: PathBuf,
    /// Whether pictures and scores run as separate arrays instead of one.
    pub stages_apart: bool,
    /// Options of `sbatch` as pairs (job, option). The job is `pictures`, `score`, `all` or
    /// `merge`; `every` stands for all four.
    pub options: Vec<(String, String)>,
    pub out: PathBuf,
}

/// Valid values of JOB in `--sbatch JOB=OPTION`.
const JOBS: [&str; 5] = ["pictures", "score", "all", "merge", "every"];

/// Writes one script per stage, the merge script and `submit.sh`; returns their paths.
///
/// # Errors
/// If the folder has no plan, or an existing file that would be overwritten was not written by this
/// program.
pub fn slurm(request: &Slurm) -> Result<Vec<PathBuf>, ScaleError> {
    let Slurm { shards, out, .. } = request;
    let (estimate, name) = planned(shards)?;
    let stages = if request.stages_apart {
        vec!["pictures", "score"]
    } else {
        vec!["all"]
    };
    let values = |stage: &'static str| -> Result<super::Values, ScaleError> {
        let cost = cost(&estimate, stage);
        let plan = quoted_path("plan", &shards.plan)?;
        Ok(vec![
            ("plan", plan.clone()),
            ("binary", quoted_path("binary", &request.binary)?),
            ("name", name.clone()),
            ("stage", stage.to_owned()),
            ("stages", stages.join(" ")),
            ("shards", shards.count.to_string()),
            ("cpus", shards.cpus.to_string()),
            ("memory_mib", memory_mib(cost.peak_bytes).to_string()),
            ("minutes", minutes(cost.cpu_secs, shards).to_string()),
            ("options", options(&request.options, stage)?),
            // Scoring opens no method, so it does not need the files and devices of methods.
            (
                "command",
                match stage {
                    "score" => format!("score {plan}"),
                    _ => format!("run --plan {plan} --stage {stage} {}", arguments(shards)),
                },
            ),
            (
                "retry",
                if shards.retry_failed {
                    "--retry-failed".to_owned()
                } else {
                    String::new()
                },
            ),
        ])
    };
    let mut files = Vec::new();
    for stage in &stages {
        let text = include_str!("../../templates/scale/stage.sbatch");
        let text = fill(text, &values(stage)?);
        files.push((format!("{stage}.sbatch"), text));
    }
    for (file, text) in [
        (
            "merge.sbatch",
            include_str!("../../templates/scale/merge.sbatch"),
        ),
        ("submit.sh", include_str!("../../templates/scale/submit.sh")),
    ] {
        files.push((file.to_owned(), fill(text, &values("merge")?)));
    }
    write(out, files)
}

fn cost(estimate: &Estimate, job: &str) -> StageCost {
    match job {
        "pictures" => StageCost {
            cpu_secs: estimate.predict.cpu_secs + estimate.render.cpu_secs,
            peak_bytes: estimate.predict.peak_bytes.max(estimate.render.peak_bytes),
            ..estimate.render
        },
        "score" => estimate.score,
        "all" => estimate.total,
        _ => StageCost::default(),
    }
}

/// Time to request, in minutes: three times the expected time of a shard with half of its cores
/// busy, and at least 30 minutes. A shard that does not finish in this time is requeued.
fn minutes(cpu_secs: f64, shards: &Shards) -> u64 {
    let share = cpu_secs / shards.count as f64 / (shards.cpus as f64 / 2.0).max(1.0);
    (3.0 * share / 60.0).ceil().max(30.0) as u64
}

/// The `#SBATCH …` lines of a job.
fn options(given: &[(String, String)], job: &str) -> Result<String, ScaleError> {
    let mut lines = Vec::new();
    for (of, option) in given {
        if !JOBS.contains(&of.as_str())
            || option.contains(char::is_control)
            || !option.starts_with('-')
        {
            return Err(ScaleError::Refused {
                what: "--sbatch",
                value: format!("{of}={}", option.escape_debug()),
                reason: "expected JOB=OPTION, such as pictures=--gres=gpu:1; jobs are pictures, score, all, merge \
                         and every",
            });
        }
        if of == job || of == "every" {
            lines.push(format!("#SBATCH {option}"));
        }
    }
    Ok(lines.join("\n"))
}
