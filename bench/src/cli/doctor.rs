//! `doctor`: reports which components this machine has, which are missing, and how to get them.

use clap::Args;
use serde::Serialize;

use sharp_metrics::{Backbone, Weights};

use super::{Outcome, output};
use crate::io::checkpoint::find_checkpoint;
use crate::io::fingerprints;
use crate::io::movie::mp4::ffmpeg_version;

/// Show which GPUs, weights and tools this machine has, and how to get those that are missing
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench doctor --json")]
pub(super) struct DoctorArgs {
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Finding {
    what: &'static str,
    found: String,
    /// How to get the missing component; empty if it is present.
    advice: String,
}

fn finding(what: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Finding {
    Finding {
        what,
        found: found.into(),
        advice: advice.into(),
    }
}

pub(super) fn execute(args: &DoctorArgs) -> anyhow::Result<Outcome> {
    let findings = findings();
    let text = || {
        let mut text = String::new();
        for finding in &findings {
            text += &format!("{:<18} {}\n", finding.what, finding.found);
            if !finding.advice.is_empty() {
                text += &format!("{:<18} → {}\n", "", finding.advice);
            }
        }
        text
    };
    output::print(args.json, || &findings, text)?;
    Ok(Outcome::Done)
}

fn findings() -> Vec<Finding> {
    let (version, sources) = (env!("CARGO_PKG_VERSION"), &fingerprints::BUILD[..12]);
    let threads = rayon::current_num_threads().to_string();
    let kernels = sharp_metrics::Simd::detect().instruction_set();
    let mut findings = vec![
        finding("version", format!("{version} (sources {sources})"), ""),
        finding("threads", threads, ""),
        finding("cpu backend", format!("cpu-{kernels}"), ""),
        finding(
            "datasets",
            "four Middlebury scenes and a procedural scene are built in",
            "use your own with --dataset FORMAT=PATH",
        ),
    ];
    findings.extend(gpu_adapters(&adapters()));
    findings.push(match ffmpeg_version() {
        Some(version) => finding("ffmpeg", version, ""),
        None => finding(
            "ffmpeg",
            "not in PATH",
            "needed only for `render --out x.mp4` (Debian: apt-get install ffmpeg)",
        ),
    });
    let weights = Weights::at_hand();
    findings.extend(Backbone::ALL.map(|network| backbone(network, &weights)));
    findings.push(match find_checkpoint() {
        Ok(path) => finding("SHARP weights", path.display().to_string(), ""),
        Err(error) => finding("SHARP weights", "missing", error.to_string()),
    });
    findings
}

struct AdapterFacts {
    name: String,
    software: bool,
}

#[cfg(feature = "gpu")]
fn adapters() -> Vec<AdapterFacts> {
    sharp::render::GpuAdapter::all()
        .iter()
        .map(|adapter| AdapterFacts {
            // The description of a software adapter already says that it is one.
            name: if adapter.is_software() {
                adapter.to_string()
            } else {
                format!("{adapter} [{}]", adapter.kind())
            },
            software: adapter.is_software(),
        })
        .collect()
}

#[cfg(not(feature = "gpu"))]
fn adapters() -> Vec<AdapterFacts> {
    Vec::new()
}

/// One finding per adapter, which states when `render` uses the adapter.
fn gpu_adapters(adapters: &[AdapterFacts]) -> Vec<Finding> {
    const WHAT: &str = "gpu adapter";
    if adapters.is_empty() {
        return vec![finding(
            WHAT,
            "none; `render` uses the CPU",
            "a GPU needs its Vulkan, Metal or Direct3D 12 driver",
        )];
    }
    let chosen = adapters.iter().position(|adapter| !adapter.software);
    let of_adapter = |(index, adapter): (usize, &AdapterFacts)| {
        let advice = match (adapter.software, chosen == Some(index)) {
            (true, _) => "software, used only if named (`render --adapter NAME`)",
            (false, true) => "used by `render` by default",
            (false, false) => "used if named (`render --adapter NAME`)",
        };
        finding(WHAT, &adapter.name, advice)
    };
    adapters.iter().enumerate().map(of_adapter).collect()
}

/// Finds the weights of LPIPS or DISTS.
fn backbone(backbone: Backbone, weights: &Weights) -> Finding {
    let what = match backbone {
        Backbone::AlexNet => "lpips-alex",
        Backbone::Vgg16 => "lpips-vgg, dists",
        Backbone::SqueezeNet1_1 => "lpips-squeeze",
    };
    let name = backbone.name();
    match weights.source(backbone) {
        Some(source) => finding(what, source.to_string(), ""),
        None => finding(
            what,
            format!("the weights of {name} are missing"),
            format!("sharp-bench weights fetch {name}, or --weights {name}=FILE"),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_hardware_is_chosen_and_software_is_called_so() {
        let adapter = |name: &str, software| AdapterFacts {
            name: name.to_owned(),
            software,
        };
        let found = gpu_adapters(&[adapter("A", false), adapter("B", false), adapter("C", true)]);
        let advice: Vec<&str> = found.iter().map(|f| f.advice.as_str()).collect();
        assert!(advice[0].contains("by default"));
        assert!(advice[1].contains("if named") && !advice[1].contains("software"));
        assert!(advice[2].contains("software"));
        let software_only = gpu_adapters(&[adapter("C", true)]);
        assert!(software_only[0].advice.contains("only if named"));
        assert!(gpu_adapters(&[])[0].found.contains("none"));
    }
}
