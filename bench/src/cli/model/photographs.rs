//! Arguments of `predict`, and the loop over its photographs.

use std::path::{Path, PathBuf};

use anyhow::ensure;
use clap::{Args, ValueEnum};
use serde_json::Value;

use super::args::{ModelArgs, PhotoArgs};
use crate::cli::{Outcome, output};

/// Predict 3D Gaussians from photographs
///
/// Writes a PLY file per photograph as the official release does: metric camera space, OpenCV axes, sRGB colours.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench predict photo.jpg --out photo.ply
  sharp-bench predict holiday/*.jpg --out gaussians/ --plain --depth exr
  sharp-bench predict photo.png --checkpoint mine.pt --config mine.json --focal-px 1200 \\
      --out photo.ply
  sharp-bench predict photo.jpg --depth-only --checkpoint depth_pro.pt --out photo.exr

The focal length sets the metric scale. It is read from --focal-px, else from the photograph's EXIF tags; without either, a
30 mm lens on 35 mm film is assumed, with a warning.

With --depth-only, Depth Pro (github.com/apple/ml-depth-pro) predicts z-depth at the photograph's size. Predictions with its
published checkpoint were never tested. If neither --focal-px nor a 35 mm equivalent in the photograph gives the focal
length, the network estimates it.

Photographs are PNG, JPEG, WebP, TIFF or BMP: colour, grey, palette, 8 or 16 bit, CMYK. Palettes, 16 bit and CMYK are
read with the colours that they represent. The release instead reads palette indices as grey levels, 16 bit as 8 bit,
and amounts of ink as amounts of light. If one of several photographs cannot be read, it is skipped, with exit code 4.")]
pub(crate) struct PredictArgs {
    /// Photographs
    #[arg(required = true, value_name = "IMAGE")]
    pub(super) images: Vec<PathBuf>,
    #[command(flatten)]
    pub(super) model: ModelArgs,
    #[command(flatten)]
    pub(super) photo: PhotoArgs,
    /// A .ply file, or a folder for several photographs; with --depth-only, .exr or .png instead of .ply
    #[arg(long, value_name = "FILE_OR_DIR")]
    pub(super) out: PathBuf,
    /// Omit the PLY elements that SHARP's release adds and that some viewers cannot read
    #[arg(long)]
    pub(super) plain: bool,
    /// Also write the depth of SHARP's two layers next to the PLY
    #[arg(long, value_enum, value_name = "FORM")]
    pub(super) depth: Option<DepthForm>,
    /// Write only depth, predicted by a checkpoint of Depth Pro; files in a folder are .exr unless --depth is given
    #[arg(long, requires = "checkpoint", conflicts_with = "plain")]
    pub(super) depth_only: bool,
    /// Print JSON
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
pub(super) enum DepthForm {
    /// Metres, f32, channels `layer0.Z` and `layer1.Z` in one .exr; with --depth-only, one channel `Z`
    Exr,
    /// Millimetres, 16 bit, one .png per layer; depths beyond 65.534 m become 65535
    Png16,
}

/// Runs `predict` for each photograph with its output, and prints the results as JSON if requested. Fails only if every
/// photograph fails.
pub(super) fn for_each(
    args: &PredictArgs,
    outputs: &[PathBuf],
    predict: impl Fn(&Path, &Path) -> anyhow::Result<Value>,
) -> anyhow::Result<Outcome> {
    let mut results = Vec::new();
    let mut failed = 0;
    for (image, out) in args.images.iter().zip(outputs) {
        match predict(image, out) {
            Ok(predicted) => results.push(predicted),
            // Other photographs may still succeed, so continue.
            Err(error) if args.images.len() > 1 => {
                failed += 1;
                output::remark(format!("error: {error:#}"));
            }
            Err(error) => return Err(error),
        }
    }
    if args.json {
        output::json(&results)?;
    }
    ensure!(!results.is_empty(), "all {failed} photographs failed");
    if failed > 0 {
        output::remark(format!(
            "{failed} of {} photographs failed",
            args.images.len()
        ));
    }
    Ok(Outcome::of_problems(failed > 0))
}

/// Paths in `folder` named after the photographs, with the given extension. Fails if two are equal.
pub(super) fn named_after(
    images: &[PathBuf],
    folder: &Path,
    extension: &str,
) -> anyhow::Result<Vec<PathBuf>> {
    let mut outputs = Vec::with_capacity(images.len());
    for image in images {
        // A path without a file name is a folder, which fails later when it is read as a photograph, so any name will
        // do.
        let mut name = image.file_stem().unwrap_or(image.as_os_str()).to_owned();
        name.push(format!(".{extension}"));
        let file = folder.join(name);
        ensure!(
            !outputs.contains(&file),
            "{}: two photographs have the same name, so both would be written here",
            file.display()
        );
        outputs.push(file);
    }
    Ok(outputs)
}
