//! `metrics PREDICTION TARGET`: two pictures, or two folders of them.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde_json::{Map, Value, json};
use sharp_metrics::{MetricKey, Scorer, Selection};

use super::data_args::MetricArgs;
use super::{Outcome, output, progress};
use crate::picture_pairs::{MatchBy, match_folders};
use crate::pictures;
use crate::record::finite_or_text;
use crate::runs::scores::number;

/// Score a prediction against a target: two pictures, or two folders
///
/// Pictures are .png, .jpg, or floats [H,W,3] of sRGB values in 0..1 in .exr, .npy or .safetensors. Sizes must agree;
/// nothing is ever resized. In folders every picture needs its partner.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench metrics prediction.png target.png
  sharp-bench metrics predictions/ targets/ --metrics psnr,ssim --json
  sharp-bench metrics --explain

A metric named itself must be computable, or the command fails; within `all` and `paper` one that is not is listed
as unavailable, with the reason.")]
pub(super) struct MetricsArgs {
    /// The prediction: a picture or a folder
    #[arg(required_unless_present = "explain")]
    prediction: Option<PathBuf>,
    /// The target: a picture or a folder
    #[arg(required_unless_present = "explain")]
    target: Option<PathBuf>,
    #[command(flatten)]
    metrics: MetricArgs,
    /// What two pictures of two folders must share
    #[arg(long = "match", value_enum, default_value_t = MatchBy::Stem)]
    match_by: MatchBy,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Print what each metric key means and which public code computes the same
    #[arg(long)]
    explain: bool,
}

struct Scored {
    prediction: PathBuf,
    target: PathBuf,
    scores: Vec<(MetricKey, Result<f64, String>)>,
}

pub(super) fn execute(args: &MetricsArgs) -> anyhow::Result<Outcome> {
    let selection = args.metrics.selection()?;
    if args.explain {
        return explain(&selection);
    }
    let (Some(prediction), Some(target)) = (&args.prediction, &args.target) else {
        bail!("PREDICTION and TARGET are needed");
    };
    let scorer = args.metrics.scoring()?.scorer;
    let pairs = pairs(prediction, target, args.match_by)?;
    let bar = progress::bar(pairs.len(), "pictures");
    let mut scored = Vec::with_capacity(pairs.len());
    for (prediction, target) in pairs {
        bar.set_message(
            prediction
                .file_name()
                .map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        );
        scored.push(score(&scorer, &selection, prediction, target)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if args.json {
        output::json(&to_json(&scored))?;
    } else {
        print_table(&scored)?;
    }
    Ok(Outcome::Done)
}

fn pairs(prediction: &Path, target: &Path, by: MatchBy) -> anyhow::Result<Vec<(PathBuf, PathBuf)>> {
    match (prediction.is_dir(), target.is_dir()) {
        (true, true) => Ok(match_folders(prediction, target, by)?),
        (false, false) => Ok(vec![(prediction.to_owned(), target.to_owned())]),
        _ => bail!(
            "{} and {}: give two pictures or two folders",
            prediction.display(),
            target.display()
        ),
    }
}

fn score(
    scorer: &Scorer,
    selection: &Selection,
    prediction: PathBuf,
    target: PathBuf,
) -> anyhow::Result<Scored> {
    let scores = scorer
        .score(
            &pictures::read(&prediction)?,
            &pictures::read(&target)?,
            None,
        )
        .with_context(|| format!("{} against {}", prediction.display(), target.display()))?;
    let scores: Vec<_> = scores
        .into_iter()
        .map(|(key, score)| (key, score.map_err(|reason| reason.to_string())))
        .collect();
    for (key, score) in &scores {
        if let Err(reason) = score {
            ensure!(
                !selection.is_explicit(*key),
                "{}: {key} cannot be computed: {reason}",
                prediction.display()
            );
        }
    }
    Ok(Scored {
        prediction,
        target,
        scores,
    })
}

/// Mean over the pairs, `None` unless every pair has the score.
fn mean(scored: &[Scored], at: usize) -> Option<f64> {
    let sum: Option<f64> = scored
        .iter()
        .map(|pair| pair.scores[at].1.as_ref().ok().copied())
        .sum();
    sum.map(|sum| sum / scored.len() as f64)
}

fn keys(scored: &[Scored]) -> Vec<MetricKey> {
    let first = scored.first().map_or(&[][..], |pair| &pair.scores);
    first.iter().map(|(key, _)| *key).collect()
}

fn json_number(value: f64) -> Value {
    finite_or_text::text(value).map_or_else(|| json!(value), |text| json!(text))
}

fn to_json(scored: &[Scored]) -> Value {
    let pairs: Vec<Value> = scored
        .iter()
        .map(|pair| {
            let (mut scores, mut unavailable) = (Map::new(), Map::new());
            for (key, score) in &pair.scores {
                match score {
                    Ok(value) => scores.insert(key.to_string(), json_number(*value)),
                    Err(reason) => unavailable.insert(key.to_string(), json!(reason)),
                };
            }
            json!({
                "prediction": pair.prediction.display().to_string(),
                "target": pair.target.display().to_string(),
                "scores": scores,
                "unavailable": unavailable,
            })
        })
        .collect();
    let means: Map<String, Value> = keys(scored)
        .iter()
        .enumerate()
        .filter_map(|(at, key)| Some((key.to_string(), json_number(mean(scored, at)?))))
        .collect();
    json!({ "pairs": pairs, "mean": means })
}

fn print_table(scored: &[Scored]) -> anyhow::Result<()> {
    if let [pair] = scored {
        for (key, score) in &pair.scores {
            let text = match score {
                Ok(value) => number(*value),
                Err(reason) => format!("unavailable: {reason}"),
            };
            output::line(format!("{:<36} {text}", key.to_string()))?;
        }
        return Ok(());
    }
    let keys = keys(scored);
    for pair in scored {
        output::line(pair.prediction.display().to_string())?;
        for (key, score) in &pair.scores {
            if let Ok(value) = score {
                output::line(format!("  {:<34} {}", key.to_string(), number(*value)))?;
            }
        }
    }
    output::line(format!("mean of {} pairs", scored.len()))?;
    for (at, key) in keys.iter().enumerate() {
        let text = match mean(scored, at) {
            Some(value) => number(value),
            None => {
                let reason = scored
                    .iter()
                    .find_map(|pair| pair.scores[at].1.as_ref().err());
                format!("unavailable: {}", reason.map_or("", String::as_str))
            }
        };
        output::line(format!("  {:<34} {text}", key.to_string()))?;
    }
    Ok(())
}

fn explain(selection: &Selection) -> anyhow::Result<Outcome> {
    for key in selection.keys() {
        output::line(format!("{key}  (--metrics {})", key.alias()))?;
        output::line(format!("    {}\n", key.explain()))?;
    }
    Ok(Outcome::Done)
}
