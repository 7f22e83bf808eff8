//! `pairs diff` and `pairs verify`: compares a list with another list, or with local files.

use std::fmt::Display;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use serde_json::{Value, json};
use sharp_datasets::Scene;

use super::super::data_args::DatasetArgs;
use super::super::{Outcome, output};
use crate::io::counts::counted;
use crate::pairs::PairList;
use crate::pairs::pair_list::{ListDiff, Verification};

/// Maximum number of lines printed per kind of difference; `--json` prints all.
const LINES: usize = 20;

/// Compare two lists: show pairs that are in only one list, and values that differ
///
/// Ignores the order of rows. Exit code 0 if the lists have the same pairs with the same values, 4 if not.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  sharp-bench pairs diff ours.csv theirs.csv --json")]
pub(super) struct DiffArgs {
    /// The first pair list
    #[arg(value_name = "A.csv")]
    first: PathBuf,
    /// The second pair list
    #[arg(value_name = "B.csv")]
    second: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn diff(args: &DiffArgs) -> anyhow::Result<Outcome> {
    let (first, second) = (PairList::read(&args.first)?, PairList::read(&args.second)?);
    let diff = first.diff(&second);
    let compared = ComparedLists {
        first: list_json(&first),
        second: list_json(&second),
        same: diff.is_empty(),
        diff: &diff,
    };
    output::print(
        args.json,
        || &compared,
        || difference([&first, &second], &diff),
    )?;
    Ok(Outcome::of_problems(!diff.is_empty()))
}

#[derive(Serialize)]
struct ComparedLists<'a> {
    first: Value,
    second: Value,
    same: bool,
    #[serde(flatten)]
    diff: &'a ListDiff,
}

fn list_json(list: &PairList) -> Value {
    json!({
        "file": list.path.display().to_string(),
        "sha256": list.sha256,
        "pairs": list.pairs.len(),
        "selected": list.pairs.iter().filter(|pair| pair.selected).count(),
    })
}

fn difference(lists: [&PairList; 2], diff: &ListDiff) -> String {
    let [a, b] = lists.map(|list| list.path.display());
    let shown = |value: &str| if value.is_empty() { "(none)" } else { value }.to_owned();
    let changed = first_lines("different", &diff.changed, |pair| {
        let changes: Vec<String> = pair
            .columns
            .iter()
            .map(|(column, [a, b])| format!("{column} {} -> {}", shown(a), shown(b)))
            .collect();
        format!("{}: {}", pair.pair_id, changes.join(", "))
    });
    let in_all = format!(
        "{} equal, {} different, {} only in {a}, {} only in {b}",
        counted(diff.equal, "pair"),
        diff.changed.len(),
        diff.only_first.len(),
        diff.only_second.len()
    );
    let only =
        |list: &dyn Display, pairs| first_lines(&format!("only in {list}"), pairs, Clone::clone);
    only(&a, &diff.only_first) + &only(&b, &diff.only_second) + &changed + &in_all
}

/// A line for each of the first items of a kind, and how many more there are.
fn first_lines<T>(head: &str, items: &[T], text: impl Fn(&T) -> String) -> String {
    let line = |item| format!("{head}: {}\n", text(item));
    let mut all: String = items.iter().take(LINES).map(line).collect();
    if items.len() > LINES {
        all += &format!("{head}: {} more not shown\n", items.len() - LINES);
    }
    all
}

/// Check that your files match a list: photographs by sha256, camera pairs by baseline and rotation
///
/// Lists everything that differs. Exit code 0 if the files are those that the list was made from, 4 if not.
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

#[derive(Serialize)]
struct VerifiedList<'a> {
    list: String,
    sha256: &'a str,
    good: bool,
    pairs: usize,
    #[serde(flatten)]
    found: &'a Verification,
}

pub(super) fn verify(args: &VerifyArgs) -> anyhow::Result<Outcome> {
    let list = PairList::read(&args.list)?;
    let datasets = args.datasets.open()?;
    let scenes: Vec<Scene> = datasets.into_iter().flat_map(|d| d.scenes).collect();
    let found = list.verify(&scenes);
    let outcome = Outcome::of_problems(!found.is_good());
    let verified = VerifiedList {
        list: list.path.display().to_string(),
        sha256: &list.sha256,
        good: found.is_good(),
        pairs: list.pairs.len(),
        found: &found,
    };
    output::print(args.json, || &verified, || verification(&list, &found))?;
    Ok(outcome)
}

fn verification(list: &PairList, found: &Verification) -> String {
    let absent = first_lines("absent", &found.absent, Clone::clone);
    let unreadable = first_lines("unreadable", &found.unreadable, |u| {
        format!("{}: {}", u.view, u.reason)
    });
    let different = first_lines("different photograph", &found.different, |d| {
        let (dataset, scene, view) = (&d.dataset, &d.scene, &d.view);
        format!(
            "{dataset}/{scene}/{view}: sha256 {} instead of {}",
            d.found, d.expected
        )
    });
    let moved = first_lines("different cameras", &found.moved, |m| {
        let ([baseline, found_m], [rotation, found_deg]) = (m.baseline_m, m.rotation_deg);
        format!(
            "{}: baseline {found_m} m instead of {baseline} m, rotation {found_deg}° instead of {rotation}°",
            m.pair_id
        )
    });
    let in_all = format!(
        "{}, {}: {} equal, {} without a hash in the list",
        counted(list.pairs.len(), "pair"),
        counted(found.photographs, "photograph"),
        found.equal,
        found.unhashed
    );
    absent + &unreadable + &different + &moved + &in_all
}
