//! One `render`: the scene, the views and where they go.

use std::path::PathBuf;
use std::sync::mpsc::sync_channel;

use anyhow::{Context, bail, ensure};
use glam::DAffine3;
use serde_json::{Value, json};
use sharp::camera::Intrinsics;
use sharp::color::Quantization;
use sharp::gaussians::Gaussians;
use sharp::render::trajectory::DepthRange;
use sharp::render::{Background, RenderError, RenderOutput, RenderView, release_screen};

use super::args::{BackgroundArg, Layers};
use super::target::{self, Form, Look, Target};
use super::{RenderArgs, Seen, Summary, frames};
use crate::cli::output::Terminal;
use crate::export::camera_file::CameraFile;
use crate::io::fingerprints;
use crate::io::gaussian_files;
use crate::io::hash::file_sha256;
use crate::io::observer::Observer;
use crate::rendering::BatchRenderer;

/// Everything that is known before a backend is.
pub(super) struct Job<'a> {
    args: &'a RenderArgs,
    form: Form,
    pub(super) scene: Gaussians,
    pub(super) screen: Intrinsics,
    views: Vec<RenderView>,
    pub(super) look: Look,
    /// The path in words.
    path: String,
}

impl<'a> Job<'a> {
    /// Reads the scene and finds the views.
    pub(super) fn prepare(args: &'a RenderArgs, form: Form) -> anyhow::Result<Self> {
        let file = gaussian_files::read(&args.scene)?;
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
    pub(super) fn render(
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
        let terminal = Terminal::default();
        terminal.begin("rendering", views.len(), "views");
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
                terminal.step();
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
        terminal.end();
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
            "cameras_sha256": crate::io::hash::sha256_hex(&serde_json::to_vec(&cameras)?),
            "frames": self.views.len(),
            "eps2d": self.args.eps2d.0,
            "near": self.args.near,
            "far": self.args.far,
            "background": BackgroundArg::text(self.look.background),
            "quantization": format!("{:?}", self.look.quantization),
            "depth_range_m": self.look.depth_m,
            "alpha": self.look.alpha,
            "backend": backend,
            "source_fingerprint": fingerprints::BUILD,
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
