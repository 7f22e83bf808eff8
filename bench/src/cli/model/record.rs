//! `record`: writes every stage of a prediction to a file.

use std::path::PathBuf;

use clap::Args;
use sharp::model::recording::{self, RecordOptions};

use super::args::{ModelArgs, PhotoArgs};
use crate::cli::{Outcome, output};

/// Write the values of every stage of a network's prediction to a file, with which `parity` compares another network
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  sharp-bench record --checkpoint before.pt --image photo.png --out before.safetensors
  sharp-bench parity --checkpoint after.pt --image photo.png --golden before.safetensors

Small stages are written whole. Of large stages, 512 values are written, at positions that depend only on the stage's
name.")]
pub(crate) struct RecordArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// The photograph
    #[arg(long, value_name = "IMG")]
    image: PathBuf,
    #[command(flatten)]
    photo: PhotoArgs,
    /// Name of the recording within the --out file [default: the photograph's stem]
    #[arg(long, value_name = "P")]
    prefix: Option<String>,
    /// Write stages of at most N values whole, and 512 values of larger ones [default: 65536]
    #[arg(long, value_name = "N")]
    whole_up_to: Option<usize>,
    /// File to write
    #[arg(long, value_name = "REC.safetensors")]
    out: PathBuf,
}

pub(crate) fn execute(args: &RecordArgs) -> anyhow::Result<Outcome> {
    let photo = args.photo.load(&args.image)?;
    let predictor = args.model.load()?;
    let stem = args.image.file_stem();
    let mut options = RecordOptions {
        prefix: args.prefix.clone().unwrap_or_else(|| {
            stem.map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
        }),
        ..RecordOptions::default()
    };
    if let Some(values) = args.whole_up_to {
        options.whole_up_to = values;
    }
    options
        .metadata
        .insert("image_file".to_owned(), args.image.display().to_string());
    recording::record(
        &predictor,
        photo.planes(),
        photo.focal_px,
        &options,
        &args.out,
    )?;
    output::line(args.out.display().to_string())?;
    Ok(Outcome::Done)
}
