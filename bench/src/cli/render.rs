//! `render SCENE`: Gaussians from a file to a picture.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use serde::Serialize;
use sharp::color::Quantization;
use sharp::render::{Background, RenderOutput, RenderView, render_cpu};

use super::camera_file::CameraFile;
use super::{Outcome, output};
use crate::{render_file, scene_file};

/// Render 3D Gaussians to a picture
///
/// SCENE is a .ply file (SHARP's own or a plain 3D Gaussian one) or a .safetensors file with `means`, `quats_wxyz`,
/// `scales`, `opacities` and `colors_linear`. OUT is .png (sRGB, 8 bit), .exr (linear RGB, alpha, accumulated depth) or
/// .safetensors (`rgb_linear` [H,W,3], `alpha` [H,W], `depth_acc` [H,W]).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench render photo.ply --out view.png
  sharp-bench render photo.ply --camera cam.json --out view.exr

cam.json, pixel centres at +0.5, camera_from_world any affine map, both row by row:
  {\"width\": 640, \"height\": 480, \"K\": [500,0,320, 0,500,240, 0,0,1],
   \"camera_from_world\": [1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1]}")]
pub(super) struct RenderArgs {
    /// The Gaussians: .ply or .safetensors
    scene: PathBuf,
    /// The camera; without it, the one stored in the PLY
    #[arg(long, value_name = "CAM.json")]
    camera: Option<PathBuf>,
    /// Where to write: .png, .exr or .safetensors
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Who renders
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    backend: Backend,
    /// Low-pass added to both variances of a projected Gaussian, square pixels (the release uses 0)
    #[arg(long, default_value_t = 0.0)]
    eps2d: f32,
    /// Print JSON: size and how many Gaussians were dropped, by reason
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Backend {
    /// Native, multithreaded; the one that scores are made with
    Cpu,
}

#[derive(Debug, Serialize)]
struct Summary {
    out: String,
    width: u32,
    height: u32,
    gaussians: usize,
    dropped_not_finite: u64,
    mean_alpha: f64,
}

pub(super) fn execute(args: &RenderArgs) -> anyhow::Result<Outcome> {
    let Backend::Cpu = args.backend;
    let scene = scene_file::read(&args.scene)?;
    let (intrinsics, camera_from_world) = match (&args.camera, scene.camera) {
        (Some(path), _) => CameraFile::read(path)?,
        (None, Some(stored)) => stored,
        (None, None) => bail!(
            "{}: no camera is stored in it; give one with --camera CAM.json",
            args.scene.display()
        ),
    };
    let view = RenderView {
        eps2d: args.eps2d,
        ..RenderView::new(camera_from_world, intrinsics)
    };
    let rendered =
        render_cpu(&scene.gaussians, &view).with_context(|| args.scene.display().to_string())?;
    write(&args.out, &rendered)?;

    let summary = Summary {
        out: args.out.display().to_string(),
        width: rendered.width,
        height: rendered.height,
        gaussians: scene.gaussians.len(),
        dropped_not_finite: rendered.dropped.not_finite,
        mean_alpha: rendered.alpha.iter().map(|&a| f64::from(a)).sum::<f64>()
            / rendered.alpha.len() as f64,
    };
    if summary.dropped_not_finite > 0 {
        output::remark(format!(
            "warning: {}: {} Gaussians hold values that are not finite and were dropped",
            args.scene.display(),
            summary.dropped_not_finite
        ));
    }
    if args.json {
        output::json(&summary)?;
    } else {
        output::line(format!(
            "{} ({}x{}, {} Gaussians)",
            summary.out, summary.width, summary.height, summary.gaussians
        ))?;
    }
    Ok(Outcome::Done)
}

fn write(path: &Path, rendered: &RenderOutput) -> anyhow::Result<()> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("png") => render_file::write_png(
            path,
            &rendered.srgb8(Background::Black, Quantization::Round),
        )?,
        Some("exr") => render_file::write_exr(path, rendered)?,
        Some("safetensors") => render_file::write_safetensors(path, rendered)?,
        _ => bail!("{}: OUT ends in .png, .exr or .safetensors", path.display()),
    }
    Ok(())
}
