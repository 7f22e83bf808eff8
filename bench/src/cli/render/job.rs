//! One `render` command: the scene, the views and their output.

use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;

use anyhow::{Context, anyhow, bail, ensure};
use glam::DAffine3;
use sharp::camera::Intrinsics;
use sharp::color::Quantization;
use sharp::gaussian_files::turn;
use sharp::gaussians::Gaussians;
use sharp::ply::ColorSpace;
use sharp::render::{RenderError, RenderOutput, RenderView, Rule, release_screen};
use sharp::trajectory::DepthRange;

use super::args::Layers;
use super::writer::{self, Appearance, OutputKind, ViewWriter};
use super::{RenderArgs, Summary};
use crate::cli::output::{self, Terminal};
use crate::export::camera_file::CameraFile;
use crate::export::viewer::Viewer;
use crate::io::gaussian_files;
use crate::io::observer::Observer;
use crate::rendering::BatchRenderer;

/// Everything about a rendering that is decided before a backend is opened.
pub(super) struct RenderJob<'a> {
    args: &'a RenderArgs,
    /// Output for pictures, if requested.
    pub(super) out: Option<Output<'a>>,
    pub(super) scene: Gaussians,
    pub(super) screen: Intrinsics,
    photograph: DAffine3,
    views: Vec<RenderView>,
    pub(super) appearance: Appearance,
}

/// The output named by `--out`.
pub(super) struct Output<'a> {
    path: &'a Path,
    kind: OutputKind,
}

impl<'a> RenderJob<'a> {
    pub(super) fn prepare(args: &'a RenderArgs) -> anyhow::Result<Self> {
        let out = match &args.out {
            None => None,
            Some(path) => Some(Output {
                path,
                kind: OutputKind::of(path)?,
            }),
        };
        if let Some(page) = &args.viewer {
            ensure!(
                page.extension()
                    .is_some_and(|end| end.eq_ignore_ascii_case("html")),
                "{}: the page's name must end in .html",
                page.display()
            );
        }
        let mut file = gaussian_files::read(&args.scene, args.reading.reading(), args.rule)?;
        turn(&mut file.gaussians, &mut file.doubts, args.reading.axes)
            .map_err(|reason| anyhow!("{}: {reason} (--axes)", args.scene.display()))?;
        let rule = args.over(file.rule);
        if let Some(note) = &file.rule_note {
            output::remark(format!("note: {}: {note}", args.scene.display()));
        }
        for doubt in &file.doubts {
            output::remark(format!("warning: {}: {}", args.scene.display(), doubt.text));
        }
        let (photo, camera_from_scene) = match (&args.camera, file.camera) {
            (Some(path), _) => CameraFile::read(path)?,
            (None, Some(stored)) => stored,
            (None, None) => bail!(
                "{}: no camera in the file; give one with --camera CAM.json",
                args.scene.display()
            ),
        };
        let scene = file.gaussians;
        let named = || args.scene.display().to_string();
        let moved = args
            .path
            .poses(&scene, &photo, &camera_from_scene)
            .with_context(named)?;
        if let Some(out) = &out {
            out.check(args, &rule, moved.as_ref().map(Vec::len))?;
        }

        let screen = if args.release_screen {
            release_screen(&photo)
        } else {
            photo
        };
        let rendering = args.rendering.settings();
        let view = |camera_from_scene: DAffine3| RenderView {
            rule,
            ..RenderView::new(camera_from_scene, screen)
        };
        let views = match moved {
            None => vec![view(camera_from_scene)],
            Some(moved) => moved
                .iter()
                .map(|moved_from_photo| view(moved_from_photo.to_affine() * camera_from_scene))
                .collect(),
        };
        let depth_m = match (args.depth, args.depth_range) {
            (false, _) => None,
            (true, range @ Some(_)) => range,
            (true, None) => Some(
                DepthRange::seen_from(&scene, &camera_from_scene)
                    // Without a Gaussian in front of the camera, nothing will be coloured, so any range will do.
                    .map_or([1.0, 2.0], |range| [range.near as f32, range.far as f32]),
            ),
        };
        let quantization = match (args.rendering.quantise, args.release_screen) {
            (None, true) => Quantization::Truncate,
            _ => rendering.quantization,
        };
        Ok(Self {
            args,
            out,
            screen,
            photograph: camera_from_scene,
            views,
            appearance: Appearance {
                background: rendering.background,
                quantization,
                blended: args.writes_blended(&rule),
                depth_m,
                alpha: args.alpha,
            },
            scene,
        })
    }

    /// Renders the views for the page of `--viewer` and writes it.
    pub(super) fn page(
        &self,
        renderer: &mut BatchRenderer,
        scene: &Gaussians,
        path: &Path,
        summary: &mut Summary,
    ) -> anyhow::Result<()> {
        let name = self.args.scene.file_name().unwrap_or_default();
        let page = Viewer {
            title: &name.to_string_lossy(),
            scene,
            photograph: self.photograph,
            views: &self.views,
            background: self.appearance.background,
            quantization: self.appearance.quantization,
        };
        let chosen: Vec<RenderView> = page.pictured().iter().map(|&at| self.views[at]).collect();
        let mut pictures = Vec::with_capacity(chosen.len());
        renderer
            .render::<RenderError>(scene, &chosen, |_, view| {
                // With `--out`, these views were already counted when they were rendered for that output.
                if self.out.is_none() {
                    summary.add(&view);
                }
                pictures.push(self.appearance.color(&view));
                Ok(())
            })
            .with_context(|| self.args.scene.display().to_string())?;
        page.write(path, &pictures)?;
        summary.files.push(path.display().to_string());
        if self.out.is_none() {
            summary.views = self.views.len();
        }
        Ok(())
    }

