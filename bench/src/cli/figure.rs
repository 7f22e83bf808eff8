//! `figure NAME RUN…`: figures of a paper.

use std::path::PathBuf;

use anyhow::{Context, anyhow};
use clap::{Args, Subcommand};
use serde_json::json;
use sharp_metrics::MetricKey;

use super::outcome::UsageError;
use super::output::Terminal;
use super::report::{warn_damaged, warn_not_scored};
use super::sweep::{style, sweep};
use super::{Outcome, output};
use crate::evaluate::{Named, Results, join};
use crate::io::atomic_files::{check_writable, write_over_own};
use crate::io::pictures::read_rgb8;
use crate::pairs::depth::given::read_metres;
use crate::report::assemble::{self, RunPictures};
use crate::report::board::Board;
use crate::report::figures::catalogue::FIGURES;
use crate::report::figures::choice::{Choice, ChosenPair, along_path, chosen};
use crate::report::figures::qualitative::{SheetContent, png};
use crate::report::figures::sheet::{Sheet, SheetMedium};
use crate::report::figures::uncertainty::Mirrored;
use crate::report::figures::{failure, fidelity_time, uncertainty};
use crate::report::input::Column;
use crate::report::plots::canvas::MARK;
use crate::report::plots::style::FigureStyle;
use crate::report::plots::{Figure, baselines};
use crate::report::sweep::SweepSpec;
use crate::report::{NoPictures, PublishedNumbers, ReportError};
use crate::scoring::Region;

/// Make a figure of the paper from runs, in print quality
///
/// Plots become SVG, PNG and PDF, sheets of pictures PNG. --style FILE.toml sets width_mm (84, a column of a two-column
/// paper; 174 is the whole page), font_pt (8), dpi (300), panel_aspect (0.62), caption (true) and colours.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench figure list
  sharp-bench figure motion runs/first --out figures
  sharp-bench figure qualitative runs/first --choose worst --crop 100,80,64,48 --out figures
  sharp-bench figure ablation full=runs/v1 small=runs/v2 --pair ID --crop 100,80,64,48 --out figures")]
pub(super) struct FigureArgs {
    #[command(subcommand)]
    figure: FigureCommand,
}

#[derive(Debug, Subcommand)]
enum FigureCommand {
    /// What each figure shows and needs
    List {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Histograms of the camera baselines, a panel a dataset
    Baselines(RunsArgs),
    /// DISTS against the camera baseline, of methods without the source's true depth
    Motion(RunsArgs),
    /// The same of methods that know the source's true depth or its scale
    MotionPrivileged(RunsArgs),
    /// A metric against seconds a pair, on a logarithmic axis
    FidelityTime {
        #[command(flatten)]
        runs: RunsArgs,
        /// Which metric of the runs
        #[arg(long, default_value_t = MetricKey::DISTS)]
        metric: MetricKey,
    },
    /// Input, predictions and truth side by side, a row a pair
    Qualitative {
        #[command(flatten)]
        pictures: PicturesArgs,
        #[command(flatten)]
        pairs: PairsChoice,
    },
    /// The same pairs as columns, methods or labelled runs as rows
    Ablation {
        #[command(flatten)]
        pictures: PicturesArgs,
        #[command(flatten)]
        pairs: PairsChoice,
    },
    /// A source's targets at growing baselines as columns, methods as rows
    ExtendedMotion {
        #[command(flatten)]
        pictures: PicturesArgs,
        /// The source, as its pairs' ids begin: DATASET/SCENE/VIEW; without it the one with the most targets
        #[arg(long, value_name = "ID")]
        source: Option<String>,
        /// Targets at most, spread over the baselines
        #[arg(long, default_value_t = 5)]
        count: usize,
    },
    /// Input, view and inverse depth
    Failure {
        #[command(flatten)]
        pictures: PicturesArgs,
        #[command(flatten)]
        pairs: PairsChoice,
        /// z-depth in the target's camera, DIR/PAIR_ID.npy, .npz, .exr, .pfm or .png; without it the dataset's
        #[arg(long, value_name = "DIR")]
        depth: Option<PathBuf>,
    },
    /// Depth against that of the mirrored picture, mirrored back
    Uncertainty(UncertaintyArgs),
}

#[derive(Debug, Args)]
struct OutArgs {
    /// Where to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Sizes and colours, a TOML file
    #[arg(long, value_name = "FILE")]
    style: Option<PathBuf>,
    /// Print JSON: the files written
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct RunsArgs {
    /// Run folders or bundles
    #[arg(required = true, value_name = "[NAME=]RUN")]
    runs: Vec<Named>,
    #[command(flatten)]
    out: OutArgs,
}

#[derive(Debug, Args)]
struct PicturesArgs {
    #[command(flatten)]
    runs: RunsArgs,
    /// Methods to show, in this order; all that are ranked without it
    #[arg(long = "method", value_name = "METHOD")]
    methods: Vec<String>,
    /// Metrics whose scores stand below predictions, comma-separated; the first one decides what is worst; all without it
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    metrics: Vec<MetricKey>,
    /// A part that is framed and enlarged, pixels of the target; repeatable
    #[arg(long = "crop", value_name = "X,Y,W,H", value_parser = region)]
    crops: Vec<Region>,
}

#[derive(Debug, Args)]
struct PairsChoice {
    /// A pair by its id in pairs.csv; repeatable
    #[arg(long = "pair", value_name = "ID")]
    ids: Vec<String>,
    /// Which pairs of each dataset, without --pair
    #[arg(long, value_enum, default_value_t)]
    choose: Choice,
    /// How many of each dataset
    #[arg(long, default_value_t = 1)]
    count: usize,
}

#[derive(Debug, Args)]
struct UncertaintyArgs {
    /// The picture
    #[arg(long, value_name = "FILE")]
    picture: PathBuf,
    /// Its depth: .npy, .npz, .exr, .pfm (metres) or 16-bit .png (millimetres)
    #[arg(long, value_name = "FILE", requires = "mirrored")]
    depth: Option<PathBuf>,
    /// The depth of the mirrored picture, as it was predicted
    #[arg(long, value_name = "FILE", requires = "depth")]
    mirrored: Option<PathBuf>,
    /// A SHARP checkpoint that predicts both, each of its two layers a row
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with = "depth",
        required_unless_present = "depth"
    )]
    checkpoint: Option<PathBuf>,
    /// Its architecture, FILE.json#NAME, where it is not the release's
    #[arg(long, value_name = "CONFIG", requires = "checkpoint")]
    config: Option<String>,
    #[command(flatten)]
    out: OutArgs,
}

