//! `gaussians info` and `gaussians convert`.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;
use serde_json::{Value, json};
use sharp::gaussian_files::{LARGEST_SPZ_SCALE, MarkedRule, load, to_spz_bytes, turn};
use sharp::gaussians::Gaussians;
use sharp::ply::{
    ColorSpace, FileMarks, GaussianScene, Generator, PlyForm, PlyReason, SplatRenderMode,
    StoredForm, to_bytes, to_compressed_bytes,
};
use sharp::render::Rule;

use crate::cli::reading_args::ReadingArgs;
use crate::cli::{Outcome, output};
use crate::io::atomic_files::write_atomic;

/// Inspect or rewrite a file of Gaussians: PLY, compressed PLY, SPZ, SOG or .splat
#[derive(Debug, Args)]
pub(crate) struct GaussiansArgs {
    #[command(subcommand)]
    command: GaussiansCommand,
}

#[derive(Debug, Subcommand)]
enum GaussiansCommand {
    /// Show counts, histograms of opacity, scale and position, and whether positions are plausible as metres
    /// in camera space
    Info {
        /// The Gaussian file
        ply: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Rewrite a file for other viewers, or without nearly invisible Gaussians
    #[command(
        after_help = "Examples:\n  sharp-bench gaussians convert photo.ply plain.ply --to plain --min-opacity 0.005\n  \
                      sharp-bench gaussians convert scene.spz scene.ply --axes rub"
    )]
    Convert {
        /// The Gaussian file to read
        ply: PathBuf,
        /// The Gaussian file to write
        out: PathBuf,
        /// Output format; axes are OpenCV's, or for SPZ the format's own (rub) [default: by file
        /// name: .spz, .compressed.ply or .ply]
        #[arg(long, value_enum)]
        to: Option<TargetForm>,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Drop Gaussians whose opacity is below X, from 0 to 1
        #[arg(long, value_name = "X", default_value_t = 0.0)]
        min_opacity: f32,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum TargetForm {
    /// PLY with only the Gaussians, in the layout of 3D Gaussian Splatting, for any viewer
    Plain,
    /// PLY with the elements that SHARP's release adds, without view-dependent colours
    Release,
    /// PlayCanvas' compressed PLY
    Compressed,
    /// SPZ 3
    Spz,
}

pub(crate) fn execute(args: &GaussiansArgs) -> anyhow::Result<Outcome> {
    match &args.command {
        GaussiansCommand::Info { ply, reading, json } => info(ply, reading, *json),
        GaussiansCommand::Convert {
            ply,
            out,
            to,
            reading,
            min_opacity,
        } => {
            let to = to.map_or_else(|| TargetForm::of_name(out), Ok)?;
            let given = StoredForm {
                blending: ColorSpace::Srgb,
                ..reading.reading()
            };
            let mut scene = load(ply, given)?;
            turn(&mut scene.gaussians, &mut scene.doubts, reading.axes)
                .map_err(|reason| anyhow::anyhow!("{}: {reason} (--axes)", ply.display()))?;
            for doubt in &scene.doubts {
                output::remark(format!("warning: {}: {}", ply.display(), doubt.text));
            }
            let made_for = MarkedRule::of(&scene.marks);
            if given.color_space.is_some() {
                // Only SHARP's files need --color-space. The user has set it, so this is one of them: mark the result
                // as SHARP's.
                scene.marks.generator = Some(Generator::Sharp);
            }
            if to == TargetForm::Release {
                check_release(&scene, given)
                    .map_err(|reason| anyhow::anyhow!("{}: {reason}", ply.display()))?;
            }
            let outcome = convert(scene, out, to, *min_opacity)?;
            let states = MarkedRule::of(
                &load(
                    out,
                    StoredForm {
                        blending: ColorSpace::Srgb,
                        ..StoredForm::default()
                    },
                )?
                .marks,
            );
            if states.rule != made_for.rule && (states.is_stated || made_for.is_stated) {
                let says = |rule: &MarkedRule| {
                    if rule.is_stated {
                        format!("states the rule {}", rule.rule)
                    } else {
                        "states no rule".to_owned()
                    }
                };
                // SHARP's rule blends linear light. The new file cannot state that its colours are encoded, so the user
                // must set this.
                let colors = if made_for.rule == Rule::SHARP {
                    ",color_space=srgb"
                } else {
                    ""
                };
                output::remark(format!(
                    "note: {} {}, but {} {}; to render the new file like the old one, set rendering={}{colors}",
                    ply.display(),
                    says(&made_for),
                    out.display(),
                    says(&states),
                    made_for.rule
                ));
            }
            Ok(outcome)
        }
    }
}

impl TargetForm {
    /// Determines the format from a file's name.
    fn of_name(path: &Path) -> anyhow::Result<Self> {
        let name = path.to_string_lossy().to_ascii_lowercase();
        for (end, form) in [
            (".spz", Self::Spz),
            (".compressed.ply", Self::Compressed),
            (".ply", Self::Plain),
        ] {
            if name.ends_with(end) {
                return Ok(form);
            }
        }
        anyhow::bail!(
            "{}: unknown output format; use a name that ends in .ply, .compressed.ply or .spz, or \
             set --to",
            path.display()
        )
    }
}

/// Checks that a scene fits the release's layout. That layout has no view-dependent colours, and states that colours
/// are sRGB-encoded and blended in linear light.
fn check_release(scene: &GaussianScene, given: StoredForm) -> Result<(), String> {
    if scene.gaussians.harmonics.degree > 0 {
        return Err(format!(
            "colours depend on the view ({} coefficients f_rest_*), which would be lost; `--read harmonics=drop` \
             keeps only the constant term",
            scene.color_coefficients
        ));
    }
    match scene.color_space.or(given.color_space) {
        Some(_) => Ok(()),
        None => Err(PlyReason::ColorSpaceUnknown.to_string()),
    }
}

/// Distribution of values: quantiles and a histogram.
#[derive(Debug, Serialize)]
struct Distribution {
    /// Smallest, 10 %, 25 %, 50 %, 75 %, 90 % and largest value.
    quantiles: [f64; 7],
    /// Counts in ten bins of equal width from the smallest to the largest value.
    histogram: [usize; 10],
}

impl Distribution {
    fn of(values: impl Iterator<Item = f32>) -> Option<Self> {
        let mut sorted: Vec<f32> = values.filter(|v| v.is_finite()).collect();
        sorted.sort_by(f32::total_cmp);
        let (&low, &high) = (sorted.first()?, sorted.last()?);
        let at = |q: f64| f64::from(sorted[((sorted.len() - 1) as f64 * q).round() as usize]);
        let mut histogram = [0; 10];
        for &value in &sorted {
            let place = 10.0 * (value - low) / (high - low).max(f32::MIN_POSITIVE);
            histogram[(place as usize).min(9)] += 1;
        }
        Some(Self {
            quantiles: [0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0].map(at),
            histogram,
        })
    }
}

/// Plausible median depths of photographs, in metres.
const PLAUSIBLE_DEPTH: std::ops::RangeInclusive<f64> = 0.1..=1000.0;

/// The JSON and the text that describe a scene.
fn describe(scene: &GaussianScene) -> (Value, String) {
    let Gaussians {
        means,
        quaternions,
        scales,
        opacities,
        ..
    } = &scene.gaussians;
    let n = scene.gaussians.len();
    let along = |axis: usize| Distribution::of(means.iter().map(|m| m[axis]));
    let (x, y, depth) = (along(0), along(1), along(2));
    let opacity = Distribution::of(opacities.iter().copied());
    let scale = Distribution::of(scales.iter().flatten().copied());
    // A large share of Gaussians behind the camera indicates that axes or coordinate system were misread.
    let behind = means.iter().filter(|m| m[2] <= 0.0).count() as f64 / n.max(1) as f64;
    let median = depth.as_ref().map(|depth| depth.quantiles[3]);
    // Evidence that the file is not in camera space with OpenCV axes and metres.
    let mut implausible = Vec::new();
    let visible = (0..n).filter(|&k| {
        let rotation = scene.gaussians.quaternions[k];
        scene.gaussians.is_finite(k) && rotation != [0.0; 4] && opacities[k] >= 1.0 / 255.0
    });
    if visible.count() == 0 {
        implausible.push("no Gaussian is visible".to_owned());
    }
    if behind > 0.1 {
        implausible.push(format!(
            "{:.0} % of the Gaussians are behind the camera; the axes may be OpenGL's, or the file may not be in \
             camera space",
            100.0 * behind
        ));
    }
    if let Some(median) = median.filter(|z| *z > 0.0 && !PLAUSIBLE_DEPTH.contains(z)) {
        implausible.push(format!(
            "a median depth of {median} is implausible for a photograph in metres"
        ));
    }
    // SHARP writes two layers with the same number of Gaussians, one after the other.
    let has_layers = scene.version.is_some() && n > 0 && n.is_multiple_of(2);
    let per_layer = has_layers.then_some(n / 2);
    let not_finite = (0..n).filter(|&k| !scene.gaussians.is_finite(k)).count();
    let zero_quaternions = quaternions.iter().filter(|q| **q == [0.0; 4]).count();
    let below_visibility = opacities.iter().filter(|&&o| o < 1.0 / 255.0).count();
    let color_space = scene.color_space.map(|space| space.to_string());
    // 3 ((d + 1)² − 1) coefficients in addition to the constant one.
    let color_degree = (scene.color_coefficients / 3 + 1).isqrt() - 1;
    let generator = scene.marks.generator.map(generator_name);
    let marks = marks_in_words(&scene.marks);
    let doubts: Vec<&str> = scene.doubts.iter().map(|d| d.text.as_str()).collect();

    let mut text = format!("Gaussians        {n}\n");
    if let Some(n) = per_layer {
        text += &format!("per layer        {n} (two layers)\n");
    }
    text += &format!("not finite       {not_finite} (the renderer drops them)\n");
    text += &format!("quaternion zero  {zero_quaternions} (the renderer drops them)\n");
    text += &format!("opacity < 1/255  {below_visibility} (never visible)\n");
    let space = color_space.as_deref();
    let view = if scene.is_view_dependent {
        "depend on the view"
    } else {
        "equal from all sides"
    };
    text += &format!(
        "colours          {}, degree {color_degree}, {view}\n",
        space.unwrap_or("linear or srgb (not stated in the file)")
    );
    if let Some(generator) = generator {
        text += &format!("written by       {generator}\n");
    }
    if !marks.is_empty() {
        text += &format!("made to be drawn {}\n", marks.join(", "));
    }
    if let Some(k) = &scene.intrinsics {
        text += &format!(
            "photograph       {}x{}, focal length {:.2} {:.2} px\n",
            k.width, k.height, k.fx, k.fy
        );
    }
    text += "                 least      10 %      25 %      50 %      75 %      90 %      most\n";
    for (name, distribution) in [
        ("opacity", &opacity),
        ("scale (m)", &scale),
        ("x (m)", &x),
        ("y (m)", &y),
        ("depth (m)", &depth),
    ] {
        if let Some(Distribution {
            quantiles,
            histogram,
        }) = distribution
        {
            let numbers: String = quantiles.iter().map(|q| format!("{q:>10.4}")).collect();
            text += &format!("{name:<12}{numbers}\n{:<12}  {}\n", "", bars(histogram));
        }
    }
    let verdict = if implausible.is_empty() {
        "plausible as metres in the camera's space with OpenCV axes".to_owned()
    } else {
        implausible.join("; ")
    };
    text += &format!("space        {verdict}\n");
    for doubt in &doubts {
        text += &format!("reading      {doubt}\n");
    }
    let value = json!({
        "gaussians": n,
        "per_layer": per_layer,
        "not_finite": not_finite,
        "zero_quaternions": zero_quaternions,
        "below_visibility": below_visibility,
        "color_space": color_space,
        "color_degree": color_degree,
        "is_view_dependent": scene.is_view_dependent,
        "generator": generator,
        "marks": marks,
        "image_size": scene.intrinsics.map(|k| [k.width, k.height]),
        "focal_px": scene.intrinsics.map(|k| [k.fx, k.fy]),
        "opacity": opacity,
        "scale": scale,
        "x": x,
        "y": y,
        "depth": depth,
        "behind": behind,
        "implausible": implausible,
        "doubts": doubts,
    });
    (value, text)
}

fn generator_name(generator: Generator) -> &'static str {
    match generator {
        Generator::Sharp => "sharp",
        Generator::Brush => "brush",
        Generator::Nerfstudio => "nerfstudio",
        Generator::SplatTransform => "splat-transform",
        Generator::GsplatLike => "gsplat or similar",
        Generator::InriaLike => "Inria's or similar",
    }
}

