//! `render SCENE`: Gaussians from a file to pictures: a view, or a path.

mod args;
mod frames;
mod path;
mod target;

use std::path::PathBuf;
use std::sync::mpsc::sync_channel;

use anyhow::{Context, bail, ensure};
use clap::Args;
use glam::DAffine3;
use serde::Serialize;
use serde_json::{Value, json};
use sharp::camera::Intrinsics;
use sharp::color::Quantization;
use sharp::gaussians::Gaussians;
use sharp::render::trajectory::DepthRange;
use sharp::render::{Backend, Background, RenderError, RenderOutput, RenderView, release_screen};

use self::args::{BackgroundArg, Eps2d, Layers, Quantise, Range};
use self::path::PathArgs;
use self::target::{Form, Look, Target};
use super::{Outcome, backend_args, output, progress};
use crate::durable::file_sha256;
use crate::exchange::camera_file::CameraFile;
use crate::rendering::BatchRenderer;
use crate::runs::unit::SOURCE_FINGERPRINT;
use crate::scene_file;

/// Render 3D Gaussians to a picture, frames or a movie
///
/// SCENE is a .ply file (SHARP's own or a plain 3D Gaussian one) or a .safetensors file with `means`, `quats_wxyz`,
/// `scales`, `opacities` and `colors_linear`. OUT is .png (sRGB, 8 bit), .exr (linear RGB, alpha, accumulated depth),
/// .safetensors (`rgb_linear` [H,W,3], `alpha` [H,W], `depth_acc` [H,W]); for a moved camera a folder of PNG frames,
/// .gif, or .mp4 (through an installed ffmpeg).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench render photo.ply --out view.png
  sharp-bench render photo.ply --camera cam.json --out view.exr
  sharp-bench render photo.ply --trajectory rotate_forward --depth --out photo.mp4
  sharp-bench render photo.ply --trajectory swipe --frames 30 --write-cameras --out frames
  sharp-bench render photo.ply --offset-m 0.05,0,0 --layer all --out right.png

cam.json, pixel centres at +0.5, camera_from_world any affine map, both row by row:
  {\"width\": 640, \"height\": 480, \"K\": [500,0,320, 0,500,240, 0,0,1],
   \"camera_from_world\": [1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1]}

A folder of frames that was stopped goes on where it was with the same command. A GPU that is lost or out of memory is
given up: the CPU goes on, and the command says so.")]
pub(super) struct RenderArgs {
    /// The Gaussians: .ply or .safetensors
    scene: PathBuf,
    /// The camera; without it, the one stored in the PLY
    #[arg(long, value_name = "CAM.json")]
    camera: Option<PathBuf>,
    /// Where to write: .png, .exr, .safetensors, .gif, .mp4, or a folder for frames
    #[arg(long, value_name = "OUT")]
    out: PathBuf,
    /// Who renders: cpu, wgpu (a GPU through Vulkan, Metal or Direct3D 12), or auto (the first hardware adapter, else
    /// the CPU)
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Auto)]
    backend: Backend,
    /// The GPU, by a part of its description (`sharp-bench doctor` lists them); a software one is used only when named
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Low-pass added to both variances of a projected Gaussian: release (0), config (0.01), gsplat (0.3; also 3dgs),
    /// or square pixels
    #[arg(long, value_name = "X", default_value = "release")]
    eps2d: Eps2d,
    /// Drop Gaussians whose centre is nearer, metres
    #[arg(long, value_name = "M", default_value_t = RenderView::NEAR)]
    near: f32,
    /// Drop Gaussians whose centre is farther, metres
    #[arg(long, value_name = "M", default_value_t = RenderView::FAR)]
    far: f32,
    /// Behind the Gaussians: black, white, #RRGGBB (sRGB), or R,G,B in linear light; blended in linear light
    /// [default: black]
    #[arg(long, value_name = "COLOUR")]
    background: Option<BackgroundArg>,
    /// From 0..1 to 8 bit [default: round]
    #[arg(long, alias = "quantize", value_enum, value_name = "RULE")]
    quantise: Option<Quantise>,
    /// The screen of the release's `sharp render`: principal point at ((W-1)/2, (H-1)/2), pictures higher than 3000
    /// pixels halved, odd sides one larger, truncation to 8 bit
    #[arg(long)]
    release_screen: bool,
    /// Write depth too: expected depth in metres (.depth.exr, channel Z) and inverse depth in turbo colours
    /// (.depth.png); beside a movie, a movie of the colours
    #[arg(long)]
    depth: bool,
    /// Ends of the depth colours, metres: dark red and dark blue [default: the 0.001 and 0.999 quantiles of the depth of
    /// all Gaussians in front of the camera]
    #[arg(long, value_name = "NEAR,FAR", requires = "depth")]
    depth_range: Option<Range>,
    /// Write coverage too, as linear grey levels (.alpha.png, or a movie)
    #[arg(long)]
    alpha: bool,
    /// Render one of SHARP's two layers alone, by index: the first or second half of the Gaussians; `all`: each, into
    /// files of its own
    #[arg(long, value_name = "0|1|all")]
    layer: Option<Layers>,
    #[command(flatten)]
    path: PathArgs,
    /// Frames a second of a GIF (at most 50) or MP4 [default: 30, the release's]
    #[arg(long, value_name = "N", help_heading = "Paths", value_parser = clap::value_parser!(u32).range(1..=240))]
    fps: Option<u32>,
    /// Write the camera of every view, as --camera reads it: beside a picture or frame, for a movie into OUT.cameras
    #[arg(long, help_heading = "Paths")]
    write_cameras: bool,
    /// Print JSON: files, sizes, backend, and how many Gaussians were dropped
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    out: String,
    width: u32,
    height: u32,
    gaussians: usize,
    dropped_not_finite: u64,
    /// Over all pixels of all views rendered now.
    mean_alpha: f64,
    /// Views, layers counted apart.
    views: usize,
    /// Views that were there from an earlier start.
    reused: usize,
    backend: String,
    /// Why this backend, where the choice was `auto`.
    backend_reason: Option<String>,
    /// Why the CPU took over from a device.
    fallback: Option<String>,
    /// The ends of the depth colours.
    depth_range_m: Option<[f32; 2]>,
    files: Vec<String>,
}

