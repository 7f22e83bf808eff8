//! Reads your own pictures with a `transforms.json`: views, cameras and depth.
//!
//! ```console
//! $ cargo run --release -p sharp-bench --example read_a_dataset -- [FOLDER]
//! ```
//! First writes a small dataset, three cameras in a row in front of a wall, to FOLDER or a temporary folder. With
//! another format instead of `nerfstudio`, the same code reads any dataset of `sharp-bench datasets list`.

#![allow(clippy::print_stdout, reason = "an example that prints its result")]

use std::error::Error;
use std::path::{Path, PathBuf};

use image::{ImageBuffer, Luma, Rgb, RgbImage};
use sharp_datasets::{DatasetSpec, open};

fn write_dataset(folder: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    let mut frames = Vec::new();
    for n in 0..3_u8 {
        let picture = RgbImage::from_fn(64, 48, |x, y| Rgb([4 * x as u8, 5 * y as u8, 80 * n]));
        picture.save(folder.join(format!("view{n}.png")))?;
        let millimetres = ImageBuffer::from_pixel(64, 48, Luma([2000_u16]));
        millimetres.save(folder.join(format!("depth{n}.png")))?;
        // Camera to world, metres, OpenGL's axes: x right, y up, z backward.
        frames.push(format!(
            r#"{{"file_path": "view{n}.png", "depth_file_path": "depth{n}.png",
             "transform_matrix": [[1, 0, 0, 0.{n}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}"#
        ));
    }
    let camera = r#""fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48"#;
    let text = format!(r#"{{{camera}, "frames": [{}]}}"#, frames.join(","));
    Ok(std::fs::write(folder.join("transforms.json"), text)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let temporary = tempfile::tempdir()?;
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    let folder = folder.unwrap_or_else(|| temporary.path().to_owned());
    write_dataset(&folder)?;
    let spec = DatasetSpec::parse(&format!("mine:nerfstudio={}", folder.display()))?;
    for view in open(&spec)?.iter().flat_map(|scene| &scene.views) {
        let (centre, k) = (
            view.camera_from_world.inverse().translation,
            view.intrinsics,
        );
        // Pixels are decoded on each call and not cached.
        let depth = view
            .content
            .depth()?
            .and_then(|map| map.iter().copied().reduce(f32::min));
        println!(
            "{}: {k:?}\n  at {centre} m, nearest depth {depth:?} m",
            view.id
        );
    }
    Ok(())
}
