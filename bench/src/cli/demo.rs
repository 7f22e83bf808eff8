//! `demo`: the main job on bundled data.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use sharp::render::Backend;

use super::data_args::MetricArgs;
use super::evaluate::{Evaluation, Request};
use super::pair_args::PairOrigin;
use super::pair_recipe::PairRecipe;
use super::{Outcome, output, report};
use crate::protocol::PairOptions;
use crate::report::{Options, Published};
use crate::runs::plan::Keep;

/// Run the main job on bundled data: evaluate, tabulate, plot
///
/// Evaluates the methods that need no network on Middlebury's Motorcycle (a real stereo pair with measured depth,
/// built in) and on a procedural multi-view scene, and writes a report. Nothing is downloaded.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench demo --out demo-run")]
pub(super) struct DemoArgs {
    /// Where data, run and report go
    #[arg(long, value_name = "DIR", default_value = "demo-run")]
    out: PathBuf,
    #[command(flatten)]
    metrics: MetricArgs,
    /// Threads; all cores without it. Results do not depend on it
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// The procedural scene: small enough for a demo, large enough for its textures to show.
const SYNTHETIC: &str = "Synthetic:synthetic=size=480x360,views=24";

/// In the order of the tables.
const METHODS: [&str; 4] = ["target", "depth-splat", "copy", "mean"];

/// Procedural pairs that the demo evaluates; the list holds more.
const SYNTHETIC_PAIRS: usize = 24;

pub(super) fn execute(args: &DemoArgs) -> anyhow::Result<Outcome> {
    super::set_threads(args.threads)?;
    let data = sharp_datasets::bundled::extract(&args.out.join("data"))?;
    let datasets = [
        format!("Middlebury:middlebury={}", data.display()),
        SYNTHETIC.to_owned(),
    ];
    let mut options = PairOptions::default();
    options.sampling.limit = Some(SYNTHETIC_PAIRS);
    let scoring = args.metrics.scoring()?;
    let finished = Evaluation::prepare(Request {
        datasets: &datasets,
        scenes: None,
        pairs: PairOrigin::Built(Box::new(PairRecipe::plain(options))),
        methods: &METHODS.map(str::to_owned),
        scoring,
        limit: None,
        common_region: false,
        backend: &Backend::Cpu,
        chooser: None,
    })?
    .run(&args.out.join("run"), Keep::All)?;
    let outcome = report::outcome(&finished.executed);
    let runs = [finished.into()];
    if !args.json {
        report::print_tables(&runs)?;
    }
    let files = report::write(
        &runs,
        &args.out.join("report"),
        Published::Matching,
        Options {
            picture_side: 640,
            picture_bytes: 4 << 20,
            ..Options::default()
        },
    )?;
    let run = args.out.join("run");
    if args.json {
        output::json(&json!({
            "run": run.display().to_string(),
            "scores": run.join("scores.csv").display().to_string(),
            "report": files.html.display().to_string(),
        }))?;
    } else {
        output::line(format!("report  {}", files.html.display()))?;
        output::line(format!("run     {}", run.display()))?;
    }
    Ok(outcome)
}
