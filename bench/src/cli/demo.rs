//! `demo`: a complete evaluation on bundled data.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::output::Terminal;
use super::report::{outcome, tables};
use super::{Outcome, output};
use crate::config::MetricConfig;
use crate::evaluate::{Request, RunOptions, prepare};
use crate::io::checkpoint::{NetworkError, bundled_weights};
use crate::methods::{self, MethodSpec};
use crate::pairs::{OpenDataset, PairOptions, PairOrigin, PairRecipe};
use crate::report::{Layout, PictureBudget, ReportOptions, report};

/// Try sharp-bench on bundled data: evaluate, tabulate, plot
///
/// Evaluates the bundled small network twice, once as predicted and once scaled to the true depth, and two methods
/// without a network. The data are four real stereo pairs of Middlebury with measured depth, and a procedural
/// multi-view scene. Writes a report and downloads nothing. The network has SHARP's architecture but was trained on
/// procedural scenes; it is not Apple's model.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench demo --out demo-run")]
pub(super) struct DemoArgs {
    /// Folder for the data, the run and the report
    #[arg(long, value_name = "DIR", default_value = "demo-run")]
    out: PathBuf,
    #[command(flatten)]
    metrics: MetricConfig,
    /// Number of threads; does not affect the results [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// The procedural scene: small enough for a demo, but large enough for its textures to be visible.
const SYNTHETIC: &str = "Synthetic:synthetic=size=480x360,views=24";

/// Methods, in the order of the tables.
const METHODS: [&str; 4] = [
    "sharp:label=sharp-mini,checkpoint=mini",
    "sharp:label=sharp-mini-depth,checkpoint=mini,depth=privileged",
    "depth-splat",
    "copy",
];

/// Number of procedural pairs evaluated; the list has more.
const SYNTHETIC_PAIRS: usize = 24;

pub(super) fn execute(args: &DemoArgs) -> anyhow::Result<Outcome> {
    super::set_threads(args.threads)?;
    let data = sharp_datasets::bundled::extract_all(&args.out.join("data"))?;
    let datasets = [
        format!("Middlebury:middlebury={}", data.display()).parse()?,
        SYNTHETIC.parse()?,
    ];
    let mut options = PairOptions::default();
    options.sampling.limit = Some(SYNTHETIC_PAIRS);
    let terminal = Terminal::default();
    let scoring = args.metrics.scoring()?;
    let mut methods = METHODS.to_vec();
    // If the program was copied without the files that belong next to it, leave out the network.
    if let Err(error @ NetworkError::NotBundled { .. }) = bundled_weights() {
        output::remark(format!(
            "note: the tables have no rows for the network: {error}"
        ));
        methods.retain(|method| !method.contains("checkpoint=mini"));
    }
    let specs: Vec<MethodSpec> = methods
        .iter()
        .map(|spec| spec.parse())
        .collect::<Result<_, _>>()?;
    let request = Request {
        pairs: PairOrigin::Built {
            recipe: Box::new(PairRecipe::new(options)),
            cache: None,
        },
        methods: methods::build(&specs, None)?,
        ..Request::new(OpenDataset::open_all(&datasets, None)?, Vec::new(), scoring)
    };
    let finished = prepare(request, &terminal)?.run(
        &args.out.join("run"),
        RunOptions::default(),
        &terminal,
    )?;
    let outcome = outcome(finished.counts, true);
    let files = report(
        &finished.results,
        &finished.scenes,
        &args.out.join("report"),
        // Write a single page.
        &ReportOptions {
            layout: Some(Layout::File),
            pictures: Some(PictureBudget {
                bytes: 2 << 20,
                side: 480,
            }),
            ..ReportOptions::default()
        },
    )?;
    let run = args.out.join("run");
    let (scores, run) = (run.join("scores.csv").display().to_string(), run.display());
    let page = files.html.display();
    let tables = tables(&finished.results, None)?;
    output::print(
        args.json,
        || json!({"run": run.to_string(), "scores": scores, "report": page.to_string()}),
        || format!("{tables}\nreport  {page}\nrun     {run}"),
    )?;
    Ok(outcome)
}
