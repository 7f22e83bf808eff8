//! `predict --depth-only`: metric depth of photographs by Depth Pro.

use std::ffi::OsStr;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use serde_json::{Value, json};
use sharp::image_file::focal::FocalSource;
use sharp::model::depth_pro::DepthPro;
use sharp::model::preprocess::Photo;

use super::args::focal_text;
use super::photographs::{DepthForm, PredictArgs, for_each, named_after};
use crate::cli::{Outcome, output};
use crate::io::rendering_files::{write_exr_channels, write_millimetres_png};

pub(super) fn execute(args: &PredictArgs) -> anyhow::Result<Outcome> {
    let of_file = match args.out.extension().and_then(OsStr::to_str) {
        Some("exr") => Some(DepthForm::Exr),
        Some("png") => Some(DepthForm::Png16),
        Some("ply" | "pfm" | "npy" | "jpg" | "jpeg" | "tif" | "tiff") => bail!(
            "--out {}: --depth-only writes .exr or .png",
            args.out.display()
        ),
        _ => None,
    };
    let form = of_file.or(args.depth).unwrap_or(DepthForm::Exr);
    ensure!(
        args.depth.is_none_or(|given| given == form),
        "--out {}: the file's extension contradicts --depth",
        args.out.display()
    );
    let outputs = match (of_file, form) {
        (Some(_), _) => vec![args.out.clone()],
        (None, DepthForm::Exr) => named_after(&args.images, &args.out, "exr")?,
        (None, DepthForm::Png16) => named_after(&args.images, &args.out, "png")?,
    };
    ensure!(
        outputs.len() == args.images.len(),
        "--out {}: for several photographs, give a folder",
        args.out.display()
    );
    let network = args.model.load_depth_pro()?;
    for_each(args, &outputs, |image, out| {
        predict_one(args, &network, image, out, form)
    })
}

/// Whether the network has to estimate the focal length, because neither the user nor a 35 mm equivalent in the
/// photograph's EXIF tags states it.
fn is_estimated(photo: &Photo) -> bool {
    matches!(
        photo.focal_source,
        FocalSource::Lens(_) | FocalSource::Default
    )
}

fn predict_one(
    args: &PredictArgs,
    network: &DepthPro,
    image: &Path,
    out: &Path,
    form: DepthForm,
) -> anyhow::Result<Value> {
    let started = Instant::now();
    let photo = args.photo.load_unless_estimated(image, is_estimated)?;
    let is_focal_estimated = is_estimated(&photo);
    let focal_px = (!is_focal_estimated).then_some(photo.focal_px as f32);
    let predicted = network
        .predict(photo.planes(), focal_px)
        .with_context(|| image.display().to_string())?;
    match form {
        DepthForm::Exr => {
            let size = (photo.width, photo.height);
            write_exr_channels(out, size, &[("Z".to_owned(), &predicted.depth)])?;
        }
        DepthForm::Png16 => {
            let size = (photo.width as u32, photo.height as u32);
            write_millimetres_png(out, size, &predicted.depth)?;
        }
    }
    let seconds = started.elapsed().as_secs_f64();
    if !args.json {
        let focal = if is_focal_estimated {
            format!("{:.2} px (estimated)", predicted.focal_px)
        } else {
            focal_text(&photo)
        };
        output::line(format!(
            "{}  {}x{}, focal length {focal}, {seconds:.1} s",
            out.display(),
            photo.width,
            photo.height
        ))?;
    }
    Ok(json!({
        "image": image.display().to_string(),
        "depth": out.display().to_string(),
        "focal_px": f64::from(predicted.focal_px),
        "is_focal_estimated": is_focal_estimated,
        "seconds": seconds,
    }))
}
