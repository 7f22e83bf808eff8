//! Colour and camera quantities of our own code, for the cross-check against other libraries.
//!
//! Reads a JSON request from standard input and writes the answer to standard output:
//! * request: `srgb` and `linear` (numbers), `width`, `height`, `K` (9 numbers, row-major, pixel
//!   centres at half integers), `camera_from_world` (16 numbers, row-major), `points_world` (triples,
//!   metres, in front of the camera), `pixels` (pairs), `depths_m` (as many as pixels);
//! * answer: `linear_from_srgb`, `srgb_from_linear`, `projected` (pairs), `unprojected` (triples in
//!   world space).

use std::error::Error;
use std::io::{Write, stdin, stdout};

use glam::{DVec2, DVec3};
use serde::Deserialize;
use serde_json::json;
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::color::{linear_from_srgb, srgb_from_linear};

#[derive(Deserialize)]
struct Request {
    srgb: Vec<f32>,
    linear: Vec<f32>,
    width: u32,
    height: u32,
    #[serde(rename = "K")]
    k: [f64; 9],
    camera_from_world: [f64; 16],
    points_world: Vec<[f64; 3]>,
    pixels: Vec<[f64; 2]>,
    depths_m: Vec<f64>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let request: Request = serde_json::from_reader(stdin().lock())?;
    let k = &request.k;
    let camera = Intrinsics::new((k[0], k[4]), (k[2], k[5]), (request.width, request.height))?;
    let camera_from_world = RigidTransform::from_row_major(&request.camera_from_world)?;
    let project = |point: &[f64; 3]| {
        camera
            .project(camera_from_world.apply(DVec3::from_array(*point)))
            .map(|pixel| pixel.to_array())
            .ok_or_else(|| format!("{point:?} lies behind the camera"))
    };
    let world_from_camera = camera_from_world.inverse();
    let unproject = |(pixel, &depth): (&[f64; 2], &f64)| {
        let point = camera.unproject(DVec2::from_array(*pixel), depth);
        world_from_camera.apply(point).to_array()
    };
    let each = |values: &[f32], map: fn(f32) -> f32| -> Vec<f64> {
        values.iter().map(|v| f64::from(map(*v))).collect()
    };
    let pixels = request.pixels.iter().zip(&request.depths_m);
    let answer = json!({
        "linear_from_srgb": each(&request.srgb, linear_from_srgb),
        "srgb_from_linear": each(&request.linear, srgb_from_linear),
        "projected": request.points_world.iter().map(project).collect::<Result<Vec<_>, _>>()?,
        "unprojected": pixels.map(unproject).collect::<Vec<_>>(),
    });
    writeln!(stdout(), "{answer}")?;
    Ok(())
}
