//! `render SCENE`: renders a file of Gaussians to pictures, from one view or along a path.

mod args;
mod job;
mod path;
mod writer;

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde::Serialize;
use sharp::ply::ColorSpace;
use sharp::render::{Backend, RenderOutput, Rule};

use self::args::Layers;
use self::job::RenderJob;
use self::path::PathArgs;
use super::reading_args::ReadingArgs;
use super::{Outcome, output};
use crate::config::RenderingConfig;
use crate::config::rendering::{self, LowPass};
use crate::rendering::BatchRenderer;

/// Render 3D Gaussians to a picture, frames or a movie
///
/// SCENE is a file of 3D Gaussians (.ply, .spz, .sog or .splat), or a .safetensors file with `means`, `quats_wxyz`,
/// `scales`, `opacities` and either `colors_linear` or `sh` (harmonics of encoded colours, [N,(degree+1)²,3]). OUT is
/// .png (sRGB, 8 bit), .exr (linear RGB, alpha, accumulated depth) or .safetensors (`rgb_linear` [H,W,3], `alpha`
/// [H,W], `depth_acc` [H,W]). With --rendering or encoded colours, .safetensors has `rgb` instead of `rgb_linear`;
/// `rgb` is in the rule's blending space, composited over the background, and not clamped. If the camera moves, OUT is
/// a folder for PNG frames, a .gif, or an .mp4 (which needs ffmpeg).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench render photo.ply --out view.png
  sharp-bench render photo.ply --camera cam.json --out view.exr
  sharp-bench render photo.ply --trajectory rotate_forward --depth --out photo.mp4
  sharp-bench render photo.ply --trajectory swipe --frames 30 --write-cameras --out frames
  sharp-bench render photo.ply --offset-m 0.05,0,0 --out right.png
  sharp-bench render photo.ply --trajectory rotate_forward --viewer photo.html

cam.json, with pixel centres at +0.5, and both matrices row by row (camera_from_world may be any affine map):
  {\"width\": 640, \"height\": 480, \"K\": [500,0,320, 0,500,240, 0,0,1],
   \"camera_from_world\": [1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1]}

The same command resumes a folder of frames that was stopped. If the GPU is lost or out of memory, a warning
is printed, and the CPU renders the rest.")]
pub(super) struct RenderArgs {
    /// The Gaussians: .ply, .spz, .sog, .splat or .safetensors
    scene: PathBuf,
    #[command(flatten)]
    reading: ReadingArgs,
    /// The camera [default: the camera in the PLY]
    #[arg(long, value_name = "CAM.json")]
    camera: Option<PathBuf>,
    /// Output: .png, .exr, .safetensors, .gif, .mp4, or a folder for frames
    #[arg(long, value_name = "OUT", required_unless_present = "viewer")]
    out: Option<PathBuf>,
    /// Write a self-contained page that renders the Gaussians in a browser (WebGPU). The page has this command's views,
    /// and can show any other view
    #[arg(long, value_name = "OUT.html")]
    viewer: Option<PathBuf>,
    /// The renderer: cpu, wgpu (a GPU through Vulkan, Metal or Direct3D 12), or auto (the first hardware adapter, else
    /// the CPU)
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Auto)]
    backend: Backend,
    /// The GPU to render on, by part of its description (`sharp-bench doctor` lists the GPUs); software adapters are
    /// used only if named
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    #[command(flatten)]
    rendering: RenderingConfig,
    /// Rendering rule: sharp, inria, inria-general, inria-aa, mip-splatting, gsplat-classic, gsplat-antialiased,
    /// gsplat-1.5.3-classic, gsplat-1.5.3-antialiased or brush-mip, optionally with changes, as in inria,near=0.01
    /// [default: the file's, or sharp]
    #[arg(long = "rendering", value_name = "RULE")]
    rule: Option<Rule>,
    /// Drop Gaussians whose centre is nearer than this, metres [default: the rule's; 0.01 for
    /// sharp]
    #[arg(long, value_name = "M")]
    near: Option<f32>,
    /// Drop Gaussians whose centre is farther than this, metres [default: the rule's; 1e10 for
    /// sharp]
    #[arg(long, value_name = "M")]
    far: Option<f32>,
    /// Render like the release's `sharp render`: principal point at ((W-1)/2, (H-1)/2), pictures
    /// higher than 3000 pixels halved, odd sides enlarged by one, truncation to 8 bit
    #[arg(long)]
    release_screen: bool,
    /// Also write expected depth in metres (.depth.exr, channel Z) and inverse depth in turbo colours (.depth.png, or a
    /// movie)
    #[arg(long)]
    depth: bool,
    /// Depths in metres at the ends of the colour scale: NEAR is dark red, FAR dark blue [default: the 0.001 and 0.999
    /// quantiles of all Gaussians in front of the camera]
    #[arg(long, value_name = "NEAR,FAR", requires = "depth", value_parser = args::depth_range)]
    depth_range: Option<[f32; 2]>,
    /// Also write coverage as linear grey levels (.alpha.png, or a movie)
    #[arg(long)]
    alpha: bool,
    /// Render only layer 0 or 1 of SHARP's two layers (the first or second half of the Gaussians), or `all` layers into
    /// separate files
    #[arg(long, value_name = "0|1|all")]
    layer: Option<Layers>,
    #[command(flatten)]
    path: PathArgs,
    /// Frames per second of a GIF (at most 50) or MP4 [default: 30, the release's]
    #[arg(long, value_name = "N", help_heading = "Paths", value_parser = clap::value_parser!(u32).range(1..=240))]
    fps: Option<u32>,
    /// Write the camera of every view, in the format of --camera, next to each picture or frame, or into OUT.cameras
    /// for a movie
    #[arg(long, help_heading = "Paths")]
    write_cameras: bool,
    /// Print JSON: written files, picture sizes, backend, and how many Gaussians were dropped
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Summary {
    /// The output as the user gave it; `None` if only a page was requested.
    out: Option<String>,
    width: u32,
    height: u32,
    gaussians: usize,
    dropped_not_finite: u64,
    #[serde(skip)]
    alpha: f64,
    #[serde(skip)]
    pixels: usize,
    /// Mean over all pixels of all views.
    mean_alpha: f64,
    /// Number of views; rendering a view for several layers counts once per layer.
    views: usize,
    backend: String,
    /// Why `auto` selected this backend; `None` if the user named the backend.
    backend_reason: Option<String>,
    /// Why rendering fell back from a device to the CPU.
    fallback: Option<String>,
    depth_range_m: Option<[f32; 2]>,
    files: Vec<String>,
}