fn marks_in_words(marks: &FileMarks) -> Vec<&'static str> {
    let said = [
        (marks.antialiased == Some(true), "antialiased"),
        (marks.antialiased == Some(false), "not antialiased"),
        (
            marks.mode == Some(SplatRenderMode::Mip),
            "SplatRenderMode: mip",
        ),
        (
            marks.mode == Some(SplatRenderMode::Flat),
            "SplatRenderMode: 2dgs",
        ),
        (marks.has_filter_3d, "filter_3D"),
    ];
    let said = said.into_iter().filter(|(is_said, _)| *is_said);
    said.map(|(_, words)| words).collect()
}

fn info(ply: &Path, given: &ReadingArgs, as_json: bool) -> anyhow::Result<Outcome> {
    // The blending space does not affect the output, so choose the one that can represent every file.
    let reading = StoredForm {
        blending: ColorSpace::Srgb,
        ..given.reading()
    };
    let mut scene = load(ply, reading)?;
    if given.axes.is_some() {
        turn(&mut scene.gaussians, &mut scene.doubts, given.axes).map_err(anyhow::Error::msg)?;
    }
    let (value, text) = describe(&scene);
    output::print(as_json, || value, || text)?;
    Ok(Outcome::Done)
}

fn bars(histogram: &[usize; 10]) -> String {
    const BARS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let most = histogram.iter().copied().max().unwrap_or(0).max(1);
    histogram
        .iter()
        .map(|&count| BARS[(count * 8).div_ceil(most)])
        .collect()
}