    /// Renders on this thread while another thread writes the previous view, so two views are in memory.
    fn draw(
        &self,
        renderer: &mut BatchRenderer,
        scene: &Gaussians,
        mut view_writer: ViewWriter,
        summary: &mut Summary,
    ) -> anyhow::Result<()> {
        let terminal = Terminal::default();
        terminal.begin("rendering", self.views.len(), "views");
        let (sender, receiver) = sync_channel::<(usize, RenderOutput)>(0);
        let (rendered, written) = std::thread::scope(|scope| {
            let view_writer = &mut view_writer;
            let thread = scope.spawn(move || -> anyhow::Result<()> {
                for (index, view) in receiver {
                    view_writer.take(index, &view)?;
                }
                Ok(())
            });
            let rendered = renderer.render(scene, &self.views, |index, view| {
                summary.add(&view);
                terminal.step();
                sender.send((index, view)).map_err(|_| Stopped::Writing)
            });
            drop(sender);
            let written = thread
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            (rendered, written)
        });
        terminal.end();
        // Report a writing error first: the rendering error that it causes only states that rendering was stopped.
        written?;
        rendered.with_context(|| self.args.scene.display().to_string())?;
        view_writer.finish()
    }
}

/// Frame rate, as in the release.
const DEFAULT_FPS: u32 = 30;

#[derive(Debug, thiserror::Error)]
enum Stopped {
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error("the views could not be written")]
    Writing,
}

impl Output<'_> {
    /// Fails if the views do not fit the kind of output: a picture needs a single view; frames and movies need a path.
    fn check(&self, args: &RenderArgs, rule: &Rule, moved: Option<usize>) -> anyhow::Result<()> {
        let out = self.path.display();
        match (self.kind, moved) {
            (OutputKind::Picture, Some(n)) if n != 1 => {
                bail!(
                    "{out}: a picture can show only one view, but the path has {n}; choose a \
                     folder, .gif or .mp4"
                )
            }
            (OutputKind::Gif | OutputKind::Mp4, None) => {
                bail!("{out}: the camera does not move; add --trajectory or --offset-m")
            }
            (OutputKind::Frames, None) => bail!(
                "{out}: a folder of frames needs --trajectory or --offset-m; a single view needs a .png, .exr or .safetensors"
            ),
            _ => {}
        }
        ensure!(
            args.fps.is_none() || matches!(self.kind, OutputKind::Gif | OutputKind::Mp4),
            "{out}: --fps applies only to .gif and .mp4"
        );
        let blended = args.writes_blended(rule) && writer::ends_in(self.path, &["safetensors"]);
        let options = [
            (
                "--background",
                args.rendering.background.is_some() && !blended,
            ),
            ("--quantise", args.rendering.quantise.is_some()),
        ];
        writer::refuse_for_floats(self.path, &options)?;
        ensure!(
            rule.blending == ColorSpace::Linear || !writer::ends_in(self.path, &["exr"]),
            "{out}: an .exr stores linear light, but {} does not blend in linear light; choose \
             .safetensors or .png",
            rule
        );
        Ok(())
    }

    /// Renders all views of the scene, or of one of its layers.
    pub(super) fn render(
        &self,
        job: &RenderJob<'_>,
        renderer: &mut BatchRenderer,
        (scene, layer): (&Gaussians, Option<usize>),
        summary: &mut Summary,
    ) -> anyhow::Result<()> {
        let out = match (layer, job.args.layer) {
            (Some(layer), Some(Layers::All)) => writer::of_layer(self.path, self.kind, layer),
            _ => self.path.to_owned(),
        };
        let (view_writer, names) = match self.kind {
            OutputKind::Picture => {
                let paths = vec![out.clone()];
                (ViewWriter::files(paths.clone(), job.appearance), paths)
            }
            OutputKind::Frames => {
                ensure!(
                    std::fs::read_dir(&out).map_or(true, |mut files| files.next().is_none()),
                    "{}: the folder is not empty; remove it or choose another one",
                    out.display()
                );
                let name = |index| writer::frame_path(&out, index);
                let paths: Vec<PathBuf> = (0..job.views.len()).map(name).collect();
                (ViewWriter::files(paths.clone(), job.appearance), paths)
            }
            OutputKind::Gif | OutputKind::Mp4 => {
                let size = (job.screen.width, job.screen.height);
                let fps = job.args.fps.unwrap_or(DEFAULT_FPS);
                let cameras = out.with_extension("cameras");
                let name = |index| writer::frame_path(&cameras, index);
                let view_writer = ViewWriter::movies(&out, size, fps, job.appearance)?;
                (view_writer, (0..job.views.len()).map(name).collect())
            }
        };
        if job.args.write_cameras {
            for (view, name) in job.views.iter().zip(&names) {
                let path = name.with_extension("json");
                CameraFile::of(&view.intrinsics, &view.camera_from_scene).write(&path)?;
            }
        }
        job.draw(renderer, scene, view_writer, summary)?;
        summary.views += job.views.len();
        let files = match self.kind {
            OutputKind::Picture => job.appearance.files(&out),
            OutputKind::Frames => vec![out],
            OutputKind::Gif | OutputKind::Mp4 => {
                let [color, depth, alpha] = writer::movie_paths(&out);
                let depth = job.appearance.depth_m.map(|_| depth);
                let alpha = job.appearance.alpha.then_some(alpha);
                [Some(color), depth, alpha].into_iter().flatten().collect()
            }
        };
        summary
            .files
            .extend(files.iter().map(|file| file.display().to_string()));
        Ok(())
    }
}