impl RenderArgs {
    /// Whether written arrays contain colours in the rule's blending space, composited over the background, rather than
    /// linear light without a background.
    fn writes_blended(&self, rule: &Rule) -> bool {
        self.rule.is_some() || rule.blending == ColorSpace::Srgb
    }

    /// The rule, with its values replaced by --eps2d, --near and --far if given.
    fn over(&self, mut rule: Rule) -> Rule {
        rule.low_pass = self.rendering.eps2d.map_or(rule.low_pass, |LowPass(x)| x);
        rule.near = self.near.unwrap_or(rule.near);
        rule.far = self.far.unwrap_or(rule.far);
        rule
    }
}

pub(super) fn execute(args: &RenderArgs) -> anyhow::Result<Outcome> {
    let job = RenderJob::prepare(args)?;
    let backend = rendering::backend(&args.backend, args.adapter.as_deref())?;
    let mut renderer = BatchRenderer::open(&backend)?;

    let mut summary = Summary {
        out: args.out.as_ref().map(|out| out.display().to_string()),
        width: job.screen.width,
        height: job.screen.height,
        gaussians: job.scene.len(),
        dropped_not_finite: 0,
        alpha: 0.0,
        pixels: 0,
        mean_alpha: 0.0,
        views: 0,
        backend: renderer.name(),
        backend_reason: renderer.reason().map(str::to_owned),
        fallback: None,
        depth_range_m: job.appearance.depth_m,
        files: Vec::new(),
    };
    let part = |layer| {
        Layers::of(&job.scene, layer).with_context(|| {
            let (scene, n) = (args.scene.display(), job.scene.len());
            format!("{scene}: {n} Gaussians cannot be divided into two layers of equal size")
        })
    };
    if let Some(out) = &job.out {
        match args.layer {
            None => out.render(&job, &mut renderer, (&job.scene, None), &mut summary)?,
            Some(layers) => {
                for layer in layers.indices() {
                    let scene = part(layer)?;
                    out.render(&job, &mut renderer, (&scene, Some(layer)), &mut summary)?;
                }
            }
        }
    }
    if let Some(path) = &args.viewer {
        match args.layer {
            Some(Layers::One(layer)) => {
                job.page(&mut renderer, &part(layer)?, path, &mut summary)?
            }
            None | Some(Layers::All) => job.page(&mut renderer, &job.scene, path, &mut summary)?,
        }
    }
    summary.fallback = renderer.fallback().map(str::to_owned);
    report(args, &summary, &renderer.name())
}

fn report(args: &RenderArgs, summary: &Summary, last_backend: &str) -> anyhow::Result<Outcome> {
    if summary.dropped_not_finite > 0 {
        output::remark(format!(
            "warning: {}: {} Gaussians have values that are not finite and were dropped",
            args.scene.display(),
            summary.dropped_not_finite
        ));
    }
    if let Some(reason) = &summary.fallback {
        output::remark(format!(
            "warning: rendering continued on {last_backend}, because {reason}"
        ));
    }
    output::print(args.json, || summary, || summary.to_string())?;
    Ok(Outcome::Done)
}

impl Display for Summary {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{} (", self.files.join(", "))?;
        if self.views != 1 {
            write!(f, "{} views, ", self.views)?;
        }
        let (width, height) = (self.width, self.height);
        write!(
            f,
            "{width}x{height}, {} Gaussians, {}",
            self.gaussians, self.backend
        )?;
        match &self.backend_reason {
            Some(reason) => write!(f, ": {reason})"),
            None => f.write_str(")"),
        }
    }
}

impl Summary {
    fn add(&mut self, view: &RenderOutput) {
        self.alpha += view.alpha.iter().map(|&a| f64::from(a)).sum::<f64>();
        self.pixels += view.alpha.len();
        self.mean_alpha = self.alpha / self.pixels.max(1) as f64;
        self.dropped_not_finite = self.dropped_not_finite.max(view.dropped.not_finite);
    }
}
