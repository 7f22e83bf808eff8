//! `weights`: which there are, and what is in a file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;
use sharp::model::params::inventory;
use sharp::model::{ModelConfig, synth};
use sharp_checkpoint::{Checkpoint, Expected};

use super::{Outcome, output};

/// List, check, convert and make weights
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench weights check sharp_2572gikvuh.pt
  sharp-bench weights convert sharp_2572gikvuh.pt sharp.safetensors
  sharp-bench weights synth --config tiny_config.json#tiny --out tiny.safetensors")]
pub(super) struct WeightsArgs {
    #[command(subcommand)]
    command: WeightsCommand,
}

#[derive(Debug, Subcommand)]
enum WeightsCommand {
    /// What a file holds: modules, parameters, values that are not finite
    ///
    /// With --config (or for a file that looks like SHARP's) every tensor of the network must be there in its shape,
    /// and none besides.
    Check {
        /// .pt, .pth (zip or older) or .safetensors
        file: PathBuf,
        /// The network that the file should fit, `release` or FILE.json#NAME
        #[arg(long, value_name = "FILE[#NAME]")]
        config: Option<String>,
        /// Accept tensors of this name prefix that the network does not have; repeatable
        #[arg(long, value_name = "PREFIX")]
        allow_unused: Vec<String>,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Rewrite a checkpoint as .safetensors; the source's sha256 goes into its header
    Convert {
        /// The file to read
        from: PathBuf,
        /// The file to write
        to: PathBuf,
    },
    /// Write deterministic weights: a pure function of the tensors' names, for tests without the real ones
    Synth {
        /// Sizes of the network, `release` or FILE.json#NAME
        #[arg(long, value_name = "FILE[#NAME]", default_value = "release")]
        config: String,
        /// Another set of values
        #[arg(long, default_value = "")]
        salt: String,
        /// The file to write
        #[arg(long, value_name = "FILE.safetensors")]
        out: PathBuf,
    },
}

pub(super) fn execute(args: &WeightsArgs) -> anyhow::Result<Outcome> {
    match &args.command {
        WeightsCommand::Check {
            file,
            config,
            allow_unused,
            json,
        } => check(file, config.as_deref(), allow_unused, *json),
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

#[derive(Debug, Default)]
struct Module {
    tensors: usize,
    parameters: usize,
    not_finite: usize,
}

fn check(
    file: &Path,
    config: Option<&str>,
    allow_unused: &[String],
    json: bool,
) -> anyhow::Result<Outcome> {
    let checkpoint = Checkpoint::open(file)?;
    let mut modules: BTreeMap<String, Module> = BTreeMap::new();
    for name in checkpoint.names() {
        let module = modules.entry(module_of(name)).or_default();
        let values = checkpoint.tensor_f32_cow(name)?;
        module.tensors += 1;
        module.parameters += values.len();
        module.not_finite += values.iter().filter(|v| !v.is_finite()).count();
    }
    let total: usize = modules.values().map(|m| m.parameters).sum();
    let not_finite: usize = modules.values().map(|m| m.not_finite).sum();
    let sha256 = checkpoint.sha256();
    if json {
        let modules: BTreeMap<_, _> = modules
            .iter()
            .map(|(name, m)| {
                let facts = json!({
                    "tensors": m.tensors, "parameters": m.parameters, "not_finite": m.not_finite,
                });
                (name, facts)
            })
            .collect();
        output::json(&json!({
            "file": file.display().to_string(),
            "sha256": sha256,
            "tensors": checkpoint.names().len(),
            "parameters": total,
            "not_finite": not_finite,
            "modules": modules,
        }))?;
    } else {
        for (name, module) in &modules {
            output::line(format!(
                "{:>13} in {:>4} tensors  {name}",
                grouped(module.parameters),
                module.tensors
            ))?;
        }
        output::line(format!(
            "{:>13} in {:>4} tensors  in all",
            grouped(total),
            checkpoint.names().len()
        ))?;
        output::line(format!("not finite    {not_finite}"))?;
        output::line(format!("sha256        {sha256}"))?;
    }
    // A file with SHARP's modules is checked against the release even when nothing is said.
    let looks_like_sharp = modules
        .keys()
        .any(|name| name.starts_with("monodepth_model"));
    if let Some(config) = config.or(looks_like_sharp.then_some("release")) {
        let expected: Vec<Expected> = inventory(&load_config(config)?)?
            .into_iter()
            .map(|parameter| Expected {
                name: parameter.name,
                shape: parameter.shape,
            })
            .collect();
        checkpoint.check(&expected, allow_unused)?;
        if !json {
            output::line(format!("complete for {config}"))?;
        }
    }
    anyhow::ensure!(
        not_finite == 0,
        "{}: {not_finite} values are not finite",
        file.display()
    );
    Ok(Outcome::Done)
}

/// The part of a network that a tensor belongs to: four levels deep inside SHARP's encoder, three inside the rest of
/// its depth network, one elsewhere.
fn module_of(name: &str) -> String {
    let levels = if name.starts_with("monodepth_model.monodepth_predictor.encoder.") {
        4
    } else if name.starts_with("monodepth_model.") {
        3
    } else {
        1
    };
    name.split('.').take(levels).collect::<Vec<_>>().join(".")
}

/// Thousands apart: 702 305 169.
fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_and_thousands() {
        let encoder =
            "monodepth_model.monodepth_predictor.encoder.patch_encoder.blocks.0.ls1.gamma";
        assert_eq!(
            module_of(encoder),
            "monodepth_model.monodepth_predictor.encoder.patch_encoder"
        );
        assert_eq!(module_of("features.0.weight"), "features");
        assert_eq!(grouped(702_305_169), "702 305 169");
        assert_eq!(grouped(12), "12");
    }
}