fn region(text: &str) -> Result<Region, &'static str> {
    let numbers: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Region {
            x,
            y,
            width,
            height,
        }),
        _ => Err("four whole numbers, X,Y,WIDTH,HEIGHT"),
    }
}

pub(super) fn execute(args: &FigureArgs) -> anyhow::Result<Outcome> {
    match &args.figure {
        FigureCommand::List { json } => list(*json),
        FigureCommand::Baselines(args) => plots(args, "baselines", |results, style| {
            let input = assemble::input(results, &NoPictures, PublishedNumbers::Never);
            let board = Board::new(input.records, &input.datasets, &input.methods)?;
            Ok(baselines::histogram(&board, Some(style))?)
        }),
        FigureCommand::Motion(args) => motion(args, false),
        FigureCommand::MotionPrivileged(args) => motion(args, true),
        FigureCommand::FidelityTime { runs, metric } => {
            plots(runs, "fidelity-time", |results, style| {
                let input = assemble::input(results, &NoPictures, PublishedNumbers::Never);
                let board = Board::new(input.records, &input.datasets, &input.methods)?;
                let metric = Column::chosen(&input.metrics, &[*metric])?.remove(0);
                let seconds = fidelity_time::seconds(results)?;
                Ok(fidelity_time::figure(&board, &metric, &seconds, style)?)
            })
        }
        FigureCommand::Qualitative { pictures, pairs } => sheet(pictures, "qualitative", |shown| {
            shown.pairs = pairs.chosen(shown)?;
            Ok(shown.pairs_as_rows())
        }),
        FigureCommand::Ablation { pictures, pairs } => sheet(pictures, "ablation", |shown| {
            shown.pairs = pairs.chosen(shown)?;
            Ok(shown.pairs_as_columns(false))
        }),
        FigureCommand::ExtendedMotion {
            pictures,
            source,
            count,
        } => sheet(pictures, "extended-motion", |shown| {
            shown.pairs = along_path(shown.board, source.as_deref(), *count)?;
            Ok(shown.pairs_as_columns(true))
        }),
        FigureCommand::Failure {
            pictures,
            pairs,
            depth,
        } => sheet(pictures, "failure", |shown| {
            shown.pairs = pairs.chosen(shown)?;
            match shown.methods[..] {
                [method] => Ok(failure::sheet(shown, method, depth.as_deref())),
                _ => Err(
                    UsageError("failure shows one method: name it with --method".to_owned()).into(),
                ),
            }
        }),
        FigureCommand::Uncertainty(args) => of_depth(args),
    }
}

fn list(as_json: bool) -> anyhow::Result<Outcome> {
    if as_json {
        output::json(&FIGURES)?;
        return Ok(Outcome::Done);
    }
    for figure in FIGURES {
        output::line(format!(
            "{}\n  shows  {}\n  paper  {}\n  needs  {}\n  by     sharp-bench {}",
            figure.name, figure.shows, figure.paper, figure.needs, figure.command
        ))?;
    }
    Ok(Outcome::Done)
}

