//! Evaluates a function as a method on the bundled Middlebury pair.
//!
//! ```console
//! $ cargo run --release -p sharp-bench --example evaluate_closure -- [FOLDER]
//! ```
//! The run is written to FOLDER, or to a temporary folder; a second call with the same FOLDER reuses all results.

#![allow(clippy::print_stdout, reason = "an example that prints its result")]

use std::error::Error;
use std::path::PathBuf;

use glam::DVec2;
use image::RgbImage;
use sharp_bench::evaluate::{Request, RunOptions, prepare};
use sharp_bench::io::observer::Quiet;
use sharp_bench::methods::{Closure, MethodError, PicturePrediction, SourceView, TargetCamera};
use sharp_bench::pairs::OpenDataset;
use sharp_bench::report::mean_tables;
use sharp_bench::scoring::Scoring;
use sharp_metrics::{Selection, Weights};

/// Warps the source photograph into the target camera as if the scene were one plane 2.5 m away.
fn plane(source: &SourceView, target: &TargetCamera) -> Result<PicturePrediction, MethodError> {
    let (from, to) = (source.intrinsics(), target.intrinsics());
    let source_from_target = target.target_from_source(source).inverse();
    Ok(RgbImage::from_fn(to.width, to.height, |x, y| {
        let point = to.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), 2.5);
        let seen = from.project(source_from_target.apply(point));
        let pixel = seen.and_then(|p| source.image().get_pixel_checked(p.x as u32, p.y as u32));
        *pixel.unwrap_or(&image::Rgb([0; 3]))
    })
    .into())
}

fn main() -> Result<(), Box<dyn Error>> {
    let temporary = tempfile::tempdir()?;
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    let folder = folder.unwrap_or_else(|| temporary.path().to_owned());

    let data = sharp_datasets::bundled::extract(&folder.join("data"))?;
    let request = Request::new(
        OpenDataset::open_all(&[format!("middlebury={}", data.display()).parse()?], None)?,
        vec![Box::new(Closure::new("plane", "1", plane))],
        Scoring::new(&Selection::parse("psnr,ssim")?, &Weights::none())?,
    );
    let run = prepare(request, &Quiet)?.run(&folder.join("run"), RunOptions::default(), &Quiet)?;
    for table in mean_tables(&run.results, None)? {
        println!("{}", table.text());
    }
    Ok(())
}
