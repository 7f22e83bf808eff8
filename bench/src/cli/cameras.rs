//! `cameras export`: writes views to files.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::json;
use sharp_datasets::Scene;

use super::data_args::DatasetArgs;
use super::output::Terminal;
use super::{Outcome, output};
use crate::export::cameras;
use crate::io::counts::counted;

/// Write views as files: pictures and cameras
#[derive(Debug, Args)]
pub(super) struct CamerasArgs {
    #[command(subcommand)]
    command: CamerasCommand,
}

#[derive(Debug, Subcommand)]
enum CamerasCommand {
    Export(CamerasExportArgs),
}

/// Write every view's picture and camera: OUT/<dataset>/<scene>/<view>.png and .json
///
/// For programs that work on views instead of pairs, such as those that predict depth for `--overlap-depth`,
/// reconstruct a scene, or fit Gaussians. The pictures are exactly those that `run` scores: undistorted and resized.
/// Names are percent-encoded as in pair ids.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  sharp-bench cameras export --dataset eth3d=data/eth3d --out views"
)]
struct CamerasExportArgs {
    #[command(flatten)]
    datasets: DatasetArgs,
    /// The folder to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &CamerasArgs) -> anyhow::Result<Outcome> {
    let CamerasCommand::Export(args) = &args.command;
    let datasets = args.datasets.open()?;
    let outcome = Outcome::Done.with_scenes_of(&datasets);
    let scenes: Vec<Scene> = datasets.into_iter().flat_map(|d| d.scenes).collect();
    let exported = cameras::export(&scenes, &args.out, &Terminal::default())?;
    let (written, kept) = (exported.written, exported.kept);
    let (out, views) = (args.out.display().to_string(), written + kept);
    output::print(
        args.json,
        || json!({"out": out, "views": views, "written": written, "kept": kept}),
        || {
            format!(
                "{} in {out}: {written} written, {kept} kept",
                counted(views, "view")
            )
        },
    )?;
    Ok(outcome)
}
