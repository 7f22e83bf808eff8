//! `parity`: compares a network with a recording stage by stage, or the Gaussians of a port of SHARP with those of
//! sharp-bench.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;
use glam::DAffine3;
use serde::Serialize;
use serde_json::json;
use sharp::camera::Intrinsics;
use sharp::gaussian_files::turn;
use sharp::gaussians::Gaussians;
use sharp::model::Silent;
use sharp::model::recording::{Recording, StageComparison, compare};
use sharp::ply::ColorSpace;
use sharp::render::Rule;
use sharp::unprojection::{release_intrinsics, unproject};
use sharp_metrics::Picture;
use sharp_metrics::psnr::psnr;

use super::args::{ModelArgs, PhotoArgs};
use crate::analyze::port::{self, FieldDifference, PortComparison};
use crate::cli::reading_args::ReadingArgs;
use crate::cli::{Outcome, output};
use crate::io::gaussian_files;
use crate::pictures::keyed_scores::json_number;
use crate::rendering::SharedRenderer;

/// Compare a network's intermediate values with those that `record` saved, stage by stage, and report the first stage
/// that diverges; or compare the Gaussians of a port of SHARP with those of sharp-bench
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  sharp-bench parity --checkpoint tiny_model.pt --config tiny_config.json#tiny \\
      --image main_640x480.png --focal-px 500 --golden golden_tiny.safetensors

The error of a stage is its largest difference divided by its largest absolute value. The exit code is 1 if an error
exceeds --tolerance, or if a stage was not computed (its error is then \"inf\", also in --json).

To trace a change of the full network, run `record` before the change and `parity` after it. The comparison with the
recordings of the official network at full size is a test: cargo test --release -p sharp-tests --test golden_model --
--ignored --test-threads=1

A port of SHARP to another framework is compared by its output, a PLY for the same photograph. The first command compares
the port with a PLY of the release or of `predict`, the second command with a new prediction by the network:
  sharp-bench parity --port theirs.ply --against photo.ply
  sharp-bench parity --port theirs.ply --image photo.jpg

For each attribute, the output shows the median, the 99th percentile and the maximum of the differences between Gaussians,
and settings (axes, order, encodings) that explain large differences. The exit code is 1 if a 99th percentile exceeds
--tolerance, in pixels or per cent.")]
pub(crate) struct ParityArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// The photograph that `record` (--golden) or the port (--port) was given
    #[arg(long, value_name = "IMG", required_unless_present = "against")]
    image: Option<PathBuf>,
    #[command(flatten)]
    photo: PhotoArgs,
    /// Compare with this recording, a file written by `record`
    #[arg(long, value_name = "REC.safetensors", required_unless_present = "port")]
    golden: Option<PathBuf>,
    /// Compare this file of a port's Gaussians, in any format; --color-space, --read and --axes describe the file
    #[arg(long, value_name = "FILE", conflicts_with = "golden")]
    port: Option<PathBuf>,
    /// Compare --port with this PLY, predicted from the same photograph by the release or by `predict` [default:
    /// the network's prediction from --image]
    #[arg(long, value_name = "PLY", requires = "port")]
    against: Option<PathBuf>,
    #[command(flatten)]
    reading: ReadingArgs,
    /// Name of the recording within the --golden file [default: the recording of the photograph]
    #[arg(long, value_name = "P")]
    prefix: Option<String>,
    /// Largest acceptable error [default: 1e-4 for a stage, 0.5 pixels or per cent for a port]
    #[arg(long, value_name = "X")]
    tolerance: Option<f64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn execute(args: &ParityArgs) -> anyhow::Result<Outcome> {
    match (&args.port, &args.golden, &args.image) {
        (Some(port), ..) => of_port(args, port),
        (None, Some(golden), Some(image)) => of_stages(args, golden, image),
        _ => bail!("give --golden and --image, or --port"),
    }
}

/// The Gaussians to compare --port with, and the photograph's camera.
fn reference(args: &ParityArgs) -> anyhow::Result<(Gaussians, Intrinsics)> {
    match (&args.against, &args.image) {
        (Some(path), _) => {
            let file = gaussian_files::read(path, Some(ColorSpace::Srgb), Some(Rule::SHARP))?;
            let Some((intrinsics, _)) = file.camera else {
                bail!(
                    "{}: no camera in the file; use a PLY written by the release, or by `predict` without --plain",
                    path.display()
                );
            };
            Ok((file.gaussians, intrinsics))
        }
        (None, Some(image)) => {
            let photo = args.photo.load(image)?;
            let factor = photo.disparity_factor();
            let predictor = args.model.load()?;
            let predicted = predictor.predict(photo.planes(), factor, &mut Silent)?;
            let (width, height) = (photo.width as u32, photo.height as u32);
            let intrinsics = release_intrinsics(photo.focal_px, width, height)?;
            Ok((unproject(&predicted.gaussians, &intrinsics), intrinsics))
        }
        (None, None) => bail!("give --against or --image"),
    }
}

#[derive(Serialize)]
struct PortParity {
    #[serde(flatten)]
    differences: PortComparison,
    /// PSNR between the renderings of port and reference in the photograph's camera, dB; `null` if they are equal.
    rendered_psnr: Option<f64>,
    #[serde(skip)]
    psnr: f64,
    /// Numbers of Gaussians: of the port, and of the reference.
    #[serde(skip)]
    counts: [usize; 2],
}

impl PortParity {
    /// Settings (`key=value,…`) under which the port's file agrees better with the reference.
    fn settings(&self) -> String {
        let settings = self.differences.settings.iter();
        let settings: Vec<String> = settings.map(|(k, v)| format!("{k}={v}")).collect();
        settings.join(",")
    }
}

impl Display for PortParity {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let PortComparison {
            order,
            extra,
            missing,
            not_finite,
            as_read,
            with_settings,
            ..
        } = &self.differences;
        let [port, reference] = self.counts;
        writeln!(
            f,
            "{port} Gaussians ({reference} in the reference), in {order}; {extra} extra, {missing} missing, \
             {not_finite} not finite"
        )?;
        writeln!(
            f,
            "{:<24} {:>11} {:>11} {:>11}",
            "", "median", "99 %", "largest"
        )?;
        let write = |f: &mut Formatter<'_>, fields: &[FieldDifference]| {
            fields.iter().try_for_each(|field| {
                let name = format!("{}, {}", field.field, field.unit);
                let FieldDifference {
                    median,
                    p99,
                    largest,
                    ..
                } = field;
                writeln!(f, "{name:<24} {median:>11.3} {p99:>11.3} {largest:>11.3}")
            })
        };
        write(f, as_read)?;
        let settings = self.settings();
        if !settings.is_empty() {
            writeln!(f, "with {settings}:")?;
            write(f, with_settings)?;
        }
        write!(
            f,
            "PSNR between port and reference, rendered from the photograph's camera: {:.2} dB",
            self.psnr
        )
    }
}