pub(super) fn execute(args: &RenderArgs) -> anyhow::Result<Outcome> {
    let form = Form::of(&args.out)?;
    let job = Job::prepare(args, form)?;
    let backend = backend_args::chosen(&args.backend, args.adapter.as_deref())?;
    let mut renderer = BatchRenderer::open(&backend)?;

    let mut summary = Summary {
        out: args.out.display().to_string(),
        width: job.screen.width,
        height: job.screen.height,
        gaussians: job.scene.len(),
        dropped_not_finite: 0,
        mean_alpha: 0.0,
        views: 0,
        reused: 0,
        backend: renderer.name(),
        backend_reason: renderer.reason().map(str::to_owned),
        fallback: None,
        depth_range_m: job.look.depth_m,
        files: Vec::new(),
    };
    let mut seen = Seen::default();
    match args.layer {
        None => job.render(&mut renderer, (&job.scene, None), &mut seen, &mut summary)?,
        Some(layers) => {
            for layer in layers.indices() {
                let part = Layers::of(&job.scene, layer).with_context(|| {
                    format!(
                        "{}: {} Gaussians are no two layers of equal size",
                        args.scene.display(),
                        job.scene.len()
                    )
                })?;
                job.render(&mut renderer, (&part, Some(layer)), &mut seen, &mut summary)?;
            }
        }
    }
    summary.dropped_not_finite = seen.dropped_not_finite;
    summary.mean_alpha = seen.alpha / seen.pixels.max(1) as f64;
    summary.fallback = renderer.fallback().map(|fallback| fallback.reason.clone());
    report(args, &summary, &renderer.name())
}

fn report(args: &RenderArgs, summary: &Summary, last_backend: &str) -> anyhow::Result<Outcome> {
    if summary.dropped_not_finite > 0 {
        output::remark(format!(
            "warning: {}: {} Gaussians hold values that are not finite and were dropped",
            args.scene.display(),
            summary.dropped_not_finite
        ));
    }
    if let Some(reason) = &summary.fallback {
        output::remark(format!("warning: {reason}: {last_backend} took over"));
    }
    if args.json {
        output::json(summary)?;
        return Ok(Outcome::Done);
    }
    let views = match (summary.views, summary.reused) {
        (1, 0) => String::new(),
        (n, 0) => format!("{n} views, "),
        (n, there) => format!("{n} views, {there} of them from an earlier start, "),
    };
    let reason = summary.backend_reason.as_ref();
    output::line(format!(
        "{} ({views}{}x{}, {} Gaussians, {}{})",
        summary.out,
        summary.width,
        summary.height,
        summary.gaussians,
        summary.backend,
        reason.map_or_else(String::new, |reason| format!(": {reason}"))
    ))?;
    Ok(Outcome::Done)
}

/// What the views showed.
#[derive(Debug, Default)]
struct Seen {
    alpha: f64,
    pixels: usize,
    dropped_not_finite: u64,
}

