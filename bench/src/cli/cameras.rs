//! `cameras export`: writes views to files.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde::Serialize;
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
/// For methods that work on views instead of pairs: monocular depth for `--overlap-depth`,
/// reconstructions, Gaussians. The pictures are exactly those that `run` scores: undistorted and
/// resized. Names are percent-encoded as in pair ids.
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

#[derive(Serialize)]
struct ExportedViews {
    out: String,
    views: usize,
    written: usize,
    kept: usize,
}

impl Display for ExportedViews {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            out, written, kept, ..
        } = self;
        let views = counted(self.views, "view");
        write!(f, "{views} in {out}: {written} written, {kept} kept")
    }
}

pub(super) fn execute(args: &CamerasArgs) -> anyhow::Result<Outcome> {
    let CamerasCommand::Export(args) = &args.command;
    let datasets = args.datasets.open()?;
    let outcome = Outcome::Done.with_scenes_of(&datasets);
    let scenes: Vec<Scene> = datasets.into_iter().flat_map(|d| d.scenes).collect();
    let exported = cameras::export(&scenes, &args.out, &Terminal::default())?;
    let exported = ExportedViews {
        out: args.out.display().to_string(),
        views: exported.written + exported.kept,
        written: exported.written,
        kept: exported.kept,
    };
    output::print(&exported, args.json)?;
    Ok(outcome)
}
