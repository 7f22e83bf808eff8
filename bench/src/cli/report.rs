//! `report RUN…`: writes tables, plots and a browsable page for runs.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::metrics::describe;
use super::outcome::UsageError;
use super::output::Terminal;
use super::{Outcome, output};
use crate::evaluate::{Aggregation, Named, Results, Shown, UnitCounts, join_under};
use crate::report::statistics::Uncertainty;
use crate::report::tables::Table;
use crate::report::{self, Layout, PublishedNumbers, ReportOptions};

/// Write tables, plots and a browsable page from runs
///
/// Several runs are joined into one report with the pairs, methods and datasets of all runs; results that occur in
/// several runs appear once. NAME=RUN prefixes the run's methods with NAME, or renames a single method to NAME. An
/// unfinished run is reported with the results so far.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench report runs/first
  sharp-bench report runs/sharp runs/baselines --out comparison
  sharp-bench report base=runs/v1 new=runs/v2 --out comparison
  sharp-bench report runs/first --methods-text

Writes report.md, index.html (opens from disk), tables as .md, .csv and .tex, plots as .svg and .png. The page contains
the pictures of up to 24 pairs; for more pairs, small pictures are stored in thumbs/ next to the page, below 200 MB in
total. To enlarge a picture, the page reads it from the run folder (predictions) or the dataset (sources and targets), if
these are still in place.")]
pub(super) struct ReportArgs {
    #[command(flatten)]
    runs: ShownRuns,
    /// Where to write [default: RUN/report for a single run]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Which of the paper's numbers to show next to yours
    #[arg(long, value_enum, default_value_t = PublishedNumbers::Matching)]
    published: PublishedNumbers,
    /// How to average: over pairs, over the means of scenes, or over the means of source views [default: the rule that
    /// the runs were made with]
    #[arg(long, value_enum, value_name = "OVER")]
    aggregate: Option<Aggregation>,
    /// Uncertainty shown as ± after each mean in a table [default: ci95 on the page, none elsewhere]
    #[arg(long, value_enum)]
    uncertainty: Option<Uncertainty>,
    /// Where to put the page's pictures: into the page itself (file) or next to it (folder) [default: file for up to 24
    /// pairs, else folder]
    #[arg(long, value_enum)]
    layout: Option<Layout>,
    /// Omit paths on this machine, and the pictures of datasets whose terms forbid publishing (the page
    /// lists these datasets)
    #[arg(long)]
    public: bool,
    /// Instead of a report, print a paragraph for a paper. It describes datasets and pairs, conventions, metrics and
    /// differences from the SHARP paper, with references. With --out, write methods.tex and methods.bib
    #[arg(long, conflicts_with_all = ["published", "uncertainty", "layout", "public"])]
    methods_text: bool,
    /// Print the list of written files as JSON
    #[arg(long)]
    json: bool,
}

/// Runs, and which of their methods, datasets and metrics to show.
#[derive(Debug, Args)]
pub(super) struct ShownRuns {
    /// Run folders or bundles
    #[arg(required = true, value_name = "[NAME=]RUN")]
    pub(super) runs: Vec<Named>,
    #[command(flatten)]
    pub(super) shown: Shown,
}

impl ShownRuns {
    /// The results of the runs, joined; averaged by `aggregation` instead of the runs' rule if given.
    pub(super) fn results(&self, aggregation: Option<Aggregation>) -> anyhow::Result<Results> {
        let joined = join_under(&self.runs, aggregation)?;
        let [shown] = self
            .shown
            .of([joined])
            .map_err(|error| UsageError(error.to_string()))?;
        Ok(shown)
    }
}

pub(super) fn execute(args: &ReportArgs) -> anyhow::Result<Outcome> {
    let results = args.runs.results(args.aggregate)?;
    if args.methods_text {
        return methods_text(&results, args);
    }
    let out = match (&args.out, args.runs.runs.as_slice()) {
        (Some(out), _) => out.clone(),
        (None, [run]) if run.path.is_dir() => run.path.join("report"),
        (None, _) => {
            let reason = "a report on several runs or on a bundle needs --out DIR";
            return Err(UsageError(reason.to_owned()).into());
        }
    };
    if !results.missing.is_empty() {
        output::remark(format!(
            "note: {} of {} units are done; the report covers only those",
            results.records.len(),
            results.records.len() + results.missing.len()
        ));
    }
    let scenes = report::scenes(&results.manifest, &Terminal::default());
    let options = ReportOptions {
        layout: args.layout,
        public: args.public,
        published: args.published,
        uncertainty: args.uncertainty,
        ..ReportOptions::default()
    };
    let files = report::report(&results, &scenes, &out, &options)?;
    let tables = tables(&results, args.uncertainty)?;
    let value = || {
        json!({
            "out": out.display().to_string(),
            "layout": files.layout,
            "files": output::names(&files.all),
            "not_scored": output::names(&files.not_scored),
        })
    };
    output::print(args.json, value, || {
        let pictures = match files.layout {
            Layout::File => "one file",
            Layout::Folder => "pictures in thumbs/ next to the page",
        };
        format!("{tables}\nreport  {}  ({pictures})", files.html.display())
    })?;
    warn_not_scored(&files.not_scored);
    let damaged = warn_damaged(&results);
    Ok(Outcome::of_problems(
        damaged || !files.not_scored.is_empty(),
    ))
}

fn methods_text(results: &Results, args: &ReportArgs) -> anyhow::Result<Outcome> {
    let text = report::methods_text::methods_text(results);
    let Some(out) = &args.out else {
        return describe::methods_text(&text, args.json);
    };
    let files = text.write(out)?;
    output::print_written(args.json, &files)?;
    Ok(Outcome::Done)
}

/// Warns about damaged units; returns whether there are any.
pub(super) fn warn_damaged(results: &Results) -> bool {
    for path in &results.damaged {
        output::remark(format!(
            "warning: {}: damaged, so its unit counts as missing; `run` with the same options recomputes it",
            path.display()
        ));
    }
    !results.damaged.is_empty()
}

/// Warns about kept pictures that the report leaves out because they differ from the scored ones.
pub(super) fn warn_not_scored(paths: &[PathBuf]) {
    for path in paths {
        output::remark(format!(
            "warning: {}: differs from the picture that was scored, so it is not shown; `run` with \
             the same options recreates it",
            path.display()
        ));
    }
}

/// The tables of means as text.
pub(super) fn tables(
    results: &Results,
    uncertainty: Option<Uncertainty>,
) -> anyhow::Result<String> {
    let tables = report::mean_tables(results, uncertainty)?;
    let texts: Vec<String> = tables.iter().map(Table::text).collect();
    Ok(texts.join("\n"))
}

/// Exit code 75 if units are left or, after the last stage, still waiting for an earlier stage; otherwise 4 if there
/// are recorded failures.
pub(super) fn outcome(counts: UnitCounts, is_last_stage: bool) -> Outcome {
    if is_last_stage && counts.waiting > 0 {
        output::remark(format!(
            "warning: {} of {} units are waiting, because their predictions are missing or their scenes \
             cannot be read",
            counts.waiting, counts.units
        ));
        return Outcome::Resumable;
    }
    if counts.left > 0 {
        return Outcome::Resumable;
    }
    if counts.failed == 0 {
        return Outcome::Done;
    }
    output::remark(format!(
        "warning: {} of {} units failed; scores.csv and the report state the reasons",
        counts.failed, counts.units
    ));
    Outcome::RecordedFailures
}
