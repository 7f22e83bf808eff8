//! `compare A B`: changes between two runs and their significance.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use clap::Args;
use sharp_metrics::Family;

use super::outcome::UsageError;
use super::output::Terminal;
use super::{Outcome, output};
use crate::config::metrics::weights;
use crate::evaluate::Shown;
use crate::report::scenes;
use crate::track::compare::breakdown::{Division, Stratum};
use crate::track::compare::flips::Flips;
use crate::track::compare::{CompareError, Practical, RunComparison, both_sides, compare_results};

/// Compare two runs pair by pair: means, intervals, significance
///
/// Differences are B − A over the same pairs. Pairs of one physical scene are correlated, so significance is computed
/// over scenes. The verdict on B is `better` or `worse` if p < 0.05 after Holm's correction over the datasets of a
/// metric. Otherwise, the verdict is `none` if all scores are equal or every difference in the confidence interval is
/// too small to matter (--practical), and `inconclusive` if not.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench compare runs/v1 runs/v2
  sharp-bench compare runs/v1 runs/v2 --method sharp=sharp-new --json
  sharp-bench compare runs/all --method depth-splat=sharp
  sharp-bench compare runs/v1 runs/v2 --anatomy --out v1-v2")]
pub(super) struct CompareArgs {
    /// Run folder A, the earlier run
    #[arg(value_name = "A")]
    a: PathBuf,
    /// Run folder B, the later run [default: A itself]
    #[arg(value_name = "B")]
    b: Option<PathBuf>,
    /// Compare method OLD of A with method NEW of B [default: methods with the same label, or each run's only method]
    #[arg(long = "method", value_name = "OLD=NEW", value_parser = method_pair)]
    compared: Vec<(String, String)>,
    #[command(flatten)]
    shown: Shown,
    /// Largest negligible difference per metric [default: psnr=0.05,ssim=0.001,lpips=0.001,dists=0.001]
    #[arg(long, value_name = "METRIC=VALUE", value_delimiter = ',', value_parser = threshold)]
    practical: Vec<(Family, f64)>,
    /// Also show means by scene, baseline, rotation, overlap and relative motion
    #[arg(long)]
    breakdown: bool,
    /// Also list the pairs on which two of the compared methods swap ranks: one scores better in A, the other in B
    #[arg(long)]
    flips: bool,
    /// Also show the error by kind of pixel: visible in the source, hidden, outside the source's picture, or near a
    /// depth edge. Needs datasets with depth, and the kept pictures of both runs
    #[arg(long)]
    anatomy: bool,
    /// Weights file of a network that LPIPS uses, for --anatomy: NAME=FILE. Needed if the runs used weights other than
    /// those found on this machine; repeatable
    #[arg(long, value_name = "NAME=FILE", requires = "anatomy")]
    weights: Vec<String>,
    /// Write Markdown, CSV and a page with pictures of the most changed pairs into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn method_pair(text: &str) -> Result<(String, String), &'static str> {
    let (old, new) = text.split_once('=').ok_or("expected OLD=NEW")?;
    Ok((old.to_owned(), new.to_owned()))
}

fn threshold(text: &str) -> Result<(Family, f64), &'static str> {
    let (name, value) = text.split_once('=').ok_or("expected METRIC=VALUE")?;
    let family = Family::ALL.into_iter().find(|family| family.name() == name);
    let family = family.ok_or("expected psnr, ssim, lpips or dists")?;
    let value = value.parse().ok();
    let value = value.filter(|v: &f64| v.is_finite() && *v >= 0.0);
    Ok((family, value.ok_or("expected a number of 0 or more")?))
}