/// The paper's motion-range figure.
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
    make: impl FnOnce(&Results, &FigureStyle) -> anyhow::Result<Option<Figure>>,
) -> anyhow::Result<Outcome> {
    let style = style(args.out.style.as_ref())?;
    let results = join(&args.runs)?;
    check_writable(&args.out.out)?;
    let figure = make(&results, &style)?;
    let figure = figure.ok_or_else(|| anyhow!("{stem}: the runs have nothing to show"))?;
    say(&figure.write(&args.out.out, stem)?, &args.out)?;
    Ok(Outcome::of_problems(warn_damaged(&results)))
}

fn sheet(
    args: &PicturesArgs,
    stem: &str,
    make: impl FnOnce(&mut SheetContent<'_>) -> anyhow::Result<Sheet>,
) -> anyhow::Result<Outcome> {
    let out = &args.runs.out;
    let style = style(out.style.as_ref())?;
    let results = join(&args.runs.runs)?;
    check_writable(&out.out)?;
    let scenes = assemble::scenes(&results.manifest, &Terminal::default());
    let pictures = RunPictures::new(&results, &scenes);
    let input = assemble::input(&results, &pictures, PublishedNumbers::Never);
    let board = Board::new(input.records, &input.datasets, &input.methods)?;
    let metrics = Column::chosen(&input.metrics, &args.metrics)?;
    let mut shown = SheetContent {
        methods: methods(&board, &args.methods)?,
        board: &board,
        pairs: Vec::new(),
        metrics: &metrics,
        pictures: &pictures,
        crops: args.crops.clone(),
    };
    let sheet = make(&mut shown)?;
    write_sheet(&sheet, stem, out, &style)?;
    let not_scored = pictures.not_scored();
    warn_not_scored(&not_scored);
    let damaged = warn_damaged(&results);
    Ok(Outcome::of_problems(damaged || !not_scored.is_empty()))
}

fn methods(board: &Board<'_>, names: &[String]) -> Result<Vec<usize>, ReportError> {
    let labels = || board.methods.iter().map(|method| method.label.as_str());
    if names.is_empty() {
        let ranked = board.methods.iter().enumerate();
        let ranked = ranked.filter(|(_, method)| method.unranked.is_none());
        return Ok(ranked.map(|(i, _)| i).collect());
    }
    let of_name = |name: &String| {
        let found = labels().position(|label| label == name);
        found.ok_or_else(|| ReportError::absent("method", name, labels()))
    };
    names.iter().map(of_name).collect()
}

impl PairsChoice {
    fn chosen<'a>(&self, shown: &SheetContent<'a>) -> Result<Vec<ChosenPair<'a>>, ReportError> {
        chosen(
            shown.board,
            shown.metrics,
            &self.ids,
            (self.choose, self.count),
        )
    }
}

fn of_depth(args: &UncertaintyArgs) -> anyhow::Result<Outcome> {
    let style = style(args.out.style.as_ref())?;
    let picture = read_rgb8(&args.picture)?;
    check_writable(&args.out.out)?;
    let maps = match (&args.depth, &args.mirrored, &args.checkpoint) {
        (Some(depth), Some(mirrored), _) => vec![Mirrored {
            name: String::new(),
            depth: read_metres(depth)?,
            of_mirror: read_metres(mirrored)?,
        }],
        (.., Some(checkpoint)) => {
            uncertainty::by_network(&picture, checkpoint, args.config.as_deref())?
        }
        _ => return Err(UsageError("--depth and --mirrored, or --checkpoint".to_owned()).into()),
    };
    let sheet = uncertainty::sheet(&picture, &maps).map_err(|reason| anyhow!(reason))?;
    write_sheet(&sheet, "uncertainty", &args.out, &style)?;
    Ok(Outcome::Done)
}

fn write_sheet(
    sheet: &Sheet,
    stem: &str,
    out: &OutArgs,
    style: &FigureStyle,
) -> anyhow::Result<()> {
    let bytes = png(sheet, &SheetMedium::print(style, sheet.columns()))?;
    let bytes = bytes.with_context(|| {
        let mut reasons = sheet.rows.iter().flat_map(|(_, tiles)| tiles);
        let reason = reasons.find_map(|tile| tile.picture.as_ref().err());
        let reason = reason.map_or_else(|| "no pair".to_owned(), ToString::to_string);
        format!("{stem}: there is no picture to show ({reason})")
    })?;
    let path = out.out.join(format!("{stem}.png"));
    write_over_own(&path, &bytes, MARK)?;
    say(&[path], out)
}

fn say(files: &[PathBuf], args: &OutArgs) -> anyhow::Result<()> {
    let names: Vec<String> = files
        .iter()
        .map(|file| file.display().to_string())
        .collect();
    if args.json {
        let out = args.out.display().to_string();
        return output::json(&json!({ "out": out, "files": names }));
    }
    for name in names {
        output::line(format!("wrote {name}"))?;
    }
    Ok(())
}
