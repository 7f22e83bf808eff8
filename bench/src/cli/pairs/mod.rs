//! `pairs`: builds, compares, checks, exports and imports pair lists.

mod build;
mod compare;
mod export;
mod import;

use clap::{Args, Subcommand};

use super::{Outcome, data_args};
use crate::pairs::PairOptions;

/// Build, compare, check, export and import lists of pairs
///
/// A list is a CSV file with a sha256; it can be published, compared and evaluated with `run --pairs`. If no pair is
/// selected, the list is still written, a warning gives the reason, and the exit code is 4.
#[derive(Debug, Args)]
#[command(after_help = help(), args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct PairsArgs {
    #[command(subcommand)]
    command: Option<PairsCommand>,
    #[command(flatten)]
    build: build::BuildArgs,
}

#[derive(Debug, Subcommand)]
enum PairsCommand {
    Diff(compare::DiffArgs),
    Verify(compare::VerifyArgs),
    Export(export::ExportArgs),
    Import(import::ImportArgs),
}

/// Help on depth that is too sparse for per-pixel overlap.
const SPARSE: &str = "\
Sparse depth (ETH3D, Tanks and Temples): the paper predicts dense depth with Depth Pro and scales it to the sparse depth.
  overlap=given          --overlap-depth DIR, your own depth maps, scaled by the median of ratios as in the paper
  overlap=given-metric   --overlap-depth DIR, your own depth maps in metres, not scaled
  overlap=depth-pro      depth by Depth Pro computed here, scaled as in the paper; the default (auto) on these datasets
                         if depth_pro.pt is in torch's hub folder or in sharp-bench's cache, else ground-truth;
                         --overlap-checkpoint FILE names another file
  overlap=sharp-release  the first depth layer of SHARP's official checkpoint, scaled as in the paper
  overlap=sparse:8       the dataset's sparse depth; a point is seen if a depth within 8 pixels of its projection agrees
None of these uses the method under test. overlap=depth-pro was compared with Depth Pro's code at small size, but never
with its published weights. To use Depth Pro's own code instead (github.com/apple/ml-depth-pro, in its environment and
with its checkpoint):
  sharp-bench cameras export --dataset eth3d=data/eth3d --out views
  for each views/<dataset>/<scene>/<view>.png, in Python:
    image, _, _ = depth_pro.load_rgb(png); f_px = json.load(open(camera))['K'][0]
    depth = model.infer(transform(image), f_px=torch.tensor(f_px))['depth']
    numpy.save(f'depth/<dataset>/<scene>/<view>.npy', depth.cpu().numpy())
  sharp-bench pairs --dataset eth3d=data/eth3d --overlap-depth depth --out pairs.csv
";

fn help() -> String {
    format!(
        "Keys of --pair-options (a value known to differ from the paper is called a proxy in reports):\n{}\n{SPARSE}\n{}\nExamples:\n  \
         sharp-bench pairs --dataset synthetic --out pairs.csv\n  \
         sharp-bench pairs --dataset synthetic --ambiguity\n  \
         sharp-bench pairs diff pairs.csv theirs.csv\n  \
         sharp-bench pairs verify theirs.csv --dataset synthetic\n  \
         sharp-bench pairs import theirs.json --form index --dataset synthetic --out pairs.csv\n  \
         sharp-bench pairs export --pairs pairs.csv --dataset synthetic --out for-others \\\n      \
         --with target,depth",
        PairOptions::help(),
        data_args::formats_help()
    )
}

pub(super) fn execute(args: &PairsArgs) -> anyhow::Result<Outcome> {
    match &args.command {
        None => build::execute(&args.build),
        Some(PairsCommand::Diff(args)) => compare::diff(args),
        Some(PairsCommand::Verify(args)) => compare::verify(args),
        Some(PairsCommand::Export(args)) => export::execute(args),
        Some(PairsCommand::Import(args)) => import::execute(args),
    }
}
