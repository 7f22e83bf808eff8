//! `weights`: which there are, and what is in a file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;
use sharp::model::params::inventory;
use sharp::model::{ModelConfig, synth};
use sharp_checkpoint::{Checkpoint, Expected};
use sharp_metrics::Backbone;
use sharp_metrics::weights::{Published, cache_folder};

use super::{Outcome, output};
use crate::model_files::{RELEASE_ADDRESS, find_checkpoint};

/// List, check, convert and make weights
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench weights list
  sharp-bench weights fetch metrics
  sharp-bench weights check sharp_2572gikvuh.pt
  sharp-bench weights convert sharp_2572gikvuh.pt sharp.safetensors
  sharp-bench weights synth --config tiny_config.json#tiny --out tiny.safetensors")]
pub(super) struct WeightsArgs {
    #[command(subcommand)]
    command: WeightsCommand,
}

#[derive(Debug, Subcommand)]
enum WeightsCommand {
    /// Published weights: where they come from, how large they are, whether they are at hand
    List {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Fetch published backbones into the cache: resumed after a break, checked by size and hash, only the features kept
    ///
    /// Needs a build with `--features download`. Proxies are taken from the usual environment variables.
    Fetch {
        /// `metrics` for all three, or alexnet, vgg16, squeezenet1_1
        #[arg(required = true, value_name = "NAME")]
        names: Vec<String>,
        /// Only say whether they are at hand
        #[arg(long)]
        offline: bool,
    },
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
        WeightsCommand::List { json } => list(*json),
        WeightsCommand::Fetch { names, offline } => fetch(names, *offline),
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

fn list(json: bool) -> anyhow::Result<Outcome> {
    let cache = cache_folder();
    let mut entries = Vec::new();
    for backbone in Backbone::ALL {
        let published = Published::of(backbone);
        let kept = cache.as_deref().map(|cache| published.cached(cache));
        let kept = kept.filter(|path| path.is_file());
        if !json {
            output::line(format!(
                "{:<14} {:>9.3} MiB  {}  {}\n{:<14} sha256 {}…, licence {}",
                backbone.name(),
                published.size_milli_mib as f64 / 1000.0,
                published.address,
                kept.as_ref()
                    .map_or_else(|| "not fetched".to_owned(), |p| p.display().to_string()),
                "",
                published.sha256_prefix,
                published.licence
            ))?;
        }
        entries.push(json!({
            "name": backbone.name(),
            "address": published.address,
            "size_mib": published.size_milli_mib as f64 / 1000.0,
            "sha256_prefix": published.sha256_prefix,
            "licence": published.licence,
            "file": kept.map(|p| p.display().to_string()),
        }));
    }
    let sharp = find_checkpoint();
    if json {
        entries.push(json!({
            "name": "sharp",
            "address": RELEASE_ADDRESS,
            "file": sharp.ok().map(|p| p.display().to_string()),
        }));
        output::json(&entries)?;
    } else {
        output::line(format!(
            "{:<14} {:>13}  {RELEASE_ADDRESS}  {}",
            "sharp",
            "2.8 GB",
            sharp.map_or_else(|_| "not at hand".to_owned(), |p| p.display().to_string())
        ))?;
    }
    Ok(Outcome::Done)
}

/// The backbones that a list of names stands for.
fn backbones(names: &[String]) -> anyhow::Result<Vec<Backbone>> {
    let mut found = Vec::new();
    for name in names {
        match name.as_str() {
            "metrics" => found.extend(Backbone::ALL),
            "sharp" => anyhow::bail!(
                "the SHARP checkpoint has a licence of its own to agree to: download {RELEASE_ADDRESS} yourself and \
                 name the file with --checkpoint"
            ),
            name => found.push(name.parse()?),
        }
    }
    Ok(found)
}

#[cfg(feature = "download")]
fn fetch(names: &[String], offline: bool) -> anyhow::Result<Outcome> {
    let Some(cache) = cache_folder() else {
        anyhow::bail!("no cache folder: set HOME or SHARP_BENCH_WEIGHTS");
    };
    for backbone in backbones(names)? {
        let bar = super::progress::bar(0, "bytes");
        bar.set_message(backbone.name());
        let file =
            sharp_metrics::weights::fetch(&Published::of(backbone), &cache, offline, |at| {
                bar.set_length(at.total);
                bar.set_position(at.done);
            })?;
        bar.finish_and_clear();
        output::line(format!("{:<14} {}", backbone.name(), file.display()))?;
    }
    Ok(Outcome::Done)
}

#[cfg(not(feature = "download"))]
fn fetch(names: &[String], _offline: bool) -> anyhow::Result<Outcome> {
    let addresses: Vec<String> = backbones(names)?
        .into_iter()
        .map(|backbone| {
            let published = Published::of(backbone);
            format!("{} (--weights {}=FILE)", published.address, backbone.name())
        })
        .collect();
    anyhow::bail!(
        "this build cannot download; build with `cargo build --release -p sharp-bench --features download`, or get the \
         files yourself: {}",
        addresses.join(", ")
    )
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
