//! `speed`: times of inference and rendering, or the total compute of runs.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use sharp::render::Backend;
use sharp_metrics::{Selection, Weights};

use super::outcome::UsageError;
use super::output::Terminal;
use super::{Outcome, output};
use crate::config::{PairConfig, RenderingConfig, rendering};
use crate::evaluate::speed::SpeedOptions;
use crate::evaluate::{Request, prepare};
use crate::io::machine::cpu_and_threads;
use crate::methods::{self, MethodSpec};
use crate::pairs::{DatasetConfig, OpenDataset, clap_dataset};
use crate::report::speed::{Measured, SpeedReport, compute::compute};
use crate::report::tables::grid::{GridCell, TextGrid};
use crate::scoring::Scoring;

/// Time inference and rendering separately, or add up the hours of finished runs and list their hardware
///
/// With --method and --dataset, measures each method alone on a few pairs of each dataset, at the targets' resolution
/// and after a warm-up. Reports medians, spread, peak memory, and the number of Gaussians rendered. For given runs,
/// only total hours and hardware are reported: the times stored in a run folder are not comparable, because scoring ran
/// at the same time.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench speed --method sharp:checkpoint=sharp.pt --dataset middlebury=data/Middlebury2014 \\
      --out speed
  sharp-bench speed runs/sharp --out speed

Writes speed.md, speed.tex and, for measured methods, speed.csv. Run nothing else at the same time.")]
pub(super) struct SpeedArgs {
    /// Run folders: add up their hours and list their hardware
    #[arg(value_name = "RUN", required_unless_present = "methods")]
    runs: Vec<PathBuf>,
    /// A method to measure, KIND[:key=value,…]; repeatable
    #[arg(long = "method", value_name = "SPEC", requires = "datasets")]
    methods: Vec<MethodSpec>,
    /// A dataset to measure on, [NAME:]FORMAT=PATH[,key=value…]; repeatable
    #[arg(long = "dataset", value_name = "SPEC", requires = "methods", value_parser = clap_dataset)]
    datasets: Vec<DatasetConfig>,
    #[command(flatten)]
    pairs: PairConfig,
    /// Number of pairs per dataset, spread over the dataset's scenes
    #[arg(long, value_name = "N", default_value_t = 3)]
    limit: usize,
    /// Untimed warm-up rounds on the first pair of each dataset
    #[arg(long, value_name = "N", default_value_t = 1)]
    warmup: usize,
    /// Timed rounds per pair
    #[arg(long, value_name = "N", default_value_t = 5)]
    repeat: usize,
    /// The renderer: cpu, or wgpu
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Cpu)]
    backend: Backend,
    /// The GPU to render on, by part of its description (`sharp-bench doctor` lists the GPUs)
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    #[command(flatten)]
    rendering: RenderingConfig,
    /// Number of threads [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// The folder to write into
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &SpeedArgs) -> anyhow::Result<Outcome> {
    super::set_threads(args.threads)?;
    if args.limit == 0 || args.repeat == 0 {
        return Err(UsageError("--limit and --repeat must be at least 1".to_owned()).into());
    }
    let report = SpeedReport {
        measured: if args.methods.is_empty() {
            None
        } else {
            Some(measure(args)?)
        },
        compute: if args.runs.is_empty() {
            None
        } else {
            Some(compute(&args.runs)?)
        },
    };
    let written = report.write(&args.out)?;
    let speeds = report.measured.as_ref().map(|measured| &measured.speeds);
    let grid = |grid: &TextGrid| {
        let row = |row: &Vec<GridCell>| -> Vec<String> {
            row.iter().map(|cell| cell.text.clone()).collect()
        };
        json!({"heads": grid.heads, "rows": grid.rows.iter().map(row).collect::<Vec<_>>()})
    };
    let value = || {
        json!({
            "machine": cpu_and_threads(),
            "measured": speeds,
            "compute": report.compute.as_ref().map(grid),
            "files": output::names(&written),
        })
    };
    output::print(args.json, value, || {
        format!("{}\n{}", report.text().trim_end(), output::wrote(&written))
    })?;
    let failed = speeds.is_some_and(|s| s.iter().any(|speed| !speed.failures.is_empty()));
    Ok(Outcome::of_problems(failed))
}

fn measure(args: &SpeedArgs) -> anyhow::Result<Measured> {
    let scoring = Scoring::new(&Selection::parse("psnr")?, &Weights::none())?;
    let datasets = OpenDataset::open_all(&args.datasets, None)?;
    let request = Request {
        limit: Some(args.limit * datasets.len()),
        pairs: args.pairs.origin()?,
        methods: methods::build(&args.methods, None)?,
        backend: rendering::backend(&args.backend, args.adapter.as_deref())?,
        rendering: args.rendering.settings(),
        ..Request::new(datasets, Vec::new(), scoring)
    };
    let terminal = Terminal::default();
    let evaluation = prepare(request, &terminal)?;
    let options = SpeedOptions {
        warmup: args.warmup,
        repeat: args.repeat,
    };
    Ok(Measured {
        speeds: evaluation.speed(options, &terminal)?,
        options,
        manifest: evaluation.manifest()?,
        machine: cpu_and_threads(),
    })
}
