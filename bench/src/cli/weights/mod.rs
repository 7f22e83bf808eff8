//! `weights`: lists, fetches and checks weights.

mod check;
mod fetch;
mod list;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use sharp::model::{ModelConfig, synth};
use sharp_checkpoint::Checkpoint;

use super::{Outcome, output};

/// List, fetch, check and convert weights, or make weights for tests
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench weights list
  sharp-bench weights fetch metrics
  sharp-bench weights fetch sharp --accept-licence
  sharp-bench weights check sharp_2572gikvuh.pt
  sharp-bench weights convert sharp_2572gikvuh.pt sharp.safetensors
  sharp-bench weights synth --config tiny_config.json#tiny --out tiny.safetensors")]
pub(super) struct WeightsArgs {
    #[command(subcommand)]
    command: WeightsCommand,
}

#[derive(Debug, Subcommand)]
enum WeightsCommand {
    /// List published weights: source, size, and whether they are present
    List {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Fetch published weights into the cache: resumes interrupted transfers, checks size and hash
    ///
    /// Of the networks of LPIPS and DISTS, only the feature layers are kept. No hash of SHARP's checkpoint is
    /// published, so its size and sha256 are recorded at the first use, and later uses are compared with this record. A
    /// checkpoint in the release's own cache folder is used from there. Proxies are read from the usual environment
    /// variables. If SHARP_BENCH_MIRROR is set to an address, files are fetched from that address under their
    /// publishers' file names.
    Fetch(fetch::FetchArgs),
    /// Show the contents of a file: modules, parameters, non-finite values
    ///
    /// A file that looks like SHARP's, or any file with --config, is compared with a network: the file must have the
    /// tensors that the network uses, with the same shapes, and no unknown tensors. Without --config, the network is
    /// that of a fitting .json next to the file, or else the release's.
    Check {
        /// The file: .pt, .pth (zip or older) or .safetensors
        file: PathBuf,
        /// The network that the file should fit: `release`, or FILE.json#NAME for a network of another size
        #[arg(long, value_name = "FILE[#NAME]")]
        config: Option<String>,
        /// Accept unknown tensors with this name prefix; repeatable
        #[arg(long, value_name = "PREFIX")]
        allow_unused: Vec<String>,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Rewrite a checkpoint as .safetensors, with the checkpoint's sha256 in the header
    Convert {
        /// The checkpoint to read
        from: PathBuf,
        /// The .safetensors file to write
        to: PathBuf,
    },
    /// Write deterministic weights, computed from the tensors' names alone, for tests without real weights
    Synth {
        /// Architecture of the network, `release` or FILE.json#NAME
        #[arg(long, value_name = "FILE[#NAME]", default_value = "release")]
        config: String,
        /// Any text; different texts give different weights
        #[arg(long, default_value = "")]
        salt: String,
        /// The file to write
        #[arg(long, value_name = "FILE.safetensors")]
        out: PathBuf,
    },
}

pub(super) fn execute(args: &WeightsArgs) -> anyhow::Result<Outcome> {
    match &args.command {
        WeightsCommand::List { json } => list::execute(*json),
        WeightsCommand::Fetch(args) => fetch::execute(args),
        WeightsCommand::Check {
            file,
            config,
            allow_unused,
            json,
        } => check::execute(file, config.as_deref(), allow_unused, *json),
        WeightsCommand::Convert { from, to } => {
            let checkpoint = Checkpoint::open(from)?;
            checkpoint.convert(to, |_| true)?;
            output::line(format!(
                "{}  {} tensors",
                to.display(),
                checkpoint.names().len()
            ))?;
            Ok(Outcome::Done)
        }
        WeightsCommand::Synth { config, salt, out } => {
            synth::write(&load_config(config)?, salt, out)?;
            output::line(out.display().to_string())?;
            Ok(Outcome::Done)
        }
    }
}

fn load_config(name: &str) -> anyhow::Result<ModelConfig> {
    Ok(match name {
        "release" => ModelConfig::release(),
        file => ModelConfig::load(file)?,
    })
}
