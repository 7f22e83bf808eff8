//! `doctor`: what this machine has, what lacks, and how to get it.

use clap::Args;
use serde::Serialize;

use sharp_metrics::Backbone;
use sharp_metrics::weights::{Published, cache_folder};

use super::{Outcome, output};
use crate::io::checkpoint::find_checkpoint;
use crate::io::fingerprints;
use crate::io::movie::mp4::ffmpeg_version;

/// Show what this machine has, what lacks, and how to get it
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench doctor --json")]
pub(super) struct DoctorArgs {
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// One finding.
#[derive(Debug, Serialize)]
struct Finding {
    /// What was looked at.
    what: &'static str,
    /// What was found.
    found: String,
    /// How to get what lacks; empty where nothing does.
    advice: String,
}

pub(super) fn execute(args: &DoctorArgs) -> anyhow::Result<Outcome> {
    let findings = findings();
    if args.json {
        output::json(&findings)?;
        return Ok(Outcome::Done);
    }
    for finding in &findings {
        output::line(format!("{:<18} {}", finding.what, finding.found))?;
        if !finding.advice.is_empty() {
            output::line(format!("{:<18} → {}", "", finding.advice))?;
        }
    }
    Ok(Outcome::Done)
}

fn findings() -> Vec<Finding> {
    let mut findings = vec![
        Finding {
            what: "version",
            found: format!(
                "{} (sources {})",
                env!("CARGO_PKG_VERSION"),
                &fingerprints::BUILD[..12]
            ),
            advice: String::new(),
        },
        Finding {
            what: "threads",
            found: rayon::current_num_threads().to_string(),
            advice: String::new(),
        },
        Finding {
            what: "cpu backend",
            found: format!("cpu-{}", sharp_metrics::Simd::detect().instruction_set()),
            advice: String::new(),
        },
        Finding {
            what: "datasets",
            found: "middlebury/Motorcycle-quarter and a procedural scene are built in".to_owned(),
            advice: "use your own with --dataset FORMAT=PATH".to_owned(),
        },
    ];
    findings.extend(gpu_adapters(&adapters()));
    findings.push(match ffmpeg_version() {
        Some(version) => Finding {
            what: "ffmpeg",
            found: version,
            advice: String::new(),
        },
        None => Finding {
            what: "ffmpeg",
            found: "not in PATH".to_owned(),
            advice: "needed only for `render --out x.mp4`; Debian: apt-get install ffmpeg"
                .to_owned(),
        },
    });
    findings.extend(Backbone::ALL.map(backbone));
    findings.push(match find_checkpoint() {
        Ok(path) => Finding {
            what: "SHARP weights",
            found: path.display().to_string(),
            advice: String::new(),
        },
        Err(error) => Finding {
            what: "SHARP weights",
            found: "not at hand".to_owned(),
            advice: error.to_string(),
        },
    });
    findings
}

/// An adapter, as people see it.
struct AdapterFacts {
    /// Name, interface and driver.
    name: String,
    software: bool,
}

#[cfg(feature = "gpu")]
fn adapters() -> Vec<AdapterFacts> {
    sharp::render::GpuAdapter::all()
        .iter()
        .map(|adapter| AdapterFacts {
            // A software adapter's description says so itself.
            name: match adapter.is_software() {
                true => adapter.to_string(),
                false => format!("{adapter} [{}]", adapter.kind()),
            },
            software: adapter.is_software(),
        })
        .collect()
}

/// None that this build could use.
#[cfg(not(feature = "gpu"))]
fn adapters() -> Vec<AdapterFacts> {
    Vec::new()
}

/// Every adapter, and which one `--backend auto` takes.
fn gpu_adapters(adapters: &[AdapterFacts]) -> Vec<Finding> {
    const WHAT: &str = "gpu adapter";
    if adapters.is_empty() {
        return vec![Finding {
            what: WHAT,
            found: "none; `render` uses the CPU".to_owned(),
            advice: "a GPU needs its Vulkan, Metal or Direct3D 12 driver".to_owned(),
        }];
    }
    let chosen = adapters.iter().position(|adapter| !adapter.software);
    adapters
        .iter()
        .enumerate()
        .map(|(index, adapter)| Finding {
            what: WHAT,
            found: adapter.name.clone(),
            advice: match (adapter.software, chosen == Some(index)) {
                (true, _) => "software: used only when named, `render --adapter NAME`",
                (false, true) => "what `render` chooses by itself",
                (false, false) => "used when named, `render --adapter NAME`",
            }
            .to_owned(),
        })
        .collect()
}

/// Whether the weights that LPIPS or DISTS need were fetched.
fn backbone(backbone: Backbone) -> Finding {
    let what = match backbone {
        Backbone::AlexNet => "lpips-alex",
        Backbone::Vgg16 => "lpips-vgg, dists",
        Backbone::SqueezeNet1_1 => "lpips-squeeze",
    };
    let kept = cache_folder().map(|cache| Published::of(backbone).cached(&cache));
    match kept.filter(|path| path.is_file()) {
        Some(path) => Finding {
            what,
            found: path.display().to_string(),
            advice: String::new(),
        },
        None => Finding {
            what,
            found: format!("the weights of {} are not fetched", backbone.name()),
            advice: format!(
                "sharp-bench weights fetch {0}, or --weights {0}=FILE",
                backbone.name()
            ),
        },
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
        assert!(advice[0].contains("chooses by itself"));
        assert!(advice[1].contains("when named") && !advice[1].contains("software"));
        assert!(advice[2].contains("software"));
        let software_only = gpu_adapters(&[adapter("C", true)]);
        assert!(software_only[0].advice.contains("only when named"));
        assert!(gpu_adapters(&[])[0].found.contains("none"));
    }
}
