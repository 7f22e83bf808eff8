//! Writes rendered views: one picture, a folder of frames, or a movie.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use image::{DynamicImage, GrayImage, Luma, RgbImage};
use sharp::color::{Quantization, quantize};
use sharp::render::{Background, RenderOutput};

use crate::io::movie::Movie;
use crate::io::movie::gif::GifMovie;
use crate::io::movie::mp4::Mp4Movie;
use crate::io::rendering_files;

/// Kind of output, determined by the name in `--out`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OutputKind {
    /// One view: `.png`, `.exr` or `.safetensors`.
    Picture,
    Frames,
    Gif,
    Mp4,
}

impl OutputKind {
    /// Determines the kind from a name; without an extension it is a folder.
    pub(super) fn of(out: &Path) -> anyhow::Result<Self> {
        let extension = out.extension().map(|e| e.to_string_lossy().to_lowercase());
        Ok(match extension.as_deref() {
            Some("png" | "exr" | "safetensors") => Self::Picture,
            Some("gif") => Self::Gif,
            Some("mp4") => Self::Mp4,
            None => Self::Frames,
            Some(_) if out.is_dir() => Self::Frames,
            Some(_) => bail!(
                "{}: OUT must end in .png, .exr, .safetensors, .gif or .mp4, or be a folder",
                out.display()
            ),
        })
    }
}

/// Settings for converting a view to 8-bit pictures.
#[derive(Debug, Clone, Copy)]
pub(super) struct Appearance {
    pub(super) background: Background,
    pub(super) quantization: Quantization,
    /// Depths at the ends of the colour scale, metres; `None` if no depth is requested.
    pub(super) depth_m: Option<[f32; 2]>,
    pub(super) alpha: bool,
    /// Whether arrays contain blended values over the background, rather than linear light without
    /// a background.
    pub(super) blended: bool,
}

impl Appearance {
    pub(super) fn color(&self, view: &RenderOutput) -> RgbImage {
        view.srgb8(self.background, self.quantization)
    }

    fn depth_colors(&self, view: &RenderOutput) -> Option<RgbImage> {
        let [near, far] = self.depth_m?;
        Some(view.inverse_depth_colors(near..=far))
    }

    /// Coverage as grey levels that are proportional to alpha, neither sRGB-encoded nor composited.
    fn alpha(&self, view: &RenderOutput) -> Option<GrayImage> {
        self.alpha.then(|| {
            GrayImage::from_fn(view.width, view.height, |x, y| {
                let alpha = view.alpha[y as usize * view.width as usize + x as usize];
                Luma([quantize(alpha, self.quantization)])
            })
        })
    }

    /// All files that are written for a view if its colour is written to `path`.
    pub(super) fn files(&self, path: &Path) -> Vec<PathBuf> {
        let mut files = vec![path.to_owned()];
        if self.depth_m.is_some() {
            files.extend(["depth.exr", "depth.png"].map(|end| path.with_extension(end)));
        }
        if self.alpha {
            files.push(path.with_extension("alpha.png"));
        }
        files
    }

    /// Writes a view: colour to `path`, depth and alpha to files next to it.
    fn write(&self, path: &Path, view: &RenderOutput) -> anyhow::Result<()> {
        if self.depth_m.is_some() {
            let size = (view.width as usize, view.height as usize);
            let depth = view.expected_depth();
            let channel = [("Z".to_owned(), depth.as_raw().as_slice())];
            rendering_files::write_exr_channels(&path.with_extension("depth.exr"), size, &channel)?;
        }
        if let Some(picture) = self.depth_colors(view) {
            rendering_files::write_png(&path.with_extension("depth.png"), &picture)?;
        }
        if let Some(picture) = self.alpha(view) {
            rendering_files::write_gray_png(&path.with_extension("alpha.png"), &picture)?;
        }
        // Write the colour file last, so that its existence shows that a frame is complete.
        match path.extension().and_then(|e| e.to_str()) {
            Some("exr") => rendering_files::write_exr(path, view)?,
            Some("safetensors") if self.blended => {
                rendering_files::write_blended(path, view, self.background)?;
            }
            Some("safetensors") => rendering_files::write_safetensors(path, view)?,
            _ => rendering_files::write_png(path, &self.color(view))?,
        }
        Ok(())
    }
}