impl Seen {
    fn add(&mut self, view: &RenderOutput) {
        self.alpha += view.alpha.iter().map(|&a| f64::from(a)).sum::<f64>();
        self.pixels += view.alpha.len();
        self.dropped_not_finite = self.dropped_not_finite.max(view.dropped.not_finite);
    }
}

/// Everything that is known before a backend is.
struct Job<'a> {
    args: &'a RenderArgs,
    form: Form,
    scene: Gaussians,
    screen: Intrinsics,
    views: Vec<RenderView>,
    look: Look,
    /// The path in words.
    path: String,
}

impl<'a> Job<'a> {
    fn prepare(args: &'a RenderArgs, form: Form) -> anyhow::Result<Self> {
        let file = scene_file::read(&args.scene)?;
        let (photo, camera_from_scene) = match (&args.camera, file.camera) {
            (Some(path), _) => CameraFile::read(path)?,
            (None, Some(stored)) => stored,
            (None, None) => bail!(
                "{}: no camera is stored in it; give one with --camera CAM.json",
                args.scene.display()
            ),
        };
        let scene = file.gaussians;
        let named = || args.scene.display().to_string();
        let poses = args
            .path
            .poses(&scene, &photo, &camera_from_scene)
            .with_context(named)?;
        check_form(args, form, poses.moved.as_ref().map(Vec::len))?;

        let screen = if args.release_screen {
            release_screen(&photo)
        } else {
            photo
        };
        let view = |camera_from_scene: DAffine3| RenderView {
            eps2d: args.eps2d.0,
            near: args.near,
            far: args.far,
            ..RenderView::new(camera_from_scene, screen)
        };
        let views = match poses.moved {
            None => vec![view(camera_from_scene)],
            Some(moved) => moved
                .iter()
                .map(|moved_from_photo| view(moved_from_photo.to_affine() * camera_from_scene))
                .collect(),
        };
        let depth_m = match (args.depth, args.depth_range) {
            (false, _) => None,
            (true, Some(range)) => Some(range.0),
            (true, None) => Some(
                DepthRange::seen_from(&scene, &camera_from_scene)
                    // Nothing to colour, then.
                    .map_or([1.0, 2.0], |range| [range.near as f32, range.far as f32]),
            ),
        };
        let rule = match (args.quantise, args.release_screen) {
            (Some(rule), _) => rule.into(),
            (None, true) => Quantization::Truncate,
            (None, false) => Quantization::Round,
        };
        Ok(Self {
            args,
            form,
            screen,
            views,
            look: Look {
                background: args.background.map_or(Background::Black, |b| b.0),
                quantization: rule,
                depth_m,
                alpha: args.alpha,
            },
            path: poses.text,
            scene,
        })
    }

    /// Renders all views of the scene or of one layer of it.
    fn render(
        &self,
        renderer: &mut BatchRenderer,
        (scene, layer): (&Gaussians, Option<usize>),
        seen: &mut Seen,
        summary: &mut Summary,
    ) -> anyhow::Result<()> {
        let out = match (layer, self.args.layer) {
            (Some(layer), Some(Layers::All)) => target::of_layer(&self.args.out, self.form, layer),
            _ => self.args.out.clone(),
        };
        let mut waiting: Vec<usize> = (0..self.views.len()).collect();
        let settings = self.settings(layer, &renderer.name())?;
        let (target, names) = match self.form {
            Form::Picture => {
                let paths = vec![out.clone()];
                (Target::files(paths.clone(), self.look), paths)
            }
            Form::Frames => {
                frames::start(&out, &settings)?;
                let name = |index| target::frame_path(&out, index);
                let paths: Vec<PathBuf> = (0..self.views.len()).map(name).collect();
                waiting.retain(|&index| !paths[index].is_file());
                (Target::files(paths.clone(), self.look), paths)
            }
            Form::Gif | Form::Mp4 => {
                let size = (self.screen.width, self.screen.height);
                let fps = self.args.fps.unwrap_or(DEFAULT_FPS);
                let cameras = out.with_extension("cameras");
                let name = |index| target::frame_path(&cameras, index);
                let target = Target::movies(&out, size, fps, self.look)?;
                (target, (0..self.views.len()).map(name).collect())
            }
        };
        if self.args.write_cameras {
            for (view, name) in self.views.iter().zip(&names) {
                let path = name.with_extension("json");
                CameraFile::of(&view.intrinsics, &view.camera_from_scene).write(&path)?;
            }
        }
        let fell_back_before = renderer.fallback().is_some();
        self.draw(renderer, scene, &waiting, target, seen)?;
        if let (Form::Frames, Some(fallback), false) =
            (self.form, renderer.fallback(), fell_back_before)
        {
            let from_frame = waiting.get(fallback.from_view).copied().unwrap_or(0);
            frames::record_fallback(&out, &settings, fallback, from_frame)?;
        }

        summary.views += self.views.len();
        summary.reused += self.views.len() - waiting.len();
        let files = match self.form {
            Form::Picture => self.look.files(&out),
            Form::Frames => vec![out],
            Form::Gif | Form::Mp4 => {
                let [color, depth, alpha] = target::movie_paths(&out);
                let depth = self.look.depth_m.map(|_| depth);
                let alpha = self.look.alpha.then_some(alpha);
                [Some(color), depth, alpha].into_iter().flatten().collect()
            }
        };
        summary
            .files
            .extend(files.iter().map(|file| file.display().to_string()));
        Ok(())
    }

