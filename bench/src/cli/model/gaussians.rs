//! `gaussians info` and `gaussians convert`.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;
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
    /// Show counts, histograms of opacity, scale and position, and whether positions can be metres
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
        /// Drop Gaussians with lower opacity, 0..1
        #[arg(long, value_name = "X", default_value_t = 0.0)]
        min_opacity: f32,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum TargetForm {
    /// PLY with only the Gaussians, in the layout of 3D Gaussian Splatting, for any viewer
    Plain,
    /// PLY with the elements that the release adds, without view-dependent colours
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
                // A file that needs a given colour space is SHARP's; mark the result as such.
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
                let says = |rule: &MarkedRule| match rule.is_stated {
                    true => format!("states the rule {}", rule.rule),
                    false => "states no rule".to_owned(),
                };
                // The rule blends linear light, but the result cannot state that its colours are
                // encoded.
                let colors = match made_for.rule == Rule::SHARP {
                    true => ",color_space=srgb",
                    false => "",
                };
                output::remark(format!(
                    "note: {} {}, but {} {}; rendering={}{colors} renders the new file like the old one",
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

/// Checks that a scene fits the release's layout, which has no view-dependent colours and states that colours are
/// sRGB-encoded and blended in linear light.
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

#[derive(Debug, Serialize)]
struct Info {
    gaussians: usize,
    /// Number of Gaussians per layer; `None` unless there are two equal layers, one after the
    /// other, as SHARP writes them.
    per_layer: Option<usize>,
    not_finite: usize,
    /// Number of Gaussians with a zero quaternion.
    zero_quaternions: usize,
    below_visibility: usize,
    /// Encoding of the colours; `None` if the file does not state it.
    color_space: Option<String>,
    /// Degree of the colours' spherical harmonics.
    color_degree: usize,
    is_view_dependent: bool,
    /// The program that wrote the file, if marks or columns reveal it.
    generator: Option<&'static str>,
    /// Marks of the rendering rule that the file was made for.
    marks: Vec<&'static str>,
    image_size: Option<[u32; 2]>,
    focal_px: Option<[f64; 2]>,
    opacity: Option<Distribution>,
    scale: Option<Distribution>,
    x: Option<Distribution>,
    y: Option<Distribution>,
    depth: Option<Distribution>,
    /// Share of Gaussians behind the camera, 0..1. A large share indicates that the axes or the
    /// space differ.
    behind: f64,
    /// Evidence that the file is not in camera space with OpenCV axes and metres.
    implausible: Vec<String>,
    /// Evidence that the file's numbers are encoded differently.
    doubts: Vec<String>,
}

/// Plausible median depths of photographs, in metres.
const PLAUSIBLE_DEPTH: std::ops::RangeInclusive<f64> = 0.1..=1000.0;

fn describe(scene: &GaussianScene) -> Info {
    let Gaussians {
        means,
        quaternions,
        scales,
        opacities,
        ..
    } = &scene.gaussians;
    let n = scene.gaussians.len();
    let along = |axis: usize| Distribution::of(means.iter().map(|m| m[axis]));
    let depth = along(2);
    let behind = means.iter().filter(|m| m[2] <= 0.0).count() as f64 / n.max(1) as f64;
    let median = depth.as_ref().map(|depth| depth.quantiles[3]);
    let mut implausible = Vec::new();
    let visible = (0..n).filter(|&k| {
        let rotation = scene.gaussians.quaternions[k];
        scene.gaussians.is_finite(k) && rotation != [0.0; 4] && opacities[k] >= 1.0 / 255.0
    });
    if visible.count() == 0 {
        implausible.push("nothing in it is visible".to_owned());
    }
    if behind > 0.1 {
        implausible.push(format!(
            "{:.0} % are behind the camera; the axes may be OpenGL's, or the file may not be in camera space",
            100.0 * behind
        ));
    }
    if let Some(median) = median.filter(|z| *z > 0.0 && !PLAUSIBLE_DEPTH.contains(z)) {
        implausible.push(format!(
            "a median depth of {median} is implausible for a photograph in metres"
        ));
    }
    Info {
        gaussians: n,
        per_layer: (scene.version.is_some() && n > 0 && n.is_multiple_of(2)).then_some(n / 2),
        not_finite: (0..n).filter(|&k| !scene.gaussians.is_finite(k)).count(),
        zero_quaternions: quaternions.iter().filter(|q| **q == [0.0; 4]).count(),
        below_visibility: opacities.iter().filter(|&&o| o < 1.0 / 255.0).count(),
        color_space: scene.color_space.map(|space| space.to_string()),
        // 3 ((d + 1)² − 1) coefficients in addition to the constant one.
        color_degree: (scene.color_coefficients / 3 + 1).isqrt() - 1,
        is_view_dependent: scene.is_view_dependent,
        generator: scene.marks.generator.map(generator_name),
        marks: marks_in_words(&scene.marks),
        image_size: scene.intrinsics.map(|k| [k.width, k.height]),
        focal_px: scene.intrinsics.map(|k| [k.fx, k.fy]),
        opacity: Distribution::of(opacities.iter().copied()),
        scale: Distribution::of(scales.iter().flatten().copied()),
        x: along(0),
        y: along(1),
        depth,
        behind,
        implausible,
        doubts: scene.doubts.iter().map(|d| d.text.clone()).collect(),
    }
}

fn generator_name(generator: Generator) -> &'static str {
    match generator {
        Generator::Sharp => "sharp",
        Generator::Brush => "brush",
        Generator::Nerfstudio => "nerfstudio",
        Generator::SplatTransform => "splat-transform",
        Generator::GsplatLike => "gsplat or alike",
        Generator::InriaLike => "Inria's or alike",
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

fn info(ply: &Path, given: &ReadingArgs, json: bool) -> anyhow::Result<Outcome> {
    // The blending space does not affect the output; choose one that accepts every file.
    let reading = StoredForm {
        blending: ColorSpace::Srgb,
        ..given.reading()
    };
    let mut scene = load(ply, reading)?;
    if given.axes.is_some() {
        turn(&mut scene.gaussians, &mut scene.doubts, given.axes).map_err(anyhow::Error::msg)?;
    }
    output::print(&describe(&scene), json)?;
    Ok(Outcome::Done)
}

impl Display for Info {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "Gaussians        {}", self.gaussians)?;
        if let Some(n) = self.per_layer {
            writeln!(f, "per layer        {n} (two layers)")?;
        }
        writeln!(
            f,
            "not finite       {} (the renderer drops them)",
            self.not_finite
        )?;
        writeln!(
            f,
            "quaternion zero  {} (dropped too)",
            self.zero_quaternions
        )?;
        writeln!(
            f,
            "opacity < 1/255  {} (never visible)",
            self.below_visibility
        )?;
        let space = self.color_space.as_deref();
        let view = match self.is_view_dependent {
            true => "depend on the view",
            false => "equal from all sides",
        };
        writeln!(
            f,
            "colours          {}, degree {}, {view}",
            space.unwrap_or("linear or srgb (not stated in the file)"),
            self.color_degree
        )?;
        if let Some(generator) = self.generator {
            writeln!(f, "written by       {generator}")?;
        }
        if !self.marks.is_empty() {
            writeln!(f, "made to be drawn {}", self.marks.join(", "))?;
        }
        if let (Some([w, h]), Some([fx, fy])) = (self.image_size, self.focal_px) {
            writeln!(
                f,
                "photograph       {w}x{h}, focal length {fx:.2} {fy:.2} px"
            )?;
        }
        writeln!(
            f,
            "                 least      10 %      25 %      50 %      75 %      90 %      most",
        )?;
        for (name, distribution) in [
            ("opacity", &self.opacity),
            ("scale (m)", &self.scale),
            ("x (m)", &self.x),
            ("y (m)", &self.y),
            ("depth (m)", &self.depth),
        ] {
            if let Some(Distribution {
                quantiles,
                histogram,
            }) = distribution
            {
                let numbers: String = quantiles.iter().map(|q| format!("{q:>10.4}")).collect();
                writeln!(f, "{name:<12}{numbers}")?;
                writeln!(f, "{:<12}  {}", "", bars(histogram))?;
            }
        }
        let verdict = match self.implausible.is_empty() {
            true => "plausible as the camera's space, OpenCV axes, metres".to_owned(),
            false => self.implausible.join("; "),
        };
        writeln!(f, "space        {verdict}")?;
        for doubt in &self.doubts {
            writeln!(f, "reading      {doubt}")?;
        }
        Ok(())
    }
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