fn of_port(args: &ParityArgs, path: &Path) -> anyhow::Result<Outcome> {
    let mut stored = args.reading.reading();
    stored.color_space = stored.color_space.or(Some(ColorSpace::Srgb));
    let mut file = gaussian_files::read(path, stored, Some(Rule::SHARP))?;
    turn(&mut file.gaussians, &mut file.doubts, args.reading.axes)
        .map_err(|reason| anyhow::anyhow!("{}: {reason} (--axes)", path.display()))?;
    let (reference, intrinsics) = reference(args)?;
    let differences = port::compare(&file.gaussians, file.reading, &reference, intrinsics);
    let renderer = SharedRenderer::cpu();
    let picture = |gaussians: &Gaussians| {
        let output = renderer.render(gaussians, DAffine3::IDENTITY, intrinsics, None)?;
        anyhow::Ok(Picture::Rgb8(renderer.picture(&output)))
    };
    let psnr = psnr(&picture(&file.gaussians)?, &picture(&reference)?, None)?;
    let found = PortParity {
        differences,
        rendered_psnr: psnr.is_finite().then_some(psnr),
        psnr,
        counts: [file.gaussians.len(), reference.len()],
    };
    let tolerance = args.tolerance.unwrap_or(0.5);
    output::print(args.json, || &found, || found.to_string())?;
    let settings = found.settings();
    let PortComparison {
        extra,
        missing,
        not_finite,
        as_read,
        ..
    } = &found.differences;
    let beyond = as_read
        .iter()
        .filter(|f| f.p99.is_nan() || f.p99 > tolerance);
    let beyond: Vec<String> = beyond
        .map(|f| format!("{} {:.3} {}", f.field, f.p99, f.unit))
        .collect();
    let counts = [
        (*extra, "Gaussians without a counterpart in the reference"),
        (*missing, "Gaussians missing"),
        (*not_finite, "Gaussians not finite"),
    ];
    let counts = counts.into_iter().filter(|(count, _)| *count > 0);
    let counted: Vec<String> = counts
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    if !counted.is_empty() {
        bail!("{}: {}", path.display(), counted.join(", "));
    }
    if !beyond.is_empty() {
        let explained = if settings.is_empty() {
            String::new()
        } else {
            format!("; `{settings}` explains most of the difference")
        };
        bail!(
            "{}: differs by more than {tolerance} at the 99th percentile ({}){explained}",
            path.display(),
            beyond.join(", ")
        );
    }
    Ok(Outcome::Done)
}

fn of_stages(args: &ParityArgs, golden: &Path, image: &Path) -> anyhow::Result<Outcome> {
    let tolerance = args.tolerance.unwrap_or(1e-4);
    let recording = Recording::open(golden)?;
    let prefix = match &args.prefix {
        Some(prefix) => prefix.as_str(),
        None => recording.prefix_for(image)?,
    };
    let photo = args.photo.load(image)?;
    let predictor = args.model.load()?;
    let comparison = compare(
        &predictor,
        photo.planes(),
        photo.focal_px,
        &recording,
        prefix,
    )?;
    let first = comparison.first_divergence(tolerance);
    let value = || {
        let stages = comparison.stages.iter().map(|found| {
            let error = json_number(found.rel_error);
            json!({"stage": found.stage, "rel_error": error, "values": found.values})
        });
        let first = first.map(|stage| stage.stage.as_str());
        json!({"stages": stages.collect::<Vec<_>>(), "first_divergence": first})
    };
    output::print(args.json, value, || {
        let lines = comparison.stages.iter().map(|found| {
            let StageComparison {
                stage,
                rel_error,
                values,
                ..
            } = found;
            let mark = if *rel_error <= tolerance { ' ' } else { '!' };
            let note = found.note.as_deref().unwrap_or_default();
            format!("{mark} {stage:<36} {rel_error:>10.2e}  {values:>9} values {note}\n")
        });
        lines.collect()
    })?;
    if let Some(stage) = first {
        let note = stage.note.as_ref();
        bail!(
            "{}: diverges first at stage {}, by {:.2e} (tolerance {:.1e}){}",
            golden.display(),
            stage.stage,
            stage.rel_error,
            tolerance,
            note.map_or_else(String::new, |note| format!("; {note}"))
        );
    }
    if !args.json {
        let stages = comparison.stages.len();
        output::line(format!("all {stages} stages within {tolerance:.1e}"))?;
    }
    Ok(Outcome::Done)
}
