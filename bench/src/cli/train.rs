//! `train`: trains a network from scratch, or resumes a training run.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use serde_json::{Map, json};
use sharp_train::trainer::Ended;

use super::outcome::UsageError;
use super::output::Terminal;
use super::run::time;
use super::{Outcome, output};
use crate::config::MetricConfig;
use crate::io::counts::counted;
use crate::io::hash::file_sha256;
use crate::pairs::DatasetConfig;
use crate::pictures::keyed_scores::json_number;
use crate::train::{TrainRequest, Trained, ValidationRequest, train};

/// Train a network with SHARP's architecture, in both of SHARP's training stages
///
/// The configuration sets the network, losses, data, schedule and intervals; omitted keys have the paper's values. The
/// same command resumes an interrupted run (Ctrl-C, SIGTERM, --time-budget); log and weights are then byte-identical to
/// those of a run without interruption. Weights are validated on held-out pairs, in the same way as `run` evaluates a
/// method.
#[derive(Debug, Args)]
#[command(mut_arg("device", |arg| arg.help(
    "Device that trains the network and computes LPIPS and DISTS: cpu, cuda or metal (if built in; metal is \
     untested), or candle-cpu (runs the GPU code on the CPU, slowly). The last bits of the weights depend on the \
     device [default: cpu]"
)))]
#[command(after_help = "\
Examples:
  sharp-bench train mine.toml --out training
  sharp-bench run --dataset synthetic=seed=3 --out runs/mine \\
      --method sharp:checkpoint=training/weights.safetensors,config=training/network.json

Writes config.toml, network.json, log.csv, timing.csv, validation.csv, index.html, checkpoints/, the run folder
validation/, and in the end weights.safetensors. bench/docs/train.md explains the configuration.")]
pub(super) struct TrainArgs {
    /// The configuration, a TOML file
    #[arg(value_name = "CONFIG.toml")]
    config: PathBuf,
    /// Override a value of the configuration by its dotted key, as in stage1.steps=500 or losses.percep=0;
    /// an empty value restores the default; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Output folder; an unfinished run in it is resumed
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A dataset to validate on, [NAME:]FORMAT=PATH[,key=value…]; repeatable. Procedural scenes need seeds below 1000,
    /// or 900000 and above; these are never used for training
    #[arg(long, value_name = "SPEC", default_value = ValidationRequest::DATASET)]
    validation: Vec<DatasetConfig>,
    /// Maximum number of validation pairs, spread over datasets and scenes
    #[arg(long, value_name = "N", default_value_t = ValidationRequest::PAIRS)]
    validation_pairs: usize,
    #[command(flatten)]
    metrics: MetricConfig,
    /// Also write the weights in half precision when training is complete
    #[arg(long, value_name = "FILE.safetensors")]
    export_f16: Option<PathBuf>,
    /// Start no new step once this much time has passed; then exit with code 75, as after Ctrl-C or SIGTERM. Times are
    /// written as 90s, 55m or 3h
    #[arg(long, value_name = "TIME", value_parser = time)]
    time_budget: Option<Duration>,
    /// Number of threads; does not affect the results [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &TrainArgs) -> anyhow::Result<Outcome> {
    super::set_threads(args.threads)?;
    if args.validation_pairs == 0 {
        let reason = "--validation-pairs must be at least 1; to disable validation, set `intervals.validation = 0` \
                      in the configuration";
        return Err(UsageError(reason.to_owned()).into());
    }
    let selection = args.metrics.selection()?;
    let validation = ValidationRequest {
        datasets: args.validation.clone(),
        pairs: args.validation_pairs,
        scoring: args.metrics.complete_scoring(&selection)?,
    };
    let terminal = Terminal::until_interrupted(args.time_budget)?;
    let request = TrainRequest {
        config: &args.config,
        set: &args.set,
        folder: &args.out,
        validation,
        device: args.metrics.device.unwrap_or_default().name().parse()?,
        export_f16: args.export_f16.as_deref(),
    };
    let Trained {
        ended,
        position,
        perceptual_network,
        parameters: (learning, all),
        weights,
        validated,
        page,
    } = train(request, &terminal)?;
    let weights_sha256 = weights.as_deref().map(file_sha256).transpose()?;
    let weights = weights.map(|path| path.display().to_string());
    let value = || {
        let number = |(name, value): &(String, f64)| (name.clone(), json_number(*value));
        json!({
            "complete": ended == Ended::Complete,
            "stage": position.stage.number(),
            "step": position.step,
            "parameters": all,
            "learning": learning,
            "perceptual_network": perceptual_network,
            "weights": weights,
            "weights_sha256": weights_sha256,
            "validation": validated.iter().map(number).collect::<Map<_, _>>(),
            "page": page.display().to_string(),
        })
    };
    output::print(args.json, value, || {
        let mut text = String::new();
        for (name, value) in &validated {
            text += &format!("{name}  {value:.4}\n");
        }
        text += &match &weights {
            Some(path) => format!("weights {path}\n"),
            None => format!("stopped after {position}; the same command resumes it\n"),
        };
        let parameters = counted(all, "parameter");
        text += &format!("network {parameters}, of which {learning} trained\n");
        if let Some(network) = &perceptual_network {
            text += &format!("perceptual loss on {network}\n");
        }
        text + &format!("page    {}", page.display())
    })?;
    Ok(match ended {
        Ended::Complete => Outcome::Done,
        Ended::Stopped(_) => Outcome::Resumable,
    })
}