    /// Renders on this thread and writes on another, one view behind: two views are in memory.
    fn draw(
        &self,
        renderer: &mut BatchRenderer,
        scene: &Gaussians,
        waiting: &[usize],
        mut target: Target,
        seen: &mut Seen,
    ) -> anyhow::Result<()> {
        let views: Vec<RenderView> = waiting.iter().map(|&index| self.views[index]).collect();
        let bar = progress::bar(views.len(), "views");
        let (sender, receiver) = sync_channel::<(usize, RenderOutput)>(0);
        let (rendered, written) = std::thread::scope(|scope| {
            let target = &mut target;
            let writer = scope.spawn(move || -> anyhow::Result<()> {
                for (index, view) in receiver {
                    target.take(index, &view)?;
                }
                Ok(())
            });
            let rendered = renderer.render(scene, &views, |at, view| {
                seen.add(&view);
                bar.inc(1);
                sender
                    .send((waiting[at], view))
                    .map_err(|_| Stopped::Writing)
            });
            drop(sender);
            let written = writer
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            (rendered, written)
        });
        bar.finish_and_clear();
        // Where writing failed, rendering only says that it was stopped.
        written?;
        rendered.with_context(|| self.args.scene.display().to_string())?;
        target.finish()
    }

    /// Everything that the frames of a folder depend on.
    fn settings(&self, layer: Option<usize>, backend: &str) -> anyhow::Result<Value> {
        if self.form != Form::Frames {
            return Ok(Value::Null);
        }
        let cameras: Vec<CameraFile> = self
            .views
            .iter()
            .map(|view| CameraFile::of(&view.intrinsics, &view.camera_from_scene))
            .collect();
        Ok(json!({
            "scene_sha256": file_sha256(&self.args.scene)?,
            "layer": layer,
            "path": self.path,
            "cameras_sha256": crate::durable::sha256_hex(&serde_json::to_vec(&cameras)?),
            "frames": self.views.len(),
            "eps2d": self.args.eps2d.0,
            "near": self.args.near,
            "far": self.args.far,
            "background": BackgroundArg::text(self.look.background),
            "quantization": format!("{:?}", self.look.quantization),
            "depth_range_m": self.look.depth_m,
            "alpha": self.look.alpha,
            "backend": backend,
            "source_fingerprint": SOURCE_FINGERPRINT,
        }))
    }
}

/// The release's.
const DEFAULT_FPS: u32 = 30;

/// Why rendering ended before its last view.
#[derive(Debug, thiserror::Error)]
enum Stopped {
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error("the views could not be written")]
    Writing,
}

/// One view goes to a picture, a path to frames or a movie.
fn check_form(args: &RenderArgs, form: Form, moved: Option<usize>) -> anyhow::Result<()> {
    let out = args.out.display();
    match (form, moved) {
        (Form::Picture, Some(n)) if n != 1 => {
            bail!(
                "{out}: a picture holds one view, the path has {n}: choose a folder, .gif or .mp4"
            )
        }
        (Form::Gif | Form::Mp4, None) => {
            bail!("{out}: nothing moves: add --trajectory or --offset-m")
        }
        (Form::Frames, None) => bail!(
            "{out}: one view goes to a .png, .exr or .safetensors; a folder of frames needs --trajectory or --offset-m"
        ),
        _ => {}
    }
    ensure!(
        args.fps.is_none() || matches!(form, Form::Gif | Form::Mp4),
        "{out}: --fps is for .gif and .mp4"
    );
    let options = [
        ("--background", args.background.is_some()),
        ("--quantise", args.quantise.is_some()),
    ];
    target::refuse_for_floats(&args.out, &options)
}
