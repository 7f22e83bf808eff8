//! Scores one picture against another with the metrics crate alone.
//!
//! ```console
//! $ cargo run --release -p sharp-bench --example score_two_pictures -- [FOLDER]
//! ```
//! LPIPS and DISTS use torchvision's published features, which are bundled with the crate. If FOLDER is given, the two
//! pictures are written to it.

#![allow(clippy::print_stdout, reason = "an example that prints its result")]

use std::error::Error;
use std::path::PathBuf;

use image::{Rgb, RgbImage};
use sharp_metrics::{Picture, Scorer, Selection, Weights};

/// A wave pattern, brightened by `brighter` levels.
fn waves(brighter: u8) -> RgbImage {
    RgbImage::from_fn(160, 120, |x, y| {
        let wave = |length: f32| (100.0 + 80.0 * ((x * x + y * y) as f32 / length).sin()) as u8;
        Rgb([900.0, 1200.0, 1500.0].map(|length| wave(length) + brighter))
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let (target, prediction) = (waves(0), waves(8));
    if let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) {
        std::fs::create_dir_all(&folder)?;
        target.save(folder.join("target.png"))?;
        prediction.save(folder.join("prediction.png"))?;
    }
    let scorer = Scorer::new(&Selection::parse("paper,ssim-all")?, &Weights::at_hand())?;
    let (target, prediction) = (Picture::Rgb8(target), Picture::Rgb8(prediction));
    for (key, score) in scorer.score(&prediction, &target, None)? {
        match score {
            Ok(value) => println!("{key:<28} {value:.6}"),
            Err(reason) => println!("{key:<28} {reason}"),
        }
    }
    Ok(())
}