/// Receives rendered views.
pub(super) enum ViewWriter {
    Files {
        /// Path by index of the view.
        paths: Vec<PathBuf>,
        appearance: Appearance,
    },
    /// Movies written at the same time: colour, and if requested, depth and alpha.
    Movies {
        color: Box<dyn Movie>,
        depth: Option<Box<dyn Movie>>,
        alpha: Option<Box<dyn Movie>>,
        appearance: Appearance,
    },
}

impl ViewWriter {
    pub(super) fn files(paths: Vec<PathBuf>, appearance: Appearance) -> Self {
        Self::Files { paths, appearance }
    }

    pub(super) fn movies(
        path: &Path,
        size: (u32, u32),
        fps: u32,
        appearance: Appearance,
    ) -> anyhow::Result<Self> {
        let open = |path: &Path| -> anyhow::Result<Box<dyn Movie>> {
            Ok(match OutputKind::of(path)? {
                OutputKind::Gif => Box::new(GifMovie::create(path, size, fps)?),
                _ => Box::new(Mp4Movie::create(path, size, fps)?),
            })
        };
        let [color, depth, alpha] = movie_paths(path);
        Ok(Self::Movies {
            color: open(&color)?,
            depth: appearance.depth_m.map(|_| open(&depth)).transpose()?,
            alpha: appearance.alpha.then(|| open(&alpha)).transpose()?,
            appearance,
        })
    }

    /// Writes view `index`; for a movie, views must arrive in order.
    pub(super) fn take(&mut self, index: usize, view: &RenderOutput) -> anyhow::Result<()> {
        match self {
            Self::Files { paths, appearance } => {
                let path = paths.get(index).context("a view without a name")?;
                appearance.write(path, view)
            }
            Self::Movies {
                color,
                depth,
                alpha,
                appearance,
            } => {
                color.push(&appearance.color(view))?;
                if let (Some(movie), Some(frame)) = (depth, appearance.depth_colors(view)) {
                    movie.push(&frame)?;
                }
                if let (Some(movie), Some(frame)) = (alpha, appearance.alpha(view)) {
                    movie.push(&DynamicImage::from(frame).into_rgb8())?;
                }
                Ok(())
            }
        }
    }

    /// Finishes movies, whose files appear under their final names only now.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        if let Self::Movies {
            color,
            depth,
            alpha,
            ..
        } = self
        {
            for movie in [depth, alpha, Some(color)].into_iter().flatten() {
                movie.finish()?;
            }
        }
        Ok(())
    }
}

/// Movies of colour, depth and alpha: `x.gif`, `x.depth.gif`, `x.alpha.gif`.
pub(super) fn movie_paths(path: &Path) -> [PathBuf; 3] {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let beside = |what: &str| path.with_extension(format!("{what}.{extension}"));
    [path.to_owned(), beside("depth"), beside("alpha")]
}

/// Path of a layer: `x.layer0.png` for `x.png`, `frames/layer0` for the folder `frames`.
pub(super) fn of_layer(out: &Path, kind: OutputKind, layer: usize) -> PathBuf {
    match (kind, out.extension()) {
        (OutputKind::Frames, _) | (_, None) => out.join(format!("layer{layer}")),
        (_, Some(end)) => out.with_extension(format!("layer{layer}.{}", end.to_string_lossy())),
    }
}

pub(super) fn frame_path(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("frame-{index:05}.png"))
}

pub(super) fn ends_in(out: &Path, extensions: &[&str]) -> bool {
    let extension = out.extension();
    extension.is_some_and(|e| extensions.iter().any(|of| e == *of))
}

/// Rejects options for 8-bit pictures if the output file stores linear floats.
pub(super) fn refuse_for_floats(
    out: &Path,
    options: &[(&'static str, bool)],
) -> anyhow::Result<()> {
    if ends_in(out, &["exr", "safetensors"]) {
        for (name, given) in options {
            ensure!(
                !given,
                "{}: the format holds premultiplied linear RGB without a background; remove {name}",
                out.display()
            );
        }
    }
    Ok(())
}
