//! `pairs diff` and `pairs verify`: compares a list with another list, or with local files.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use sharp_datasets::Scene;

use super::super::data_args::DatasetArgs;
use super::super::{Outcome, output};
use crate::io::counts::counted;
use crate::pairs::PairList;
use crate::pairs::pair_list::{ListDiff, Verification};

/// At most this many lines are printed per kind of difference; `--json` prints all.
const LINES: usize = 20;

/// Compare two lists: pairs that only one has, and values that differ
///
/// Ignores the order of rows. Exit code 0 if the lists have the same pairs with the same values, 4 if not.
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
    let compared = ComparedLists {
        first: ComparedList::new(&first),
        second: ComparedList::new(&second),
        same: diff.is_empty(),
        diff: &diff,
    };
    output::print(&compared, args.json)?;
    Ok(Outcome::of_problems(!diff.is_empty()))
}

#[derive(Serialize)]
struct ComparedLists<'a> {
    first: ComparedList<'a>,
    second: ComparedList<'a>,
    same: bool,
    #[serde(flatten)]
    diff: &'a ListDiff,
}

#[derive(Serialize)]
struct ComparedList<'a> {
    file: String,
    sha256: &'a str,
    pairs: usize,
    selected: usize,
}

impl<'a> ComparedList<'a> {
    fn new(list: &'a PairList) -> Self {
        Self {
            file: list.path.display().to_string(),
            sha256: &list.sha256,
            pairs: list.pairs.len(),
            selected: list.pairs.iter().filter(|pair| pair.selected).count(),
        }
    }
}

impl Display for ComparedLists<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (a, b, diff) = (&self.first.file, &self.second.file, self.diff);
        write_some(f, &format!("only in {a}"), &diff.only_first, Clone::clone)?;
        write_some(f, &format!("only in {b}"), &diff.only_second, Clone::clone)?;
        let shown = |value: &str| if value.is_empty() { "(none)" } else { value }.to_owned();
        write_some(f, "different", &diff.changed, |pair| {
            let changes: Vec<String> = pair
                .columns
                .iter()
                .map(|(column, [a, b])| format!("{column} {} -> {}", shown(a), shown(b)))
                .collect();
            format!("{}: {}", pair.pair_id, changes.join(", "))
        })?;
        write!(
            f,
            "{} equal, {} different, {} only in {a}, {} only in {b}",
            counted(diff.equal, "pair"),
            diff.changed.len(),
            diff.only_first.len(),
            diff.only_second.len()
        )
    }
}

/// Writes the first items of a kind, and how many more there are.
fn write_some<T>(
    f: &mut Formatter<'_>,
    head: &str,
    items: &[T],
    text: impl Fn(&T) -> String,
) -> fmt::Result {
    for item in items.iter().take(LINES) {
        writeln!(f, "{head}: {}", text(item))?;
    }
    if items.len() > LINES {
        writeln!(f, "{head}: and {} more", items.len() - LINES)?;
    }
    Ok(())
}

/// Check a list against your files: photographs by sha256, camera pairs by baseline and rotation
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
    output::print(&verified, args.json)?;
    Ok(outcome)
}

impl Display for VerifiedList<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let found = self.found;
        write_some(f, "absent", &found.absent, Clone::clone)?;
        write_some(f, "unreadable", &found.unreadable, |u| {
            format!("{}: {}", u.view, u.reason)
        })?;
        write_some(f, "different photograph", &found.different, |d| {
            let (dataset, scene, view) = (&d.dataset, &d.scene, &d.view);
            format!(
                "{dataset}/{scene}/{view}: sha256 {} instead of {}",
                d.found, d.expected
            )
        })?;
        write_some(f, "different cameras", &found.moved, |m| {
            let ([baseline, found_m], [rotation, found_deg]) = (m.baseline_m, m.rotation_deg);
            format!(
                "{}: baseline {found_m} m instead of {baseline} m, rotation {found_deg}° instead of {rotation}°",
                m.pair_id
            )
        })?;
        write!(
            f,
            "{}, {}: {} equal, {} without a hash in the list",
            counted(self.pairs, "pair"),
            counted(found.photographs, "photograph"),
            found.equal,
            found.unhashed
        )
    }
}
