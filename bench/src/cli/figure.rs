//! `figure NAME RUN…`: figures of a paper.

use std::path::PathBuf;

use anyhow::anyhow;
use clap::{Args, Subcommand};
use serde_json::json;
use sharp_metrics::MetricKey;

use super::outcome::UsageError;
use super::output::Terminal;
use super::report::{ShownRuns, warn_damaged};
use super::sweep::{check_methods, style, sweep};
use super::{Outcome, output};
use crate::evaluate::Results;
use crate::io::atomic_files::{check_writable, write_all_over_own};
use crate::io::pictures::read_rgb8;
use crate::io::text::visible_line;
use crate::report::figures::catalogue::FIGURES;
use crate::report::figures::choice::{PairsChoice, PathChoice};
use crate::report::figures::fidelity_time::SpeedSeconds;
use crate::report::figures::from_runs::{self, SheetKind, SheetOptions};
use crate::report::figures::sheet::Sheet;
use crate::report::figures::uncertainty::{self, Mirrored};
use crate::report::sweep::SweepSpec;
use crate::report::{ReportError, plots as report_plots, scenes};
use sharp_plots::Figure;
use sharp_plots::style::FigureStyle;

/// Maximum number of problems printed for a sheet of pictures; `--json` prints all.
const PROBLEMS: usize = 10;

/// Make a figure of the paper from runs, in print quality
///
/// Plots and sheets of pictures become SVG, PNG and PDF. --style FILE.toml sets width_mm (default 84, one column of a
/// two-column paper; 174 is the whole page), font_pt (default 8), dpi (300), panel_aspect (0.62), caption (true) and
/// colours.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench figure list
  sharp-bench figure motion runs/first --out figures
  sharp-bench figure qualitative runs/first --choose worst --crop 100,80,64,48 --out figures
  sharp-bench figure ablation full=runs/v1 small=runs/v2 --pair ID \\
      --crop 100,80,64,48 --out figures")]
pub(super) struct FigureArgs {
    #[command(subcommand)]
    figure: FigureCommand,
}

