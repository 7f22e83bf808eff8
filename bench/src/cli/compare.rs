//! `compare A B`: what changed between two runs, and whether chance could have done it.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use serde_json::json;
use sharp_metrics::Family;
use sharp_metrics::identity::MetricRegion;
use sharp_statistics::NoInference;

use super::outcome::UsageError;
use super::{Outcome, output};
use crate::io::counts::counted;
use crate::report::tables::shown;
use crate::track::compare::{
    CompareError, Practical, RunComparison, ScoreChange, compare, verdict_word,
};

/// Compare two runs pair by pair: means, intervals, significance
///
/// Differences are B − A over the same pairs. Pairs of one physical scene depend on each other, so that what decides is how
/// scenes vary, not pairs. B is better or worse where chance alone is an unlikely reason, p < 0.05 after Holm's correction
/// over the datasets of a metric; there is no difference (none) where all that is likely is too small to matter
/// (--practical) or the sides are equal; otherwise the runs cannot tell (inconclusive).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench compare runs/v1 runs/v2
  sharp-bench compare runs/v1 runs/v2 --method sharp=sharp-new --json
  sharp-bench compare runs/all --method depth-splat=sharp")]
pub(super) struct CompareArgs {
    /// Run folder A: what was before
    #[arg(value_name = "A")]
    a: PathBuf,
    /// Run folder B: what is now; A itself if left out
    #[arg(value_name = "B")]
    b: Option<PathBuf>,
    /// A method of A against one of B; without it, those of equal label, or the only ones
    #[arg(long = "method", value_name = "OLD=NEW")]
    methods: Vec<Against>,
    /// Up to where a difference matters to nobody, by metric; psnr=0.05,ssim=0.001,lpips=0.001,dists=0.001 if not given
    #[arg(long, value_name = "METRIC=VALUE", value_delimiter = ',')]
    practical: Vec<Threshold>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone)]
pub(super) struct Against(pub(super) String, pub(super) String);

impl FromStr for Against {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (old, new) = text.split_once('=').ok_or("it has the form OLD=NEW")?;
        Ok(Self(old.to_owned(), new.to_owned()))
    }
}

#[derive(Debug, Clone)]
struct Threshold(Family, f64);

impl FromStr for Threshold {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = text.split_once('=').ok_or("it has the form METRIC=VALUE")?;
        let family = Family::ALL.into_iter().find(|family| family.name() == name);
        let family = family.ok_or("metrics are psnr, ssim, lpips, dists")?;
        let value = value
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite() && *v >= 0.0);
        Ok(Self(
            family,
            value.ok_or("the value is a number, 0 or more")?,
        ))
    }
}

pub(super) fn execute(args: &CompareArgs) -> anyhow::Result<Outcome> {
    let b = match (&args.b, args.methods.as_slice()) {
        (Some(b), _) => b,
        (None, []) => {
            let reason = "a run is compared with another, or with itself by --method OLD=NEW";
            return Err(UsageError(reason.to_owned()).into());
        }
        (None, _) => &args.a,
    };
    let mut practical = Practical::default();
    for Threshold(family, value) in &args.practical {
        practical.set(*family, *value);
    }
    let methods: Vec<_> = args
        .methods
        .iter()
        .map(|Against(old, new)| (old.clone(), new.clone()))
        .collect();
    let comparison = compare(&args.a, b, &methods, &practical).map_err(|error| match error {
        CompareError::Methods(reason) => anyhow::Error::from(UsageError(reason)),
        other => other.into(),
    })?;
    if args.json {
        output::json(&json!({
            "schema": 1,
            "a": args.a.display().to_string(),
            "b": b.display().to_string(),
            "seed": comparison.resampling.seed,
            "resamples": comparison.resampling.count,
            "rows": comparison.rows,
        }))?;
    } else {
        print(&comparison)?;
    }
    for note in &comparison.notes {
        output::remark(format!("note: {note}"));
    }
    Ok(Outcome::Done)
}