pub(super) fn execute(args: &CompareArgs) -> anyhow::Result<Outcome> {
    let b = match (&args.b, args.compared.as_slice()) {
        (Some(b), _) => b,
        (None, []) => {
            let reason = "give a second run, or compare two methods of one run with --method \
                          OLD=NEW";
            return Err(UsageError(reason.to_owned()).into());
        }
        (None, _) => &args.a,
    };
    let mut practical = Practical::default();
    for (family, value) in &args.practical {
        practical.set(*family, *value);
    }
    let both = args.shown.of(both_sides(&args.a, b)?);
    let [of_a, of_b] = both.map_err(|error| UsageError(error.to_string()))?;
    let sides = [(args.a.as_path(), of_a), (b, of_b)];
    let shown = |label: &String| args.shown.name(label).to_owned();
    let compared = args.compared.iter().map(|(a, b)| (shown(a), shown(b)));
    let compared: Vec<(String, String)> = compared.collect();
    let comparison =
        compare_results(sides, &compared, &practical).map_err(|error| match error {
            CompareError::Methods(reason) => anyhow::Error::from(UsageError(reason)),
            other => other.into(),
        })?;
    if args.flips && comparison.against.len() < 2 {
        let reason = "--flips needs two methods in both runs, or two --method OLD=NEW";
        return Err(UsageError(reason.to_owned()).into());
    }
    if args.anatomy && !comparison.has_pictures() {
        let reason = "--anatomy needs pictures that both runs kept (`run --keep all`)";
        return Err(UsageError(reason.to_owned()).into());
    }
    let terminal = Terminal::default();
    let opened = if args.anatomy || args.out.is_some() {
        scenes(&comparison.results.manifest, &terminal)
    } else {
        Vec::new()
    };
    let mut anatomies = Vec::new();
    if args.anatomy {
        let weights = weights(&args.weights)?;
        for against in &comparison.against {
            anatomies.push(comparison.anatomy(against, &opened, &weights, &terminal)?);
        }
    }
    let strata = comparison.strata(&anatomies);
    let flips = if args.flips {
        comparison.flips()
    } else {
        Vec::new()
    };
    let files = match &args.out {
        Some(out) => Some(comparison.write(&strata, &flips, &opened, out)?),
        None => None,
    };
    let page = files.as_ref().map(|files| files.html.as_path());
    let shown = ShownComparison {
        comparison: &comparison,
        strata: &strata,
        flips: &flips,
        breakdown: args.breakdown,
        page,
    };
    output::print(
        args.json,
        || comparison.json(&strata, &flips),
        || shown.to_string(),
    )?;
    let notes = anatomies.iter().flat_map(|anatomy| &anatomy.notes);
    for note in comparison.notes.iter().chain(notes) {
        output::remark(format!("note: {note}"));
    }
    let not_scored = files.map(|files| files.not_scored).unwrap_or_default();
    super::report::warn_not_scored(&not_scored);
    let damaged = super::report::warn_damaged(&comparison.results);
    Ok(Outcome::of_problems(damaged || !not_scored.is_empty()))
}

struct ShownComparison<'a> {
    comparison: &'a RunComparison,
    strata: &'a [Stratum],
    flips: &'a [Flips<'a>],
    /// Whether the text also shows means by stratum (scene, baseline, rotation, overlap, relative motion).
    breakdown: bool,
    page: Option<&'a Path>,
}

impl Display for ShownComparison<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let comparison = self.comparison;
        let mut grids = comparison.change_grids();
        for against in &comparison.against {
            let metrics = comparison.results.manifest.metrics.iter();
            grids.extend(metrics.filter_map(|m| comparison.extremes(against, &m.info)));
        }
        grids.extend(self.flips.iter().map(Flips::grid));
        let shown = self.strata.iter().filter(|stratum| match stratum.by {
            Division::Pixels => true,
            _ => self.breakdown,
        });
        grids.extend(comparison.where_grids(&shown.cloned().collect::<Vec<_>>()));
        for grid in grids {
            writeln!(f, "{}", grid.text())?;
        }
        self.page
            .map_or(Ok(()), |page| write!(f, "page  {}", page.display()))
    }
}
