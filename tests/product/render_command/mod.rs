//! `render`.

mod paths;
mod refusals;
mod rules;
mod views;

use crate::render_scene::{SIZE, folder, gaussians, write};
use crate::support::{Said, read, sharp_bench, words};
use image::{DynamicImage, RgbImage};
use std::f64::consts::TAU;
use std::path::Path;

/// Runs `render scene.ply --backend cpu` with further arguments.
fn render(dir: &Path, more: &[&str]) -> Said {
    sharp_bench(
        dir,
        &[&["render", "scene.ply", "--backend", "cpu"], more].concat(),
    )
}

fn bytes(path: impl AsRef<Path>) -> Vec<u8> {
    let path = path.as_ref();
    std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn picture(path: impl AsRef<Path>) -> RgbImage {
    match image::load_from_memory(&bytes(path)).unwrap() {
        DynamicImage::ImageRgb8(picture) => picture,
        other => panic!("{:?}", other.color()),
    }
}

/// The colour of a pixel that no Gaussian reaches.
fn corner(dir: &Path, name: &str, more: &[&str]) -> [u8; 3] {
    render(dir, &[&["--out", name], more].concat()).ends_with(0);
    picture(dir.join(name)).get_pixel(0, 0).0
}
