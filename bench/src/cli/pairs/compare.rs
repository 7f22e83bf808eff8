//! `pairs diff` and `pairs verify`: a list against another list, and against someone's files.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Map, Value, json};
use sharp_datasets::Scene;

use super::super::data_args::DatasetArgs;
use super::super::{Outcome, output};
use crate::io::counts::counted;
use crate::pairs::PairList;
use crate::pairs::pair_list::ListDiff;

/// Lines of one kind that are printed; `--json` has all.
const LINES: usize = 20;

/// Compare two lists: which pairs only one of them has, which values differ
///
/// The order of rows does not count. Exit code 0 if the lists hold the same pairs with the same values, 4 if not.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench pairs diff ours.csv theirs.csv --json")]
pub(super) struct DiffArgs {
    /// A list
    #[arg(value_name = "A.csv")]
    first: PathBuf,
    /// Another list
    #[arg(value_name = "B.csv")]
    second: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn diff(args: &DiffArgs) -> anyhow::Result<Outcome> {
    let (first, second) = (PairList::read(&args.first)?, PairList::read(&args.second)?);
    let diff = first.diff(&second);
    if args.json {
        output::json(&diff_json(&first, &second, &diff))?;
    } else {
        print_diff(&first, &second, &diff)?;
    }
    Ok(if diff.is_empty() {
        Outcome::Done
    } else {
        Outcome::RecordedFailures
    })
}

fn diff_json(first: &PairList, second: &PairList, diff: &ListDiff) -> Value {
    let list = |list: &PairList| {
        json!({
            "file": list.path.display().to_string(),
            "sha256": list.sha256,
            "pairs": list.pairs.len(),
            "selected": list.pairs.iter().filter(|p| p.selected).count(),
        })
    };
    let changed: Vec<Value> = diff
        .changed
        .iter()
        .map(|(pair_id, changes)| {
            let columns: Map<String, Value> = changes
                .iter()
                .map(|c| (c.column.to_owned(), json!([c.first, c.second])))
                .collect();
            json!({ "pair_id": pair_id, "columns": columns })
        })
        .collect();
    json!({
        "first": list(first),
        "second": list(second),
        "same": diff.is_empty(),
        "equal": diff.equal,
        "only_first": diff.only_first,
        "only_second": diff.only_second,
        "changed": changed,
    })
}

fn print_diff(first: &PairList, second: &PairList, diff: &ListDiff) -> anyhow::Result<()> {
    let (a, b) = (first.path.display(), second.path.display());
    print_some(&format!("only in {a}"), &diff.only_first, Clone::clone)?;
    print_some(&format!("only in {b}"), &diff.only_second, Clone::clone)?;
    print_some("different", &diff.changed, |(pair_id, changes)| {
        let changes: Vec<String> = changes
            .iter()
            .map(|c| format!("{} {} -> {}", c.column, shown(&c.first), shown(&c.second)))
            .collect();
        format!("{pair_id}: {}", changes.join(", "))
    })?;
    output::line(format!(
        "{} equal, {} different, {} only in {a}, {} only in {b}",
        counted(diff.equal, "pair"),
        diff.changed.len(),
        diff.only_first.len(),
        diff.only_second.len()
    ))
}

fn shown(value: &str) -> &str {
    if value.is_empty() { "(none)" } else { value }
}

/// The first lines of a kind, and how many more there are.
fn print_some<T>(head: &str, items: &[T], text: impl Fn(&T) -> String) -> anyhow::Result<()> {
    for item in items.iter().take(LINES) {
        output::line(format!("{head}: {}", text(item)))?;
    }
    if items.len() > LINES {
        output::line(format!("{head}: and {} more", items.len() - LINES))?;
    }
    Ok(())
}

/// Check a list against files: every photograph by its sha256, every pair of cameras by baseline and rotation
///
/// Everything that is wrong is listed, not only the first thing. Exit code 0 if the files are those that the list was
/// made from, 4 if not.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  sharp-bench pairs verify theirs.csv --dataset middlebury=data/Middlebury2014"
)]
pub(super) struct VerifyArgs {
    /// A list, CSV as written by `pairs`
    #[arg(value_name = "PAIRS.csv")]
    list: PathBuf,
    #[command(flatten)]
    datasets: DatasetArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn verify(args: &VerifyArgs) -> anyhow::Result<Outcome> {
    let list = PairList::read(&args.list)?;
    let datasets = args.datasets.open()?;
    let scenes: Vec<Scene> = datasets.into_iter().flat_map(|d| d.scenes).collect();
    let found = list.verify(&scenes);
    let outcome = if found.is_good() {
        Outcome::Done
    } else {
        Outcome::RecordedFailures
    };
    if args.json {
        let different: Vec<Value> = found
            .different
            .iter()
            .map(|d| {
                json!({
                    "dataset": d.dataset, "scene": d.scene, "view": d.view,
                    "expected": d.expected, "found": d.found,
                })
            })
            .collect();
        let unreadable: Vec<Value> = found
            .unreadable
            .iter()
            .map(|(view, reason)| json!({ "view": view, "reason": reason }))
            .collect();
        let moved: Vec<Value> = found
            .moved
            .iter()
            .map(|m| {
                json!({
                    "pair_id": m.pair_id,
                    "baseline_m": [m.expected.0, m.found.0],
                    "rotation_deg": [m.expected.1, m.found.1],
                })
            })
            .collect();
        output::json(&json!({
            "list": list.path.display().to_string(),
            "sha256": list.sha256,
            "good": found.is_good(),
            "pairs": list.pairs.len(),
            "photographs": found.photographs,
            "equal": found.equal,
            "without_hash": found.unhashed,
            "different": different,
            "unreadable": unreadable,
            "absent": found.absent,
            "moved": moved,
        }))?;
        return Ok(outcome);
    }
    print_some("absent", &found.absent, Clone::clone)?;
    print_some("unreadable", &found.unreadable, |(view, reason)| {
        format!("{view}: {reason}")
    })?;
    print_some("another photograph", &found.different, |d| {
        let (dataset, scene, view) = (&d.dataset, &d.scene, &d.view);
        format!(
            "{dataset}/{scene}/{view}: sha256 {} instead of {}",
            d.found, d.expected
        )
    })?;
    print_some("other cameras", &found.moved, |m| {
        format!(
            "{}: baseline {} m instead of {} m, rotation {}° instead of {}°",
            m.pair_id, m.found.0, m.expected.0, m.found.1, m.expected.1
        )
    })?;
    output::line(format!(
        "{}, {}: {} equal, {} without a hash in the list",
        counted(list.pairs.len(), "pair"),
        counted(found.photographs, "photograph"),
        found.equal,
        found.unhashed
    ))?;
    Ok(outcome)
}