const HEADS: [&str; 11] = [
    "dataset",
    "pairs",
    "scenes",
    "A",
    "B",
    "B - A",
    "95 %",
    "p",
    "p Holm",
    "detectable",
    "B is",
];

fn print(comparison: &RunComparison) -> anyhow::Result<()> {
    let groups = comparison.rows.chunk_by(|one, other| {
        let key = |row: &ScoreChange| {
            (
                row.method_a.clone(),
                row.method_b.clone(),
                row.metric.clone(),
                row.region,
            )
        };
        key(one) == key(other)
    });
    for rows in groups {
        let first = &rows[0];
        let region = match first.region {
            MetricRegion::Whole => "",
            region => region.suffix(),
        };
        let (metric, old, new) = (&first.metric, &first.method_a, &first.method_b);
        output::line(format!("{metric}{region}: {old} (A), {new} (B)"))?;
        let mut lines = vec![HEADS.map(str::to_owned)];
        lines.extend(rows.iter().map(cells));
        grid(&lines, &[0, 10])?;
        for remark in rows.iter().flat_map(remarks) {
            output::line(format!("  {remark}"))?;
        }
        output::line("")?;
    }
    Ok(())
}

/// Lines of cells under each other, those of some columns to the left and the others to the right.
pub(super) fn grid<const N: usize>(lines: &[[String; N]], left: &[usize]) -> anyhow::Result<()> {
    let length = |column: usize| lines.iter().map(|line| line[column].chars().count()).max();
    let widths: Vec<usize> = (0..N).filter_map(length).collect();
    for line in lines {
        let cells = line.iter().zip(&widths).enumerate();
        let cells = cells.map(|(column, (cell, width))| match left.contains(&column) {
            true => format!("{cell:<width$}"),
            false => format!("{cell:>width$}"),
        });
        output::line(format!(
            "  {}",
            cells.collect::<Vec<_>>().join("  ").trim_end()
        ))?;
    }
    Ok(())
}

fn cells(row: &ScoreChange) -> [String; 11] {
    // One decimal more than single scores: means of many are compared.
    let decimals = row.decimals + 1;
    let number = |value: f64| shown(value, decimals);
    let optional = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), number);
    let p = |value: Option<f64>| match value {
        None => "-".to_owned(),
        Some(p) if p < 0.0001 => "<0.0001".to_owned(),
        Some(p) => format!("{p:.4}"),
    };
    let interval = match (row.ci_low, row.ci_high) {
        (None, None) => "-".to_owned(),
        (low, high) => format!("{} .. {}", optional(low), optional(high)),
    };
    [
        row.dataset.clone(),
        row.n_pairs.to_string(),
        row.n_scenes.to_string(),
        number(row.mean_a),
        number(row.mean_b),
        number(row.difference),
        interval,
        p(row.p),
        p(row.p_holm),
        optional(row.mde),
        verdict_word(row.verdict).to_owned(),
    ]
}

/// What a row of numbers does not say.
fn remarks(row: &ScoreChange) -> Vec<String> {
    let mut remarks = Vec::new();
    let dataset = &row.dataset;
    match row.basis {
        Ok(Some((p, floor))) if row.n_scenes > 1 => remarks.push(format!(
            "{dataset}: by the signs of {} scenes alone p = {p:.4}, at least {floor:.4} with so many",
            row.n_scenes
        )),
        Ok(_) => {}
        Err(NoInference::OneCluster) => remarks.push(format!(
            "{dataset}: no interval and no p, because one scene does not show how scenes vary"
        )),
        Err(reason) => remarks.push(format!("{dataset}: no interval and no p, because {reason}")),
    }
    if row.left_out > 0 {
        let pairs = counted(row.left_out, "pair");
        remarks.push(format!(
            "{dataset}: {pairs} without a score on both sides left out"
        ));
    }
    if row.n_infinite > 0 {
        let pairs = counted(row.n_infinite, "pair");
        remarks.push(format!("{dataset}: {pairs} with an infinite score"));
    }
    remarks
}
