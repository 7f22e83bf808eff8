//! `parity`: a network against a recording, stage by stage.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use serde_json::json;
use sharp::model::recording::{Recording, compare};

use super::args::{ModelArgs, PhotoArgs};
use crate::cli::{Outcome, output};
use crate::evaluate::record::finite_or_text;

/// Compare a network with a recording, stage by stage, and name the first stage that diverges
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  sharp-bench parity --checkpoint tiny_model.pt --config tiny_config.json#tiny \\
      --image main_640x480.png --focal-px 500 --golden golden_tiny.safetensors

The error of a stage is the largest difference over the stage's largest absolute value. Exit code 1 when a stage is
further off than --tolerance or was not computed (then its error is \"inf\", also in --json).

To trace a change of the full network: `record` before it, `parity` after it. The comparison with the recordings of the
official network at full size is a test: cargo test --release -p sharp-tests --test golden_model -- --ignored
--test-threads=1")]
pub(crate) struct ParityArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// The photograph that was recorded
    #[arg(long, value_name = "IMG")]
    image: PathBuf,
    #[command(flatten)]
    photo: PhotoArgs,
    /// The recording
    #[arg(long, value_name = "REC.safetensors")]
    golden: PathBuf,
    /// Which recording of the file; found by the photograph without it
    #[arg(long, value_name = "P")]
    prefix: Option<String>,
    /// Largest error of a stage that passes
    #[arg(long, value_name = "X", default_value_t = 1e-4)]
    tolerance: f64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn execute(args: &ParityArgs) -> anyhow::Result<Outcome> {
    let recording = Recording::open(&args.golden)?;
    let prefix = match &args.prefix {
        Some(prefix) => prefix.as_str(),
        None => recording.prefix_for(&args.image)?,
    };
    let photo = args.photo.load(&args.image)?;
    let predictor = args.model.load()?;
    let comparison = compare(
        &predictor,
        photo.planes(),
        photo.focal_px,
        &recording,
        prefix,
    )?;
    let first = comparison.first_divergence(args.tolerance);
    if args.json {
        // A number that is not finite has no form in JSON.
        let number = |value: f64| finite_or_text::text(value).map_or(json!(value), |t| json!(t));
        let stages = comparison.stages.iter();
        let stages = stages.map(
            |s| json!({ "stage": s.stage, "rel_error": number(s.rel_error), "values": s.values }),
        );
        output::json(&json!({
            "stages": stages.collect::<Vec<_>>(),
            "first_divergence": first.map(|s| s.stage.as_str()),
        }))?;
    } else {
        for stage in &comparison.stages {
            let mark = match stage.rel_error <= args.tolerance {
                true => ' ',
                false => '!',
            };
            let note = stage.note.as_deref().unwrap_or_default();
            output::line(format!(
                "{mark} {:<36} {:>10.2e}  {:>9} values {note}",
                stage.stage, stage.rel_error, stage.values
            ))?;
        }
    }
    if let Some(stage) = first {
        let note = stage.note.as_ref();
        bail!(
            "{}: diverges first at stage {}: {:.2e} > {:.1e}{}",
            args.golden.display(),
            stage.stage,
            stage.rel_error,
            args.tolerance,
            note.map_or_else(String::new, |note| format!(" ({note})"))
        );
    }
    if !args.json {
        let stages = comparison.stages.len();
        output::line(format!("all {stages} stages within {:.1e}", args.tolerance))?;
    }
    Ok(Outcome::Done)
}
