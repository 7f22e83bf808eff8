//! Camera models of our own code, for the cross-check against OpenCV.
//!
//! Reads a JSON list of requests from standard input and writes a list of answers to standard output:
//! * request: `model` and `params` (COLMAP's), `size` (width, height), `points` (triples in camera
//!   space), `pixels` (pairs), `pinhole` (fx, fy, cx, cy of a camera of the same size); `picture`, a file
//!   of interleaved RGB bytes taken through the lens, and `undistorted`, the file to write after
//!   resampling; `mask` and `masked`, the same for a mask of grey bytes;
//! * answer: `projected` (pairs), `unprojected` (pairs at z = 1), `map` (for each pixel of the pinhole
//!   camera, its position in the lens's picture), `scannetpp_focal` (fx, fy of ScanNet++'s pinhole
//!   camera; fisheye only). Values that the lens does not define are null.

use std::error::Error;
use std::io::{Write, stdin, stdout};
use std::path::PathBuf;

use glam::{DVec2, DVec3};
use image::{GrayImage, RgbImage};
use serde::Deserialize;
use serde_json::{Value, json};
use sharp::camera::Intrinsics;
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::undistort::Undistortion;

#[derive(Deserialize)]
struct Request {
    model: String,
    params: Vec<f64>,
    size: (u32, u32),
    points: Vec<[f64; 3]>,
    pixels: Vec<[f64; 2]>,
    pinhole: [f64; 4],
    picture: PathBuf,
    undistorted: PathBuf,
    mask: PathBuf,
    masked: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let requests: Vec<Request> = serde_json::from_reader(stdin().lock())?;
    let answers: Result<Vec<Value>, _> = requests.iter().map(answer).collect();
    writeln!(stdout(), "{}", Value::from(answers?))?;
    Ok(())
}

fn answer(request: &Request) -> Result<Value, Box<dyn Error>> {
    let (width, height) = request.size;
    let lens = Lens::from_colmap(&request.model, request.size, &request.params)?;
    let [fx, fy, cx, cy] = request.pinhole;
    let pinhole = Intrinsics::new((fx, fy), (cx, cy), request.size)?;
    let undistortion = Undistortion::new(lens, pinhole);
    let taken = RgbImage::from_raw(width, height, std::fs::read(&request.picture)?)
        .ok_or("the picture has another size")?;
    std::fs::write(&request.undistorted, undistortion.image(&taken).as_raw())?;
    let mask = GrayImage::from_raw(width, height, std::fs::read(&request.mask)?)
        .ok_or("the mask has another size")?;
    std::fs::write(&request.masked, undistortion.mask(&mask).as_raw())?;

    let projected = request.points.iter().map(|p| lens.project(DVec3::from(*p)));
    let unprojected = request
        .pixels
        .iter()
        .map(|p| lens.unproject(DVec2::from(*p)));
    let map = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let map = map.map(|(x, y)| undistortion.stored_place(x, y));
    let focal = match lens.distortion() {
        Distortion::OpenCvFisheye { .. } => {
            let k = *Undistortion::like_scannetpp(lens)?.pinhole();
            json!([k.fx, k.fy])
        }
        _ => Value::Null,
    };
    Ok(json!({
        "projected": projected.map(|p| p.map(|p| p.to_array())).collect::<Vec<_>>(),
        "unprojected": unprojected.map(|p| p.map(|p| [p.x, p.y])).collect::<Vec<_>>(),
        "map": map.map(|p| p.map(|p| p.to_array())).collect::<Vec<_>>(),
        "scannetpp_focal": focal,
    }))
}
