//! `pairs import`: converts a published pair list to the format of `pairs`.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::super::data_args::DatasetArgs;
use super::super::{Outcome, output};
use crate::io::atomic_files::write_over_own;
use crate::io::counts::counted;
use crate::pairs::foreign::{Context, ForeignList, ListForm, TargetSlot};
use crate::pairs::pair_list::LIST_MARK;
use crate::pairs::provenance::ListCompanion;
use crate::pairs::{DatasetConfig, clap_dataset};

/// Count or convert a published list of pairs
///
/// With --dataset, the list is matched with the dataset's scenes and views, and written to --out as a list for `run
/// --pairs`. Scenes that the dataset does not have are left out, and the exit code is 4. Without --out, the pairs are
/// only counted.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench pairs import evaluation_index_re10k.json --form index       # counts the pairs
  sharp-bench pairs import theirs.json --form index --context nearest \\
      --dataset colmap=data --out pairs.csv
  sharp-bench run --protocol pixelsplat --pairs pairs.csv --dataset colmap=data --method copy \\
      --out runs/theirs")]
pub(super) struct ImportArgs {
    /// The published list
    #[arg(value_name = "FILE")]
    list: PathBuf,
    /// The list's format
    #[arg(long, value_enum, value_name = "FORM")]
    form: ListForm,
    /// Which of several input views is the source
    #[arg(long, value_enum, value_name = "WHICH", default_value_t)]
    context: Context,
    /// Which target to take from each line of Flash3D's and MINE's lists
    #[arg(long, value_enum, value_name = "WHICH", default_value_t)]
    slot: TargetSlot,
    /// A dataset, [NAME:]FORMAT=PATH[,key=value…]; repeatable
    #[arg(long = "dataset", value_name = "SPEC", value_parser = clap_dataset)]
    datasets: Vec<DatasetConfig>,
    /// Only scenes whose id matches this pattern; `*` and `?` are wildcards
    #[arg(long, value_name = "GLOB", requires = "datasets")]
    scenes: Option<String>,
    /// Write the pairs found in the datasets to this file, for `run --pairs`
    #[arg(long, value_name = "FILE", requires = "datasets")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Maximum number of missing scenes named.
const NAMED: usize = 5;

pub(super) fn execute(args: &ImportArgs) -> anyhow::Result<Outcome> {
    let list = ForeignList::read(&args.list, args.form)?;
    let counts = list.counts();
    let mut outcome = Outcome::Done;
    let entry = match args.form {
        ListForm::Index | ListForm::Seva => "scene",
        ListForm::Flash3d | ListForm::Mine | ListForm::Unisharp => "line",
    };
    let mut value = json!({"list": args.list.display().to_string(), "counts": counts});
    let mut summary = format!(
        "{}, {} with targets: {} in all, {} of which are also inputs",
        counted(counts.entries, entry),
        counts.with_pairs,
        counted(counts.targets, "target"),
        counts.targets_that_are_inputs
    );
    if !args.datasets.is_empty() {
        let datasets = DatasetArgs {
            datasets: args.datasets.clone(),
            scenes: args.scenes.clone(),
        };
        let datasets = datasets.open()?;
        let imported = list.import(args.context, args.slot, &datasets)?;
        if !imported.absent.is_empty() {
            let named: Vec<&str> = imported
                .absent
                .iter()
                .take(NAMED)
                .map(String::as_str)
                .collect();
            output::remark(format!(
                "warning: the datasets do not have {} of the list, such as {}",
                counted(imported.absent.len(), "scene"),
                named.join(", ")
            ));
            outcome = Outcome::RecordedFailures;
        }
        if imported.repeated > 0 {
            output::remark(format!(
                "note: the list repeats {}, which {} kept once",
                counted(imported.repeated, "pair"),
                if imported.repeated == 1 { "is" } else { "are" }
            ));
        }
        let pairs = imported.pairs.len();
        summary += &format!("; {} found in the datasets", counted(pairs, "pair"));
        let (absent, repeated) = (imported.absent.clone(), imported.repeated);
        let ours = imported.list(args.out.as_deref().unwrap_or(&args.list));
        if let Some(out) = &args.out {
            write_over_own(out, ours.bytes(), LIST_MARK)?;
            ListCompanion::remove(out)?;
        }
        value["absent"] = json!(absent);
        value["repeated"] = json!(repeated);
        value["pairs"] = json!(pairs);
        value["sha256"] = json!(ours.sha256);
        if let Some(out) = &args.out {
            value["out"] = json!(out.display().to_string());
        }
    }
    output::print(args.json, || value, || summary)?;
    Ok(outcome)
}
