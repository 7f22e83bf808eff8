//! `predict IMAGE…`: predicts Gaussians from photographs.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use sharp::model::preprocess::Photo;
use sharp::model::{NetworkOutput, Predictor, StageProgress};
use sharp::ply::{GaussianScene, PlyForm, to_bytes};
use sharp::unprojection::{release_intrinsics, unproject};

use super::args::focal_text;
use super::depth_only;
pub(crate) use super::photographs::PredictArgs;
use super::photographs::{DepthForm, for_each, named_after};
use crate::cli::{Outcome, output};
use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::checkpoint::find_checkpoint;
use crate::io::machine::peak_bytes;
use crate::io::rendering_files;

pub(crate) fn execute(args: &PredictArgs) -> anyhow::Result<Outcome> {
    if args.depth_only {
        return depth_only::execute(args);
    }
    let to_file = args.out.extension().is_some_and(|e| e == "ply");
    ensure!(
        !to_file || args.images.len() == 1,
        "--out {}: for several photographs, give a folder",
        args.out.display()
    );
    let outputs = if to_file {
        vec![args.out.clone()]
    } else {
        named_after(&args.images, &args.out, "ply")?
    };
    let mut model = args.model.clone();
    if model.checkpoint.is_none()
        && model.config.is_none()
        && let Err(absent) = find_checkpoint()
    {
        output::remark(format!("note: using the bundled small network: {absent}"));
        model.checkpoint = Some("mini".into());
    }
    let predictor = model.load()?;
    for_each(args, &outputs, |image, ply| {
        predict_one(args, &predictor, image, ply)
    })
}

fn predict_one(
    args: &PredictArgs,
    predictor: &Predictor,
    image: &Path,
    ply: &Path,
) -> anyhow::Result<Value> {
    let started = Instant::now();
    let photo = args.photo.load(image)?;
    let mut parts = StageTimes::new();
    let prediction =
        forward(predictor, &photo, &mut parts).with_context(|| image.display().to_string())?;
    let intrinsics = release_intrinsics(photo.focal_px, photo.width as u32, photo.height as u32)?;
    let gaussians = unproject(&prediction.gaussians, &intrinsics);
    let count = gaussians.len();
    let form = if args.plain {
        PlyForm::Plain
    } else {
        PlyForm::Release
    };
    write_atomic(
        ply,
        &to_bytes(&GaussianScene::new(gaussians, intrinsics), form),
    )?;
    let depth = match args.depth {
        Some(form) => write_depth(&prediction, ply, form)?,
        None => Vec::new(),
    };
    let seconds = started.elapsed().as_secs_f64();
    if !args.json {
        output::line(format!(
            "{}  {count} Gaussians, focal length {}, {seconds:.1} s{}",
            ply.display(),
            focal_text(&photo),
            peak_bytes().map_or_else(String::new, |bytes| format!(
                ", peak memory {:.2} GiB",
                bytes as f64 / f64::from(1 << 30)
            ))
        ))?;
    }
    let stage = |(stage, seconds): &(_, f64)| json!({"stage": stage, "seconds": seconds});
    let stages: Vec<Value> = parts.stages.iter().map(stage).collect();
    Ok(json!({
        "image": image.display().to_string(),
        "ply": ply.display().to_string(),
        "depth": output::names(&depth),
        "gaussians": count,
        "focal_px": photo.focal_px,
        "seconds": seconds,
        "stages": stages,
        "peak_memory_bytes": peak_bytes(),
    }))
}

/// Runs the network with a progress bar, or with a line per part if standard error is not a terminal.
fn forward(
    predictor: &Predictor,
    photo: &Photo,
    parts: &mut StageTimes,
) -> anyhow::Result<NetworkOutput> {
    let style = ProgressStyle::with_template("{msg:20} {bar:32} {percent:>3} %  {elapsed}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = if output::is_quiet() {
        ProgressBar::hidden()
    } else {
        ProgressBar::new(1000)
    };
    let bar = bar.with_style(style);
    let mut progress = StageProgress::new(predictor.config().vit.depth, |part, done: f64| {
        bar.set_message(part);
        bar.set_position((1000.0 * done) as u64);
        parts.reached(part);
    });
    let prediction = predictor.predict(photo.planes(), photo.disparity_factor(), &mut progress)?;
    bar.finish_and_clear();
    parts.finish();
    Ok(prediction)
}

/// Times of the network's parts.
struct StageTimes {
    last_milestone: Instant,
    /// Each part with its seconds.
    stages: Vec<(&'static str, f64)>,
    /// Whether to print a line after each part, because there is no progress bar.
    as_lines: bool,
}

impl StageTimes {
    fn new() -> Self {
        Self {
            last_milestone: Instant::now(),
            stages: Vec::new(),
            as_lines: !std::io::stderr().is_terminal() && !output::is_quiet(),
        }
    }

    /// Called whenever a part makes progress: adds the time since the previous call to the part's time.
    fn reached(&mut self, part: &'static str) {
        let now = Instant::now();
        let passed = now.duration_since(self.last_milestone).as_secs_f64();
        self.last_milestone = now;
        match self.stages.last_mut() {
            Some((last, seconds)) if *last == part => *seconds += passed,
            _ => {
                self.finish();
                self.stages.push((part, passed));
            }
        }
    }

    /// Prints the time of the last part.
    fn finish(&self) {
        if let (Some((stage, seconds)), true) = (self.stages.last(), self.as_lines) {
            output::remark(format!("  {stage:<18} {seconds:>8.2} s"));
        }
    }
}

fn write_depth(
    prediction: &NetworkOutput,
    ply: &Path,
    form: DepthForm,
) -> Result<Vec<PathBuf>, FileError> {
    let side = prediction.resolution;
    let layers: Vec<&[f32]> = prediction.depth.chunks_exact(side * side).collect();
    match form {
        DepthForm::Exr => {
            let path = ply.with_extension("depth.exr");
            let named: Vec<(String, &[f32])> = layers
                .iter()
                .enumerate()
                .map(|(k, layer)| (format!("layer{k}.Z"), *layer))
                .collect();
            rendering_files::write_exr_channels(&path, (side, side), &named)?;
            Ok(vec![path])
        }
        DepthForm::Png16 => layers
            .iter()
            .enumerate()
            .map(|(k, layer)| {
                let path = ply.with_extension(format!("depth{k}.png"));
                let size = (side as u32, side as u32);
                rendering_files::write_millimetres_png(&path, size, layer)?;
                Ok(path)
            })
            .collect(),
    }
}
