//! `scale`: writes files that submit the shards of a plan to a scheduler.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::outcome::UsageError;
use super::{Outcome, output};
use crate::config::RunConfig;
use crate::evaluate::RunFolder;
use crate::scale::{Kubernetes, Shards, Slurm, kubernetes, slurm};

/// Write the job files that run a plan, made by `run --plan-only`, on a cluster
///
/// The plan must be visible to all nodes. Jobs request the resources
/// that the plan estimated; read the files before you submit them. With any other scheduler, run
/// `run --plan DIR --shard I/N` for I from 1 to N, then `merge DIR`.
#[derive(Debug, Args)]
pub(super) struct ScaleArgs {
    #[command(subcommand)]
    scheduler: Scheduler,
}

#[derive(Debug, Subcommand)]
enum Scheduler {
    /// Write Slurm array jobs: a script per stage of the run, one for merging, and submit.sh, which submits
    /// the shards that are not finished yet. A plan with `command` methods needs --allow-programs
    #[command(after_help = "\
Example:
  sharp-bench scale slurm --plan /shared/runs/all --shards 64 --cpus 8 --out jobs \\
      --sbatch pictures=--gres=gpu:1 --sbatch every=--partition=main
  bash jobs/submit.sh")]
    Slurm(SlurmArgs),
    /// Write an indexed Kubernetes Job that runs the shards, and a Job that merges them
    #[command(after_help = "\
Example:
  sharp-bench scale kubernetes --plan /data/runs/all --shards 64 --image registry/sharp-bench:1 \\
      --claim data --mount /data --out jobs && kubectl apply -f jobs/job.yaml")]
    Kubernetes(KubernetesArgs),
}

#[derive(Debug, Args)]
struct ShardArgs {
    /// The plan's run folder, as a path on the nodes
    #[arg(long, value_name = "DIR")]
    plan: PathBuf,
    /// Number of shards. Each shard loads the models again, so make the shards large enough to run for minutes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    shards: u32,
    /// Cores per job
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=4096))]
    cpus: u32,
    /// Allow the plan's `command` methods to start their programs
    #[arg(long)]
    allow_programs: bool,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print the list of written files as JSON
    #[arg(long)]
    json: bool,
}

impl ShardArgs {
    fn shards(&self, retry_failed: bool) -> anyhow::Result<Shards> {
        Ok(Shards {
            plan: std::path::absolute(&self.plan)?,
            count: self.shards as usize,
            cpus: self.cpus as usize,
            retry_failed,
            allow_programs: self.allow_programs,
        })
    }
}

#[derive(Debug, Args)]
struct SlurmArgs {
    #[command(flatten)]
    shards: ShardArgs,
    /// Path of sharp-bench on the nodes [default: this program]
    #[arg(long, value_name = "FILE")]
    binary: Option<PathBuf>,
    /// Submit one array for all stages, instead of one for pictures (predictions and renderings) and one for scores
    #[arg(long)]
    one_array: bool,
    /// Pass OPTION to sbatch for JOB: pictures, score, all (with --one-array), merge, or every (for all of these);
    /// repeatable
    #[arg(long = "sbatch", value_name = "JOB=OPTION", value_parser = option)]
    options: Vec<(String, String)>,
    /// Also submit shards with recorded failures
    #[arg(long)]
    retry_failed: bool,
}

#[derive(Debug, Args)]
struct KubernetesArgs {
    #[command(flatten)]
    shards: ShardArgs,
    /// Maximum number of concurrent shards
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    parallel: u32,
    /// A container image that includes sharp-bench
    #[arg(long)]
    image: String,
    /// PersistentVolumeClaim of the volume with plan and datasets
    #[arg(long)]
    claim: String,
    /// Mount point of the volume
    #[arg(long, value_name = "DIR", default_value = "/data")]
    mount: PathBuf,
}

/// Path of this program. Fails if the program is not `sharp-bench` itself, such as a Python interpreter.
fn own_program() -> anyhow::Result<PathBuf> {
    let program = std::env::current_exe()?;
    let stem = program.file_stem().unwrap_or_default();
    if stem != env!("CARGO_PKG_NAME") {
        let reason = "give the program's path on the nodes with --binary FILE";
        return Err(UsageError(reason.to_owned()).into());
    }
    Ok(program)
}

fn option(text: &str) -> Result<(String, String), &'static str> {
    let (job, option) = text.split_once('=').ok_or("expected JOB=OPTION")?;
    Ok((job.to_owned(), option.to_owned()))
}

pub(super) fn execute(args: &ScaleArgs) -> anyhow::Result<Outcome> {
    let (files, shards) = match &args.scheduler {
        Scheduler::Slurm(args) => {
            let files = slurm(&Slurm {
                shards: args.shards.shards(args.retry_failed)?,
                binary: match &args.binary {
                    Some(binary) => binary.clone(),
                    None => own_program()?,
                },
                stages_apart: !args.one_array,
                options: args.options.clone(),
                out: args.shards.out.clone(),
            })?;
            (files, &args.shards)
        }
        Scheduler::Kubernetes(args) => {
            let files = kubernetes(&Kubernetes {
                shards: args.shards.shards(false)?,
                parallel: args.parallel as usize,
                image: args.image.clone(),
                claim: args.claim.clone(),
                mount: args.mount.clone(),
                out: args.shards.out.clone(),
            })?;
            (files, &args.shards)
        }
    };
    let config = RunConfig::read(&RunFolder::open(&shards.plan)?.config_path())?;
    if let Some(method) = config.program().filter(|_| !shards.allow_programs) {
        output::remark(format!(
            "warning: the plan starts a program, --method {method}, which shards refuse to start; if you trust the \
             program, write the files again with --allow-programs"
        ));
    }
    output::print_written(shards.json, &files)?;
    Ok(Outcome::Done)
}
