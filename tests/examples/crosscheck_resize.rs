//! Pictures resized by our kernels, for the cross-check against the libraries that these reproduce.
//!
//! Reads a JSON list of requests from standard input: `input` (a file of interleaved RGB: `.u8` bytes,
//! `.f32` little-endian floats in 0..1), `from` and `to` (width, height), `kernel`, `output` (written in
//! the form that its extension names; an error if the kernel returns the other form).

use std::error::Error;
use std::io::stdin;
use std::path::{Path, PathBuf};

use image::{ImageBuffer, Rgb};
use serde::Deserialize;
use sharp_metrics::{Picture, ResizeKernel, resize};

#[derive(Deserialize)]
struct Request {
    input: PathBuf,
    from: (u32, u32),
    kernel: String,
    to: (u32, u32),
    output: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let requests: Vec<Request> = serde_json::from_reader(stdin().lock())?;
    for request in requests {
        let picture = read(&request.input, request.from)?;
        let kernel: ResizeKernel = request.kernel.parse()?;
        let resized = resize(&picture, request.to.0, request.to.1, kernel)?;
        let bytes = match (&resized, extension(&request.output)) {
            (Picture::Rgb8(resized), "u8") => resized.as_raw().clone(),
            (Picture::RgbF32(resized), "f32") => {
                let values = resized.as_raw().iter();
                values.flat_map(|value| value.to_le_bytes()).collect()
            }
            _ => {
                return Err(
                    format!("{kernel} gives another form than {:?}", request.output).into(),
                );
            }
        };
        std::fs::write(&request.output, bytes)?;
    }
    Ok(())
}

fn extension(path: &Path) -> &str {
    path.extension().and_then(|e| e.to_str()).unwrap_or("")
}

fn read(path: &Path, (width, height): (u32, u32)) -> Result<Picture, Box<dyn Error>> {
    let bytes = std::fs::read(path)?;
    let size = || format!("{}: not {width}x{height} pixels", path.display());
    if extension(path) == "u8" {
        let picture = ImageBuffer::from_raw(width, height, bytes).ok_or_else(size)?;
        return Ok(Picture::Rgb8(picture));
    }
    let (values, _) = bytes.as_chunks::<4>();
    let values = values.iter().map(|v| f32::from_le_bytes(*v)).collect();
    let picture: ImageBuffer<Rgb<f32>, _> =
        ImageBuffer::from_raw(width, height, values).ok_or_else(size)?;
    Ok(Picture::RgbF32(picture))
}