fn convert(
    mut scene: GaussianScene,
    out: &Path,
    to: TargetForm,
    min_opacity: f32,
) -> anyhow::Result<Outcome> {
    anyhow::ensure!(
        (0.0..=1.0).contains(&min_opacity),
        "--min-opacity {min_opacity}: expected a number from 0 to 1"
    );
    let before = scene.gaussians.len();
    if min_opacity > 0.0 {
        let opacities = scene.gaussians.opacities.clone();
        scene.gaussians = scene.gaussians.filtered(|k| opacities[k] >= min_opacity);
    }
    let scales = scene.gaussians.scales.as_flattened();
    let clamped = scales.iter().filter(|s| **s > LARGEST_SPZ_SCALE).count();
    if to == TargetForm::Spz && clamped > 0 {
        output::remark(format!(
            "warning: {}: {clamped} standard deviations were clamped to {LARGEST_SPZ_SCALE:.0}, the maximum in SPZ",
            out.display()
        ));
    }
    let (bytes, axes) = match to {
        TargetForm::Plain => (to_bytes(&scene, PlyForm::Plain), ""),
        TargetForm::Release => (to_bytes(&scene, PlyForm::Release), ""),
        TargetForm::Compressed => (to_compressed_bytes(&scene), ""),
        TargetForm::Spz => (to_spz_bytes(&scene)?, ", axes rub"),
    };
    write_atomic(out, &bytes)?;
    output::line(format!(
        "{}  {} of {before} Gaussians{axes}",
        out.display(),
        scene.gaussians.len()
    ))?;
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distributions_count_every_finite_value_once() {
        let values = (0..100).map(|k| k as f32).chain([f32::NAN]);
        let found = Distribution::of(values).unwrap();
        assert_eq!(found.histogram.iter().sum::<usize>(), 100);
        assert_eq!((found.quantiles[0], found.quantiles[6]), (0.0, 99.0));
        assert!(Distribution::of([f32::NAN].into_iter()).is_none());
        let constant = Distribution::of([2.0_f32; 4].into_iter()).unwrap();
        assert_eq!(constant.histogram.iter().sum::<usize>(), 4);
        assert_eq!(bars(&[0, 1, 8, 4, 0, 0, 0, 0, 0, 0]), " ▁█▄      ");
    }
}