#[derive(Debug, Subcommand)]
enum FigureCommand {
    /// List the figures with their contents and requirements
    List {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Histograms of the camera baselines, one panel per dataset
    Baselines(RunsArgs),
    /// DISTS against the camera baseline, for methods that do not use the source's true depth
    Motion(RunsArgs),
    /// DISTS against the camera baseline, for methods that use the source's true depth or the scale of that depth
    MotionPrivileged(RunsArgs),
    /// A metric against seconds per pair, on a logarithmic axis
    FidelityTime {
        #[command(flatten)]
        runs: RunsArgs,
        /// The metric to plot; the runs must have it
        #[arg(long, default_value_t = MetricKey::DISTS)]
        metric: MetricKey,
        /// An output folder of `speed`, or its speed.csv. These times replace the times recorded in the run, for the
        /// methods and datasets that `speed` measured
        #[arg(long, value_name = "PATH")]
        speed: Option<PathBuf>,
    },
    /// Input, predictions and truth side by side, one row per pair
    Qualitative {
        #[command(flatten)]
        pictures: PicturesArgs,
        #[command(flatten)]
        pairs: PairsChoice,
    },
    /// A grid of pictures: methods or labelled runs as rows, pairs as columns
    Ablation {
        #[command(flatten)]
        pictures: PicturesArgs,
        #[command(flatten)]
        pairs: PairsChoice,
    },
    /// A grid of pictures: methods as rows, targets of one source view at growing baselines as columns
    ExtendedMotion {
        #[command(flatten)]
        pictures: PicturesArgs,
        #[command(flatten)]
        path: PathChoice,
    },
    /// Input, predicted view and inverse depth of one method
    Failure {
        #[command(flatten)]
        pictures: PicturesArgs,
        #[command(flatten)]
        pairs: PairsChoice,
        /// Folder of z-depth in the target's camera, DIR/PAIR_ID.npy, .npz, .exr, .pfm or .png [default: the depth of
        /// the kept rendering (run --keep float), else the dataset's depth]
        #[arg(long, value_name = "DIR")]
        depth: Option<PathBuf>,
    },
    /// Depth of a picture, depth of its mirror image (mirrored back), and their difference
    Uncertainty(UncertaintyArgs),
}

#[derive(Debug, Args)]
struct OutArgs {
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A TOML file with sizes and colours
    #[arg(long, value_name = "FILE")]
    style: Option<PathBuf>,
    /// Print the list of written files, and problems with them, as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct RunsArgs {
    #[command(flatten)]
    runs: ShownRuns,
    #[command(flatten)]
    out: OutArgs,
}

#[derive(Debug, Args)]
struct PicturesArgs {
    #[command(flatten)]
    runs: RunsArgs,
    #[command(flatten)]
    shown: SheetOptions,
}

#[derive(Debug, Args)]
struct UncertaintyArgs {
    /// The picture
    #[arg(long, value_name = "FILE")]
    picture: PathBuf,
    /// Depth of the picture: .npy, .npz, .exr, .pfm (metres) or 16-bit .png (millimetres)
    #[arg(long, value_name = "FILE", requires = "mirrored")]
    depth: Option<PathBuf>,
    /// The depth predicted for the mirrored picture, not mirrored back
    #[arg(long, value_name = "FILE", requires = "depth")]
    mirrored: Option<PathBuf>,
    /// A checkpoint of SHARP or Depth Pro, or mini (the bundled small network), to predict both depths with; for SHARP,
    /// the figure has a row for each of the two layers
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with = "depth",
        required_unless_present = "depth"
    )]
    checkpoint: Option<PathBuf>,
    /// Architecture of the checkpoint, FILE.json#NAME [default: a fitting .json next to the checkpoint, or the
    /// release's]
    #[arg(long, value_name = "CONFIG", requires = "checkpoint")]
    config: Option<String>,
    #[command(flatten)]
    out: OutArgs,
}

pub(super) fn execute(args: &FigureArgs) -> anyhow::Result<Outcome> {
    match &args.figure {
        FigureCommand::List { json } => {
            output::print(*json, || FIGURES.as_slice(), list)?;
            Ok(Outcome::Done)
        }
        FigureCommand::Baselines(args) => plots(args, "baselines", from_runs::baselines),
        FigureCommand::Motion(args) => motion(args, false),
        FigureCommand::MotionPrivileged(args) => motion(args, true),
        FigureCommand::FidelityTime {
            runs,
            metric,
            speed,
        } => {
            let speed = speed.as_deref().map(SpeedSeconds::read).transpose()?;
            plots(runs, "fidelity-time", |results, style| {
                from_runs::fidelity_time(results, *metric, &speed.unwrap_or_default(), style)
            })
        }
        FigureCommand::Qualitative { pictures, pairs } => {
            let kind = SheetKind::Qualitative(pairs.clone());
            sheet(pictures, "qualitative", kind)
        }
        FigureCommand::Ablation { pictures, pairs } => {
            sheet(pictures, "ablation", SheetKind::Ablation(pairs.clone()))
        }
        FigureCommand::ExtendedMotion { pictures, path } => {
            let kind = SheetKind::ExtendedMotion(path.clone());
            sheet(pictures, "extended-motion", kind)
        }
        FigureCommand::Failure {
            pictures,
            pairs,
            depth,
        } => {
            let kind = SheetKind::Failure(pairs.clone(), depth.clone());
            sheet(pictures, "failure", kind)
        }
        FigureCommand::Uncertainty(args) => of_depth(args),
    }
}

fn list() -> String {
    let figures = FIGURES.iter().map(|figure| {
        format!(
            "{}\n  shows  {}\n  paper  {}\n  needs  {}\n  by     sharp-bench {}\n",
            figure.name, figure.shows, figure.paper, figure.needs, figure.command
        )
    });
    figures.collect()
}

