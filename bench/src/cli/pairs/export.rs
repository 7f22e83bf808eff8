//! `pairs export`: writes everything that an external method needs to files.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;
use sharp_datasets::Scene;

use super::super::data_args::DatasetArgs;
use super::super::outcome::UsageError;
use super::super::output::Terminal;
use super::super::{Outcome, output};
use crate::export::pairs;
use crate::io::atomic_files::write_atomic;
use crate::io::counts::counted;
use crate::methods::sweep_scales;
use crate::pairs::PairList;
use crate::pairs::sampling::spread;

/// Write each pair's source picture exactly as `run` uses it, the pair's cameras and conventions, and the
/// file name for the prediction
///
/// Writes OUT/<pair_id>/source.png and pair.json (K_s, K_t, target_from_source, picture sizes, conventions, the
/// prediction's file name). The same command continues a stopped export and rewrites files of a changed dataset.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  sharp-bench pairs --dataset middlebury=data/Middlebury2014 --out pairs.csv
  sharp-bench pairs export --pairs pairs.csv --dataset middlebury=data/Middlebury2014 --out for-mine
  (predict each for-mine/<pair_id>/source.png into predictions/<pair_id>.png)
  sharp-bench run --pairs pairs.csv --dataset middlebury=data/Middlebury2014 \\
      --method imported:label=mine,dir=predictions --out runs/mine")]
pub(super) struct ExportArgs {
    /// The list, CSV as written by `pairs`; only selected pairs are written
    #[arg(long, value_name = "FILE")]
    pairs: PathBuf,
    #[command(flatten)]
    datasets: DatasetArgs,
    /// Also write pairs that are not selected
    #[arg(long)]
    all: bool,
    /// Write at most N pairs, the same ones that `run --limit` evaluates
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// Also write the ground truth, or the depth of both views (.npy, metres) if the dataset has depth
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    with: Vec<More>,
    /// Also write cameras whose translation is multiplied by each of these factors, such as 0.5,1,2; for methods
    /// without metric scale
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    scales: Vec<String>,
    /// The folder to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum More {
    /// target.png
    Target,
    /// source_depth.npy and target_depth.npy
    Depth,
}

pub(super) fn execute(args: &ExportArgs) -> anyhow::Result<Outcome> {
    let list = PairList::read(&args.pairs)?;
    let datasets = args.datasets.open()?;
    let readings = datasets
        .iter()
        .map(|dataset| (dataset.name.clone(), dataset.readings_text()))
        .collect();
    let scenes: Vec<Scene> = datasets.into_iter().flat_map(|d| d.scenes).collect();
    let mut pairs = list.resolve(&scenes)?;
    anyhow::ensure!(
        !pairs.is_empty(),
        "{}: the list has no pairs",
        list.path.display()
    );
    pairs.retain(|resolved| args.all || resolved.pair.selected);
    pairs.sort_by(|a, b| a.pair.pair_id.cmp(&b.pair.pair_id));
    if let Some(limit) = args.limit {
        pairs = spread(&pairs, limit);
    }
    anyhow::ensure!(
        !pairs.is_empty(),
        "{}: no pair of the list is marked as selected; add --all to export pairs that are not selected",
        list.path.display()
    );
    let found = list.verify(&scenes);
    if let Some(first) = found.different.first() {
        output::remark(format!(
            "warning: {} changed since the list was made, such as {}/{}/{}",
            counted(found.different.len(), "photograph"),
            first.dataset,
            first.scene,
            first.view
        ));
    }
    let options = pairs::ExportOptions {
        target: args.with.contains(&More::Target),
        depth: args.with.contains(&More::Depth),
        readings,
        scales: sweep_scales(&args.scales)
            .map_err(|reason| UsageError(format!("--scales {reason}")))?,
    };
    let exported = pairs::export(&pairs, &args.out, &options, &Terminal::default())?;
    let copy = args.out.join("pairs.csv");
    write_atomic(&copy, list.bytes())?;
    if exported.without_depth > 0 {
        output::remark(format!(
            "warning: the dataset has no depth for {}; each pair.json lists the files that its pair has",
            counted(exported.without_depth, "view")
        ));
    }
    let pairs::Exported { written, kept, .. } = exported;
    let shown = ExportedPairs {
        out: args.out.display().to_string(),
        pairs: pairs.len(),
        exported,
        list: copy.display().to_string(),
        sha256: &list.sha256,
    };
    output::print(
        args.json,
        || &shown,
        || {
            let (pairs, out) = (counted(shown.pairs, "pair"), &shown.out);
            format!("{pairs} in {out}: {written} written, {kept} kept")
        },
    )?;
    Ok(Outcome::Done)
}

#[derive(Serialize)]
struct ExportedPairs<'a> {
    out: String,
    pairs: usize,
    #[serde(flatten)]
    exported: pairs::Exported,
    list: String,
    sha256: &'a str,
}
