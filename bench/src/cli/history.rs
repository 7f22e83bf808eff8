//! `history`: runs over time.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::outcome::UsageError;
use super::{Outcome, output};
use crate::evaluate::Occasion;
use crate::io::atomic_files::write_all_over_own;
use crate::io::text::visible_line;
use crate::track::history::{self, HistoryError};

/// Track the scores of runs over time: means with intervals, and the runs at which they changed
///
/// A history is a folder with one small file per run: a bundle of the run's scores with label, commit and date. Entries
/// are numbered in the order in which they were added and are never changed. Damaged entries are reported, and the exit
/// code is 4; the other entries are still used.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench history add scores-over-time runs/nightly --commit $(git rev-parse --short HEAD)
  sharp-bench history show scores-over-time
  sharp-bench history show scores-over-time --csv trend.csv --html trend.html")]
pub(super) struct HistoryArgs {
    #[command(subcommand)]
    command: HistoryCommand,
}

#[derive(Debug, Subcommand)]
enum HistoryCommand {
    Add(AddArgs),
    Show(ShowArgs),
}

/// Add a run as the next entry
///
/// Adding the same results under the same label and commit again changes nothing. Any difference in weights,
/// photographs, code or scores makes a new entry.
#[derive(Debug, Args)]
struct AddArgs {
    /// The history's folder; created if missing
    dir: PathBuf,
    /// Run folder or bundle
    run: PathBuf,
    /// The entry's name in tables and plots [default: the name of RUN]
    #[arg(long, value_name = "TEXT")]
    label: Option<String>,
    /// The version of your code, such as a git hash
    #[arg(long, value_name = "TEXT")]
    commit: Option<String>,
    /// Date of the run, YYYY-MM-DD or YYYY-MM-DDTHH:MM [default: now, UTC]
    #[arg(long)]
    date: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Show scores over time, per method, dataset and metric
///
/// An entry is marked as a change point if `compare` finds it better or worse than the previous comparable entry (a
/// step) or than the last change point (a drift). A series is interrupted where consecutive entries cannot be compared.
#[derive(Debug, Args)]
struct ShowArgs {
    /// The history's folder
    dir: PathBuf,
    /// Write a table: one row per entry, method, dataset and metric
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write a page with plots
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &HistoryArgs) -> anyhow::Result<Outcome> {
    match &args.command {
        HistoryCommand::Add(args) => add(args),
        HistoryCommand::Show(args) => show(args),
    }
}

fn add(args: &AddArgs) -> anyhow::Result<Outcome> {
    let (label, commit) = (args.label.as_deref(), args.commit.as_deref());
    let occasion = history::occasion(&args.run, label, commit, args.date.as_deref());
    let occasion = occasion.map_err(|error| match error {
        HistoryError::Occasion(reason) => anyhow::Error::from(UsageError(reason)),
        other => other.into(),
    })?;
    let added = history::add(&args.dir, &args.run, occasion)?;
    let file = added.path.display();
    output::print(
        args.json,
        || {
            let mut value = entry_json(added.number, &added.occasion);
            value["file"] = json!(file.to_string());
            value["is_new"] = json!(added.is_new);
            value["damaged"] = json!(added.damaged);
            value
        },
        || {
            let Occasion { label, date, .. } = &added.occasion;
            let known = if added.is_new {
                String::new()
            } else {
                format!(
                    ", already added on {date} with the same results; use another --label or --commit for a new entry"
                )
            };
            format!("{file}  {label}{known}")
        },
    )?;
    Ok(outcome(&added.damaged))
}

fn entry_json(number: u32, occasion: &Occasion) -> Value {
    let Occasion {
        label,
        commit,
        date,
        ..
    } = occasion;
    json!({"entry": number, "label": label, "commit": commit, "date": date})
}

fn show(args: &ShowArgs) -> anyhow::Result<Outcome> {
    let history = history::read(&args.dir)?;
    let value = || {
        let entry = |(number, occasion): &(u32, Occasion)| entry_json(*number, occasion);
        json!({
            "schema": 1,
            "entries": history.entries.iter().map(entry).collect::<Vec<_>>(),
            "rows": history.points().collect::<Vec<_>>(),
            "damaged": history.damaged,
        })
    };
    output::print(args.json, value, || {
        let grids = [history.entries_grid()]
            .into_iter()
            .chain(history.series_grids());
        grids.map(|grid| format!("{}\n", grid.text())).collect()
    })?;
    let mut files: Vec<(&Path, Vec<u8>, &str)> = Vec::new();
    if let Some(path) = &args.csv {
        files.push((
            path,
            history::csv::csv(&history),
            "entry,label,commit,date,",
        ));
    }
    if let Some(path) = &args.html {
        let title = args.dir.display().to_string();
        let page = history::page::html(&history, &title)?;
        files.push((
            path,
            page.into_bytes(),
            "<p class=\"eyebrow\">sharp-bench history</p>",
        ));
    }
    for path in write_all_over_own(&files)? {
        if !args.json {
            output::line(path.display().to_string())?;
        }
    }
    Ok(outcome(&history.damaged))
}

fn outcome(damaged: &[String]) -> Outcome {
    for reason in damaged {
        output::remark(format!("warning: damaged entry: {}", visible_line(reason)));
    }
    Outcome::of_problems(!damaged.is_empty())
}