/// Makes the paper's figure of motion ranges.
fn motion(args: &RunsArgs, privileged: bool) -> anyhow::Result<Outcome> {
    let spec = SweepSpec {
        metrics: vec![MetricKey::DISTS],
        privileged: Some(privileged),
        ..SweepSpec::default()
    };
    let style = style(args.out.style.as_ref())?;
    let stem = if privileged {
        "motion-privileged"
    } else {
        "motion"
    };
    sweep(
        &args.runs,
        spec,
        (&args.out.out, stem),
        &style,
        args.out.json,
    )
}

fn plots(
    args: &RunsArgs,
    stem: &str,
    make: impl FnOnce(&Results, &FigureStyle) -> Result<Option<Figure>, ReportError>,
) -> anyhow::Result<Outcome> {
    let style = style(args.out.style.as_ref())?;
    let results = args.runs.results(None)?;
    check_methods(&style, &results)?;
    check_writable(&args.out.out)?;
    let figure = make(&results, &style)?;
    let figure = figure.ok_or_else(|| anyhow!("{stem}: the runs have no value to plot"))?;
    let files = report_plots::files(figure, &args.out.out, stem);
    print(&write_all_over_own(&files)?, &[], &args.out)?;
    Ok(Outcome::of_problems(warn_damaged(&results)))
}

fn sheet(args: &PicturesArgs, stem: &str, kind: SheetKind) -> anyhow::Result<Outcome> {
    let out = &args.runs.out;
    let style = style(out.style.as_ref())?;
    let results = args.runs.runs.results(None)?;
    check_writable(&out.out)?;
    let scenes = scenes(&results.manifest, &Terminal::default());
    let sheet = kind.sheet(&args.shown, &results, &scenes)?;
    let problems = write_sheet(&sheet, stem, out, &style)?;
    let damaged = warn_damaged(&results);
    Ok(Outcome::of_problems(damaged || problems))
}

fn of_depth(args: &UncertaintyArgs) -> anyhow::Result<Outcome> {
    let style = style(args.out.style.as_ref())?;
    let picture = read_rgb8(&args.picture)?;
    check_writable(&args.out.out)?;
    let maps = match (&args.depth, &args.mirrored, &args.checkpoint) {
        (Some(depth), Some(mirrored), _) => vec![Mirrored::read(depth, mirrored)?],
        (.., Some(checkpoint)) => {
            uncertainty::by_network(&picture, checkpoint, args.config.as_deref())?
        }
        _ => {
            return Err(
                UsageError("give --depth and --mirrored, or --checkpoint".to_owned()).into(),
            );
        }
    };
    let sheet = uncertainty::sheet(&picture, &maps)?;
    write_sheet(&sheet, "uncertainty", &args.out, &style).map(Outcome::of_problems)
}

/// Writes a sheet and prints the problems found in it; true if there are any.
fn write_sheet(
    sheet: &Sheet,
    stem: &str,
    out: &OutArgs,
    style: &FigureStyle,
) -> anyhow::Result<bool> {
    let problems = sheet.problems();
    print(&sheet.write(&out.out, stem, style)?, &problems, out)?;
    for problem in problems.iter().take(PROBLEMS) {
        output::remark(format!("warning: {}", visible_line(problem)));
    }
    if let more @ 1.. = problems.len().saturating_sub(PROBLEMS) {
        output::remark(format!("warning: {more} more not shown"));
    }
    Ok(!problems.is_empty())
}

fn print(files: &[PathBuf], problems: &[String], args: &OutArgs) -> anyhow::Result<()> {
    let out = args.out.display().to_string();
    let value = || json!({"out": out, "files": output::names(files), "problems": problems});
    output::print(args.json, value, || output::wrote(files))
}
